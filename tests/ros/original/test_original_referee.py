"""The original's referee in a process of its own among ours: two rounds, and every pellet counts.

It publishes its commands in bursts with a depth of 1, of which only the last is sure to arrive: that there is only
between processes. Real processes, ten times real time, which wait for conditions.
"""

from __future__ import annotations

import dataclasses
import json
import math
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from geometry_msgs.msg import PointStamped
from std_msgs.msg import Header

from pacman_env.ros import topics
from pacman_env.ros.messages import pellets_of, pose_of
from pacman_env.ros.supervisor.game_nodes import GAME, REFEREE, SELECTOR, SIMULATOR, module_of
from tests.ros.original.corridor import AWAY, CLYDE_MPS, PELLETS, SETTINGS, corridor
from tests.ros.system import Probe, System

LIMIT_S = 600.0  # of real time, for anything that happens at all
AGAIN_S = 3.0  # of real time: what has not reached every node by then is published once more
TRIES = 4  # Clyde may end a round
WITH_MAP = (SIMULATOR, "pellet_manager", "clyde_ghost_node", SELECTOR)
OWN: dict[str, dict[str, Any]] = {
    SIMULATOR: {"speed": 10.0},
    "clyde_ghost_node": {"seed": 1},
    SELECTOR: {"policy": "nearest", "home": "[0.0, 0.0, 0.0]"},
}


def every_value(topic: topics.Topic) -> topics.Topic:
    """A latched topic of which every value is recorded."""
    return dataclasses.replace(topic, qos=topics.COMMANDS)


STATE, RESULT, SCORE, ROUND, SPAWNED, COLLECTED = (
    every_value(topic)
    for topic in (
        *(topics.GAME_STATE, topics.GAME_RESULT, topics.SCORE, topics.ROUND),
        *(topics.PELLETS_SPAWNED, topics.PELLETS_COLLECTED),
    )
)
RECORDED = (
    *(STATE, RESULT, SCORE, ROUND, SPAWNED, COLLECTED),
    *(topics.PELLET_MARKERS, topics.CLYDE_POSE, topics.GAME_LIGHT, topics.DIAGNOSTICS),
)


class Game:
    """All nodes, the referee the original's."""

    def __init__(self, probe: Probe, system: System) -> None:
        self.probe, self.system = probe, system
        map = str(corridor().save(Path(system.folder) / "corridor.yaml"))
        probe.record(*RECORDED)
        probe.publisher(topics.BASE_CLYDE_SPEED).publish(topics.BASE_CLYDE_SPEED.type(data=CLYDE_MPS))
        for name in (SIMULATOR, *GAME, SELECTOR):
            if name == REFEREE:
                system.start("tests.ros.original.game_controller", use_sim_time=True)
                continue
            own = OWN.get(name, {}) | ({"map_yaml": map} if name in WITH_MAP else {})
            system.start(module_of(name), use_sim_time=True, settings=list(SETTINGS), **own)

    def wait(self, condition: Callable[[], Any], what: str) -> Any:
        return self.probe.wait_for(condition, LIMIT_S, what)

    def again(self, do: Callable[[], object], condition: Callable[[], object], what: str) -> None:
        """Do something until the condition holds: nodes that are not connected yet have missed it."""
        done_s = -math.inf

        def holds() -> bool:
            nonlocal done_s
            if condition():
                return True
            if time.monotonic() - done_s > AGAIN_S:
                do()
                done_s = time.monotonic()
            return False

        self.wait(holds, what)

    def value(self, topic: topics.Topic) -> Any:
        values = self.probe.values(topic)
        return values[-1] if values else None

    def reset(self) -> None:
        """To the menu, with all pellets, score 0 and round 1; every node has followed."""
        client = topics.RESET_GAME.client(self.probe.node)
        self.wait(client.service_is_ready, "the referee")

        def ask() -> None:
            self.probe.forget()
            client.call_async(topics.RESET_GAME.type.Request())

        self.again(ask, self.is_reset, "every node to have followed a reset")
        self.probe.node.destroy_client(client)

    def is_reset(self) -> bool:
        markers = self.probe.messages(topics.PELLET_MARKERS)
        condition = json.loads(self.value(topics.DIAGNOSTICS) or "{}")
        wanted = (STATE, "menu"), (SCORE, 0), (ROUND, 1), (SPAWNED, PELLETS), (topics.GAME_LIGHT, "off")
        return bool(
            all(self.value(topic) == value for topic, value in wanted)
            and markers
            and len(pellets_of(markers[-1])) == PELLETS
            and self.probe.messages(topics.CLYDE_POSE)
            and condition.get("pellets_left") == PELLETS
            and condition.get("nav2")
        )

    def put_clyde_away(self) -> None:
        """Into a room without a door."""
        point = PointStamped(header=Header(frame_id="map"))
        point.point.x, point.point.y = AWAY

        def there() -> bool:
            poses = self.probe.messages(topics.CLYDE_POSE)
            return bool(poses) and math.dist(pose_of(poses[-1])[:2], AWAY) < 0.1

        self.again(lambda: self.probe.publish(topics.CLICKED_POINT, point), there, "Clyde")

    def round(self, number: int) -> list[list[int]] | None:
        """One round from the call to the menu: pellets spawned, collected, scores; None: Clyde has ended it."""
        self.put_clyde_away()
        self.probe.forget()
        assert self.probe.call(topics.START_GAME, timeout_s=LIMIT_S).success
        self.wait(lambda: "running" in self.probe.values(STATE), "the round")
        self.wait(lambda: self.value(STATE) not in ("starting", "running"), "the end of the round")
        lost = "dying" in self.probe.values(STATE)
        self.wait(lambda: self.value(STATE) == "menu", "the menu")
        if lost:
            return None
        self.wait(lambda: self.value(ROUND) == number + 1, "the next round's number")
        self.wait(lambda: f"Complete - Score: {self.value(SCORE)}" in self.probe.values(RESULT), "score and result")
        return [self.probe.values(SPAWNED), self.probe.values(COLLECTED), self.probe.values(SCORE)]


@pytest.fixture
def game(domain: int, tmp_path: Path) -> Iterator[Game]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
        with System(tmp_path) as system, Probe(system) as probe:
            game = Game(probe, system)
            yield game
            for process in system.processes:  # how they end in order is tested elsewhere
                process.popen.kill()
                process.popen.wait()
            system.processes.clear()


def test_with_the_originals_referee_two_rounds_end_with_every_pellet_counted(game: Game) -> None:
    for number, (spawned, collected, score) in enumerate(two_rounds(game), 1):
        assert set(spawned) - {0} == {PELLETS}
        assert max(collected) == PELLETS
        assert max(score) == number * PELLETS
        assert score == sorted(score)
    assert "Traceback" not in "".join(process.output for process in game.system.processes)


def two_rounds(game: Game) -> list[list[list[int]]]:
    """Both completed, from score 0."""
    for _ in range(TRIES):
        game.reset()
        if (first := game.round(1)) is not None and (second := game.round(2)) is not None:
            return [first, second]
    raise AssertionError(f"Clyde has ended one of two rounds {TRIES} times")
