"""A node that is frozen for longer than the middleware waits for it, and goes on: the score is right at the end.

One whole system, ten times as fast as time, on a part of a map; the middleware takes a node for dead after 2 s.
"""

from __future__ import annotations

import math
import os
import signal
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from eval.campaign.schedule import part_of_map
from pacman_env.ros import topics
from pacman_env.ros.standstill import LEASE
from tests.ros.system import Probe, System
from tests.ros.test_killed_nodes import COLLECTED, HEARD, NODES, RESULT, ROUND, SCORE, SPAWNED, Game

if TYPE_CHECKING:
    from tests.ros.system import Process

LEASE_S = 2.0  # short_lease.xml
AGAIN_S = 5.0  # of wall time: a busy machine answers within it


class Frozen(Game):
    """A game whose nodes can be frozen."""

    def menu(self) -> None:
        """As of every game; a node that was frozen is without a name, so that nobody can be asked who serves."""
        self.ask(topics.RESET_GAME, lambda: self.state == "menu" and self.value(SCORE) == 0, "the menu of a new game")
        self.wait(lambda: not self.drives(), "the robot to stand")
        self.forget(*HEARD)

    def begin(self) -> None:
        self.menu()
        self.ask_for_start()

    def ask_for_start(self) -> None:
        """Until the game runs: the robot may have to drive home first, and a reset asked for twice may come late."""
        self.ask(topics.START_GAME, lambda: self.state == "running", "the start", only_in="menu")

    def ask(self, service: topics.Service, done: Callable[[], bool], what: str, only_in: str = "") -> None:
        """Call until it is done: an answer may be lost, a call before it be obeyed late."""
        client = service.client(self.probe.node)
        self.wait(client.service_is_ready, service.name)
        asked_s = -math.inf

        def there() -> bool:
            nonlocal asked_s
            if done():
                return True
            if time.monotonic() - asked_s > AGAIN_S and self.state in (only_in or self.state, "None"):
                client.call_async(service.type.Request())
                asked_s = time.monotonic()
            return False

        self.wait(there, what)
        self.probe.node.destroy_client(client)

    @contextmanager
    def frozen(self, name: str) -> Iterator[None]:
        """That node does nothing, and the others take it for dead in the end."""
        process: Process = self.processes[name]
        os.kill(process.popen.pid, signal.SIGSTOP)
        try:
            yield
            self.probe.spin(2 * LEASE_S)
        finally:
            os.kill(process.popen.pid, signal.SIGCONT)

    def to_the_end(self, score: int) -> None:
        """The round is completed; every pellet of it counts."""
        self.wait(lambda: self.value(RESULT) or self.state == "dying", "the end of the round")
        assert self.value(RESULT) == f"Complete - Score: {score}"
        self.wait(lambda: self.value(SCORE) == score, "the score")


@pytest.fixture(scope="module")
def whole(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Frozen]:
    folder = tmp_path_factory.mktemp("system")
    ground = str(part_of_map("loop", 3.0).save(folder / "ground.yaml"))
    nodes = {name: own | ({"map_yaml": ground} if "map_yaml" in own else {}) for name, own in NODES.items()}
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("XDG_STATE_HOME", str(tmp_path_factory.mktemp("state")))
        patch.setenv(LEASE, "3600")  # they go on: what the others make of that is the question here
        patch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(Path(__file__).with_name("short_lease.xml")))
        with System(folder) as system, Probe(system) as probe:
            game = Frozen(probe, system, nodes)
            yield game
            for name in list(game.processes):
                game.kill(name)


@pytest.fixture
def game(whole: Frozen) -> Frozen:
    """In a round that runs, of which nothing is collected yet."""
    for name in NODES:
        if name not in whole.processes:
            whole.start(name)
    whole.begin()
    whole.until("running")
    whole.wait(lambda: whole.value(SPAWNED) and not whole.value(COLLECTED), "the pellets")
    return whole


def removed(game: Game) -> set[int]:
    """Pellets that the goal selector has had removed in this round."""
    return set(game.probe.values(topics.REMOVE_PELLET))


def test_a_referee_who_was_frozen_counts_all_that_was_collected_meanwhile(game: Frozen) -> None:
    spawned = game.value(SPAWNED)
    game.collect(1)
    with game.frozen("game_controller"):
        game.wait(lambda: len(removed(game)) >= spawned - 1, "all but one or none")
    game.to_the_end(spawned)
    assert {value for value in game.probe.values(SPAWNED) if value} == {spawned}


def test_a_referee_who_was_killed_counts_all_that_was_collected_meanwhile(game: Frozen) -> None:
    spawned = game.value(SPAWNED)
    game.collect(1)
    game.kill("game_controller")
    game.wait(lambda: len(removed(game)) >= 3, "pellets that nobody counts")
    game.forget(SPAWNED)
    game.start("game_controller")
    game.to_the_end(spawned)
    assert {value for value in game.probe.values(SPAWNED) if value} == {spawned}


def test_a_pellet_manager_who_was_frozen_between_two_rounds_has_all_pellets_in_the_next(game: Frozen) -> None:
    spawned = game.value(SPAWNED)
    with game.frozen("pellet_manager"):
        game.to_the_end(spawned)
        game.until("menu")
        game.forget(RESULT, topics.REMOVE_PELLET)
        game.ask_for_start()
        game.until("running")
    assert game.value(ROUND) == 2
    game.to_the_end(2 * spawned)
