"""Whole games over the simulated robot, all nodes in processes: a map whose games end as wished, and what was said.

A game is recorded in the order in which its messages were published, by their publishers' clocks, so that messages of
two processes do not change places on their way. What a game must say is in ``test_whole_game.py``.
"""

from __future__ import annotations

import bisect
import contextlib
import dataclasses
import json
import math
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from functools import cached_property, partial
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import PointStamped
from rclpy.qos import QoSProfile
from std_msgs.msg import Header

from pacman_env.ros import topics
from pacman_env.ros.messages import pose_of, seconds_of
from pacman_env.ros.selector.goal_scores import DIAGNOSTICS
from pacman_env.ros.simulated_robot.sim_robot import AUDIO_SHOWN, LIGHT_RING_SHOWN
from pacman_env.ros.supervisor.game_nodes import GAME, SELECTOR, SIMULATOR, WAIT, module_of
from pacman_env.world.maps.occupancy import OccupancyMap
from tests.ros.system import Probe, System

#: Of simulated time; a machine that is too late for one gets the next. Two cores with other work are too late for more.
SPEEDS = (2.5, 1.25)
LATE_S = 2.5  # of simulated time: half of the shortest show
WINDOW_S = 0.5  # of wall time, in which waits are added up
UP_S = 240.0  # for all nodes to come up, where everything has to be compiled
GAME_S = 240.0  # of wall time, for a game of less than ten
GOALS = topics.NAVIGATE_TO_POSE.statuses
HEARD = (
    *(topics.GAME_STATE, topics.GAME_COMMAND, topics.GAME_EVENT, topics.GAME_STATUS, topics.GAME_RESULT),
    *(topics.SCORE, topics.ROUND, topics.PELLETS_SPAWNED, topics.PELLETS_COLLECTED, topics.CLYDE_SPEED),
    *(topics.GAME_LIGHT, topics.GAME_SOUND, topics.REMOVE_PELLET, topics.CMD_VEL, topics.CLYDE_POSE),
    *(LIGHT_RING_SHOWN, AUDIO_SHOWN, GOALS, topics.ODOMETRY, DIAGNOSTICS),
)
#: Not latched, so that whoever does not listen yet misses it.
_SPOKEN = (
    *(topics.GAME_STATUS, topics.GAME_EVENT, topics.GAME_LIGHT, topics.GAME_SOUND, topics.REMOVE_PELLET),
    *(topics.CMD_VEL, topics.LIGHT_RING, topics.CLICKED_POINT),
)

# The map, in pixels of 0.05 m; pellets lie where columns and rows are multiples of 40 and 13 pixels are free.
# Clyde needs 11 pixels, the robot 8. From left to right: a closet with the home pose and the first pellet, from
# which a doorway, too narrow for Clyde, leads to the other pellets; and a cage without a door.
_RESOLUTION_M = 0.05
_SIZE = 260, 110
_FREE = (  # columns from and to, rows from and to
    (30, 46, 34, 46),  # the closet, with a pellet
    (47, 74, 35, 45),  # the rest of it; robot and Clyde do not get past one another
    (75, 83, 36, 44),  # the doorway
    (84, 166, 34, 46),  # two pellets, one after the other
    (154, 166, 34, 86),  # and around the corner another: no two are equally far
    (236, 252, 54, 70),  # the cage
)
PELLETS = 4
_HOME = 37, 40  # so that whoever stops on the way home, 0.30 m before it, is at the closet's pellet
CAGE, CLOSET = (244, 62), (69, 40)  # where Clyde is put: he never gets out, and there is no way past him


def _at(column: int, row: int) -> tuple[float, float]:
    """A pixel's place, m."""
    return column * _RESOLUTION_M, (_SIZE[1] - row) * _RESOLUTION_M


def closet() -> OccupancyMap:
    """The map."""
    pixels = np.zeros(_SIZE[::-1], np.uint8)
    for left, right, top, bottom in _FREE:
        pixels[top : bottom + 1, left : right + 1] = 254
    return OccupancyMap.from_pixels("closet", pixels, _RESOLUTION_M, (0.0, 0.0, 0.0))


@dataclass(frozen=True)
class Said:
    """A message, and when it was published: s of the publisher's wall clock."""

    at: float
    topic: str
    message: Any

    @property
    def value(self) -> Any:
        """Its ``data``."""
        return self.message.data


