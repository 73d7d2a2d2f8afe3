"""Nodes in processes of their own that are killed with SIGKILL find one another again.

One system of real processes, ten times real time, on a part of a map; the middleware takes a process for gone
after 5 s. What each node does after its return is in ``test_killed_nodes.py``, that a process ends after a long
standstill in ``test_node.py``.
"""

from __future__ import annotations

import dataclasses
import math
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from pacman_env.ros import topics
from pacman_env.ros.simulated_robot.sim_robot import FAULT
from pacman_env.ros.standstill import LEASE, STOOD_STILL
from pacman_env.ros.supervisor.game_nodes import GAME, REFEREE, SELECTOR, SIMULATOR
from tests.map_parts import part_of_map
from tests.ros.game_processes import GameProcesses
from tests.ros.system import Probe, System

AGAIN_S = 5.0  # of real time: a busy machine answers within it
LIMIT_S = 240.0  # of real time, for anything that happens at all
# No round is lost.
SETTINGS = ["clyde.speed_mps=0.02", "execution.death_radius_m=0.001", "show.start_s=2", "show.death_s=2"]
OWN: dict[str, dict[str, Any]] = {
    SIMULATOR: {"speed": 10.0},
    SELECTOR: {"policy": "lookahead", "home": "[0.0, 0.0, 0.0]"},
}


def every_value(topic: topics.Topic) -> topics.Topic:
    """A latched topic of which every value is recorded."""
    return dataclasses.replace(topic, qos=topics.COMMANDS)


RECORDED = STATE, RESULT, SCORE, ROUND, SPAWNED, COLLECTED = [
    every_value(topic)
    for topic in (
        *(topics.GAME_STATE, topics.GAME_RESULT, topics.SCORE, topics.ROUND),
        *(topics.PELLETS_SPAWNED, topics.PELLETS_COLLECTED),
    )
]


class Game(GameProcesses):
    """All nodes but the operator, which is the test."""

    def __init__(self, probe: Probe, system: System, map: str) -> None:
        super().__init__(probe, system, map, SETTINGS, OWN)
        probe.record(*RECORDED, topics.REMOVE_PELLET)
        self.start_all()
        self.wait(lambda: "policy lookahead" in self.processes[SELECTOR].output, "the planner")
        self.wait(lambda: self.value(STATE) == "menu", "the referee")

    def start(self, name: str) -> None:
        with pytest.MonkeyPatch.context() as patch:
            patch.setenv(LEASE, "4" if name == REFEREE else "3600")
            super().start(name)

    def wait(self, condition: Callable[[], Any], what: str, timeout_s: float = LIMIT_S) -> Any:
        return super().wait(condition, what, timeout_s)

    def value(self, topic: topics.Topic) -> Any:
        values = self.probe.values(topic)
        return values[-1] if values else None

    def forget(self, *forgotten: topics.Topic) -> None:
        for topic in forgotten:
            self.probe.heard(topic).clear()

    def ask(self, service: topics.Service, done: Callable[[], bool], what: str, only_in: str = "") -> None:
        """Call until it is done: an answer may be lost, a call before it be obeyed late."""
        client = service.client(self.probe.node)
        self.wait(client.service_is_ready, service.name)
        asked_s = -math.inf

        def there() -> bool:
            nonlocal asked_s
            if done():
                return True
            if time.monotonic() - asked_s > AGAIN_S and self.value(STATE) in (only_in or self.value(STATE), None):
                client.call_async(service.type.Request())
                asked_s = time.monotonic()
            return False

        self.wait(there, what)
        self.probe.node.destroy_client(client)

    def ask_for_start(self) -> None:
        """Until the game runs: the robot may have to drive home first."""
        self.ask(topics.START_GAME, lambda: self.value(STATE) == "running", "the start", only_in="menu")

    def begin(self) -> int:
        """A new game's first round runs, and none of its pellets is collected yet: how many there are."""
        self.forget(STATE)
        self.ask(topics.RESET_GAME, lambda: self.value(STATE) == "menu" and self.value(SCORE) == 0, "a new game")
        self.forget(*RECORDED[1:], topics.REMOVE_PELLET)
        self.ask_for_start()
        return int(self.wait(lambda: self.value(SPAWNED), "the pellets"))

    def to_the_end(self, score: int) -> None:
        """The round is completed; every pellet of it counts."""
        result = f"Complete - Score: {score}"  # the result of the round before may still be on its way
        self.wait(lambda: self.value(RESULT) == result or "dying" in self.probe.values(STATE), result)
        assert self.value(RESULT) == result
        self.wait(lambda: self.value(SCORE) == score, "the score")


@pytest.fixture(scope="module")
def game(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Game]:
    folder = tmp_path_factory.mktemp("system")
    ground = str(part_of_map("loop", 3.0).save(folder / "ground.yaml"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        patch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(Path(__file__).with_name("short_lease.xml")))
        # Not through shared memory: a killed process leaves its port there, which its successor may take over.
        patch.setenv("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
        with System(folder) as system, Probe(system) as probe:
            game = Game(probe, system, ground)
            yield game
            game.kill_all()  # how they end in order is tested elsewhere


def test_round_with_killed_nodes_has_right_score(game: Game) -> None:
    spawned = game.begin()
    game.wait(lambda: game.value(COLLECTED), "a pellet")
    game.probe.publish(FAULT, "reject")  # no round ends while nodes come up
    for name in (*GAME, SELECTOR):
        game.kill(name)
        game.start(name)
    for name in (*GAME, SELECTOR):
        game.probe.answered_by(f"{game.system.namespace}/{name}", anew=True)
    game.wait(lambda: game.value(STATE) == "running", "the round")
    game.probe.publish(FAULT, "end reject")
    game.to_the_end(spawned)
    assert {value for value in game.probe.values(SPAWNED) if value} == {spawned}
    assert "Traceback" not in game.system.outputs()
