"""The goal selector's game: everything around the node, Nav2 among it, answers as the test says."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any

from std_msgs.msg import Header

from pacman_env.config import make_config
from pacman_env.ros import topics
from pacman_env.ros.messages import markers_of, pose_message
from pacman_env.ros.selector.goal_scores import DIAGNOSTICS, SCORES
from pacman_env.sim.maps.assets import MapAssets, map_assets
from tests.ros.clock import SimulatedClock
from tests.ros.scripted_nav2 import Goal, ScriptedNav2

if TYPE_CHECKING:
    from tests.ros.system import Probe, Process, System

NODE = "pacman_env.ros.selector.goal_selector"
FAR_AWAY = (50.0, 50.0)


@cache
def house() -> MapAssets:
    return map_assets("house", make_config("robot"))


def pellet(slot: int) -> tuple[float, float]:
    x, y = house().goal_xy[slot].tolist()
    return x, y


def slot_of(place: tuple[float, float]) -> int:
    """The candidate that a goal led to."""
    apart = [math.dist(place, goal) for goal in house().goal_xy.tolist()]
    assert min(apart) < 1e-6
    return apart.index(min(apart))


class Game:
    """The rest of the game, played by the test."""

    def __init__(self, probe: Probe, system: System, nav2: ScriptedNav2 | None) -> None:
        self.probe, self.system = probe, system
        self.nav2 = nav2
        probe.record(topics.GAME_STATUS, topics.GAME_EVENT, topics.REMOVE_PELLET, topics.CMD_VEL, DIAGNOSTICS, SCORES)
        self.left = {int(n): pellet(slot) for slot, n in enumerate(house().pellet_ids)}
        self.pose = tuple(house().grid.home.tolist())
        self.clock: SimulatedClock | None = None  # goes on while something is waited for

    def start(self, *arguments: str, **parameters: Any) -> Process:
        """Start the node, quicker than on a robot for the tests' sake, and wait until it decides."""
        self.probe.forget()
        process = self._start(*arguments, **parameters)
        self._wait(lambda: self.probe.heard(DIAGNOSTICS), "the goal selector")
        return process

    def start_at_rest(self, **parameters: Any) -> SimulatedClock:
        """As ``start``, in simulated time, which goes on only while something is waited for."""
        self._start(use_sim_time=True, **parameters)
        self.clock = SimulatedClock(self.probe, "goal_selector")
        self._wait(lambda: self.probe.heard(DIAGNOSTICS), "the goal selector")
        return self.clock

    def _start(self, *arguments: str, **parameters: Any) -> Process:
        quick = ["execution.tick_s=0.1", "execution.check_period_s=0.1"]
        own = {"policy": "nearest", "settings": quick, "map_yaml": "house", "diagnostics_rate": 10.0, **parameters}
        return self.system.start(NODE, *arguments, **own)

    def _wait(self, condition: Callable[[], Any], what: str) -> Any:
        def holds() -> Any:
            value = condition()
            if not value and self.clock is not None:
                self.clock.advance(0.05)
            return value

        return self.probe.wait_for(holds, what=what)

    def say(self, topic: topics.Topic, message: Any) -> None:
        self.probe.publish(topic, message)

    def stand(self, x: float, y: float, heading: float = 0.0) -> None:
        message = topics.AMCL_POSE.type(header=Header(stamp=self.probe.stamp(), frame_id="map"))
        message.pose.pose = pose_message(x, y, heading, self.probe.stamp()).pose
        self.say(topics.AMCL_POSE, message)

    def clyde(self, x: float, y: float) -> None:
        self.say(topics.CLYDE_POSE, pose_message(x, y, 0.0, self.probe.stamp()))

    def pellets(self, *gone: int) -> None:
        for number in gone:
            self.left.pop(number, None)
        self.say(topics.PELLET_MARKERS, markers_of(self.left, self.probe.stamp()))

    def begin(self) -> None:
        """A round runs: robot at home, Clyde far away."""
        self.stand(*self.pose)
        self.clyde(*FAR_AWAY)
        self.pellets()
        self.say(topics.GAME_STATE, "running")
        self.say(topics.GAME_COMMAND, "enable")

    def goal(self, number: int) -> Goal:
        """The so-manieth goal, from 1, once it was asked for."""
        assert self.nav2 is not None
        self._wait(lambda: len(self.nav2.goals) >= number, f"goal {number}")
        return self.nav2.goals[number - 1]

    def running_goal(self, number: int) -> Goal:
        goal = self.goal(number)
        self._wait(lambda: goal.running, f"goal {number} to run")
        return goal

    def statuses(self) -> list[str]:
        return self.probe.values(topics.GAME_STATUS)

    def status(self, word: str) -> None:
        self._wait(lambda: word in self.statuses(), f"status {word}")

    def condition(self, holds: Callable[[dict[str, Any]], Any], what: str = "the condition") -> dict[str, Any]:
        """The first diagnostics from now on of which something holds."""
        seen = len(self.probe.heard(DIAGNOSTICS))

        def found() -> dict[str, Any] | None:
            latest = [json.loads(text) for text in self.probe.values(DIAGNOSTICS)[seen:]]
            return next((one for one in latest if holds(one)), None)

        return self._wait(found, what)

    def stopped(self) -> list[float]:
        """When zero velocities were heard."""
        return [
            heard.at
            for heard in self.probe.heard(topics.CMD_VEL)
            if heard.message.twist.linear.x == 0.0 and heard.message.twist.angular.z == 0.0
        ]