class Tape:
    """Everything that is said on ``HEARD``, of latched topics every value; of the odometry what there is time for."""

    def __init__(self, probe: Probe) -> None:
        self.said: list[Said] = []
        self._last: dict[str, Any] = {}
        for topic in HEARD:
            qos = QoSProfile(depth=2000, durability=topic.qos.durability, reliability=topic.qos.reliability)
            every = topic if topic is topics.ODOMETRY else dataclasses.replace(topic, qos=qos)
            every.subscription(probe.node, partial(self._hear, topic.name))

    def _hear(self, topic: str, message: Any, info: dict[str, Any]) -> None:
        self.said.append(Said(info["source_timestamp"] * 1e-9, topic, message))
        self._last[topic] = message

    def last(self, topic: topics.Topic) -> Any:
        """The message that arrived last, None: none."""
        return self._last.get(topic.name)

    def value(self, topic: topics.Topic) -> Any:
        """Its ``data``."""
        return getattr(self.last(topic), "data", None)


class CoreWaits:
    """How long some processes have waited for a core, where Linux tells it: their main threads, which do the work."""

    LOOK_S = 0.02

    def __init__(self, processes: Collection[int]) -> None:
        self._files = [Path(f"/proc/{process}/schedstat") for process in processes]
        self._looks: list[tuple[float, float]] = [(time.time(), self._waited_s())]  # wall s, s since their begin

    def look(self) -> None:
        """To be called often; what is between two looks is known as a whole."""
        if time.time() > self._looks[-1][0] + self.LOOK_S:
            self._looks.append((time.time(), self._waited_s()))

    def _waited_s(self) -> float:
        waited_ns = 0
        for file in self._files:
            with contextlib.suppress(OSError, IndexError):
                waited_ns += int(file.read_text().split()[1])
        return waited_ns * 1e-9

    def between(self, begin: float, end: float) -> float:
        """All together, s, from the last look before ``begin`` to the first after ``end``, wall s."""
        times = [at for at, _ in self._looks]
        first = max(bisect.bisect_right(times, begin) - 1, 0)
        last = min(bisect.bisect_left(times, end), len(times) - 1)
        return max(self._looks[last][1] - self._looks[first][1], 0.0)

    @property
    def worst(self) -> float:
        """The most in half a second, s."""
        return max(self.between(at - WINDOW_S, at) for at, _ in self._looks)


class Recording:
    """One game as it was said, from the call of ``game/start`` on."""

    def __init__(self, said: list[Said], before: dict[str, Any], waits: CoreWaits, speed: float) -> None:
        self.speed = speed
        self.said = sorted(said, key=attrgetter("at"))
        self.before = before  # the latched numbers, by topic, and the goals known
        self.waits = waits
        odometry = self.on(topics.ODOMETRY)
        self._clock = [s.at for s in odometry], [seconds_of(s.message.header.stamp) for s in odometry]

    def on(self, *wanted: topics.Topic) -> list[Said]:
        """What was said on topics, in order."""
        names = {topic.name for topic in wanted}
        return [said for said in self.said if said.topic in names]

    def values(self, topic: topics.Topic) -> list[Any]:
        """As ``on``, the ``data`` alone."""
        return [said.value for said in self.on(topic)]

    def clock(self, at: float) -> float:
        """The simulated time at an instant of the wall's, s."""
        return float(np.interp(at, *self._clock))

    @cached_property
    def states(self) -> list[tuple[str, float, float]]:
        """Each state with its begin and end, wall s."""
        said = self.on(topics.GAME_STATE)
        ends = [*(one.at for one in said[1:]), math.inf]
        return [(one.value, one.at, end) for one, end in zip(said, ends, strict=True)]

    @cached_property
    def goals(self) -> dict[bytes, tuple[float, int]]:
        """Nav2's goals of this game: when each was first seen, wall s, and its last status."""
        goals: dict[bytes, tuple[float, int]] = {}
        for said in self.on(GOALS):
            for goal in said.message.status_list:
                key = bytes(goal.goal_info.goal_id.uuid)
                goals[key] = goals.get(key, (said.at, 0))[0], goal.status
        return {key: goal for key, goal in goals.items() if key not in self.before[GOALS.name]}


class Table:
    """The game set up, in menu: ``sim_robot`` in the closet and every node of the game, faster than the wall's time."""

    def __init__(self, system: System, probe: Probe, policy: str, speed: float) -> None:
        self.speed = speed
        self.system, self.probe = system, probe
        self.tape = Tape(probe)
        map_yaml = closet().save(Path(system.folder) / "closet.yaml")
        own: dict[str, dict[str, Any]] = {
            SIMULATOR: {
                "map_yaml": map_yaml,
                "speed": speed,
                "home": f"{_at(*_HOME)[0]},{_at(*_HOME)[1]},0.0",
            },
            "pellet_manager": {"map_yaml": map_yaml},
            "clyde_ghost_node": {"map_yaml": map_yaml, "seed": 1},
            SELECTOR: {"map_yaml": map_yaml, "policy": policy},
        }
        settings = ["localization.sigma_xy_m=0.01", "localization.sigma_yaw_rad=0.02"]  # the closet is narrow
        for node in (SIMULATOR, *GAME, SELECTOR):
            system.start(module_of(node), use_sim_time=True, settings=settings, **own.get(node, {}))
        waiter = system.start(module_of(WAIT), use_sim_time=True)
        probe.wait_for(lambda: waiter.popen.poll() == 0, UP_S, "the robot's pose")
        probe.wait_for(self._ready, UP_S, "the planner")
        self._greet()

    def _ready(self) -> bool:
        condition = json.loads(self.tape.value(DIAGNOSTICS) or "{}")
        wanted = {"active": True, "nav2": True, "state": "menu", "pellets_left": PELLETS}
        known = all(condition.get(name) is not None for name in ("home", "clyde", "pose"))
        return known and all(condition[name] == value for name, value in wanted.items())

    def _greet(self) -> None:
        """Until a reset reaches the robot: whoever is not connected yet would miss the beginning."""
        own = {topic.name for topic in HEARD}
        for topic in _SPOKEN:
            name = f"{self.system.namespace}/{topic.name}"
            least = 1 + (topic.name in own)
            self.probe.wait_for(
                lambda name=name, n=least: self.probe.node.count_subscribers(name) >= n, UP_S, f"a listener on {name}"
            )
        self.probe.call(topics.RESET_GAME, timeout_s=UP_S)
        self.probe.wait_for(lambda: self.tape.value(topics.GAME_LIGHT) == "off", what="the answer to a reset")
        self.probe.wait_for(lambda: self.tape.value(topics.PELLETS_SPAWNED) == PELLETS, what="the pellets")
        self.probe.wait_for(self._resting, what="the ring to be let go")

    def _resting(self) -> bool:
        """Nothing shines, sounds or moves."""
        ring, audio = (json.loads(self.tape.value(topic) or "{}") for topic in (LIGHT_RING_SHOWN, AUDIO_SHOWN))
        velocity = self.tape.last(topics.ODOMETRY).twist.twist
        return (
            not ring.get("override_system")
            and not audio.get("playing")
            and abs(velocity.linear.x) + abs(velocity.angular.z) < 0.01
        )

    def _place_clyde(self, x: float, y: float) -> None:
        point = PointStamped(header=Header(frame_id="map"))
        point.point.x, point.point.y = x, y
        self.probe.publish(topics.CLICKED_POINT, point)
        self.probe.wait_for(
            lambda: math.dist(pose_of(self.tape.last(topics.CLYDE_POSE))[:2], (x, y)) < 0.1, what="Clyde to be placed"
        )

    def play(self, clyde: tuple[int, int]) -> Recording:
        """One game from the menu to the menu, with Clyde put on a pixel before."""
        tape, probe = self.tape, self.probe
        self._place_clyde(*_at(*clyde))
        numbers = (topics.SCORE, topics.ROUND, topics.PELLETS_COLLECTED, topics.CLYDE_SPEED, topics.PELLETS_SPAWNED)
        before: dict[str, Any] = {topic.name: tape.value(topic) for topic in numbers}
        goals = tape.last(GOALS)
        known = [] if goals is None else goals.status_list
        before[GOALS.name] = {bytes(goal.goal_info.goal_id.uuid) for goal in known}
        begin = len(tape.said)
        waits = CoreWaits([process.popen.pid for process in self.system.processes if process.popen.poll() is None])

        def wait(condition: Callable[[], object], what: str) -> None:
            def looked() -> object:
                waits.look()
                return condition()

            probe.wait_for(looked, GAME_S, what)

        assert probe.call(topics.START_GAME).success
        for state in ("running", "menu"):
            wait(lambda state=state: tape.value(topics.GAME_STATE) == state, f"state {state}")
        wait(lambda: tape.value(topics.GAME_LIGHT) == "off", "the light to go off")
        wait(self._resting, "the robot to rest")
        wait(lambda: tape.value(topics.PELLETS_SPAWNED) == PELLETS, "the pellets to be back")
        probe.spin(0.5)  # what comes now must not come
        waits.look()
        return Recording(tape.said[begin:], before, waits, self.speed)
