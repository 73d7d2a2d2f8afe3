"""A node that is killed, or stands still for too long, is started again and finds its way back into the running game.

One whole game in lock-step on a part of a map; times are simulated. That processes killed with SIGKILL find one another
again is in ``test_killed_processes.py``, how a node notices that it stood still in ``test_node.py``.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import REFEREE, SELECTOR
from pacman_env.ros.lock_step.lock_step_game import RESTART_S
from pacman_env.ros.message_conversion import pose_message, pose_of
from pacman_env.ros.standstill import DEFAULT_LEASE_S, STOOD_STILL
from tests.map_parts import part_of_map
from tests.ros import session

FROZEN_S = DEFAULT_LEASE_S + 5.0  # longer than the middleware's lease
SETTINGS = ("clyde.speed_mps=0.02", "show.start_s=4", "show.death_s=5")  # Clyde does not catch a robot that stands
RECORDED = (
    *(topics.GAME_STATE, topics.GAME_RESULT, topics.SCORE, topics.ROUND, topics.PELLETS_SPAWNED),
    *(topics.PELLETS_COLLECTED, topics.GAME_COMMAND, topics.GAME_STATUS, topics.REMOVE_PELLET, topics.AMCL_POSE),
)


class Game(session.Session):
    """All nodes but the operator, which is the test."""

    @property
    def nodes(self) -> Any:
        return self.game

    def until(self, state: str) -> None:
        self.wait_for(lambda: self.value(topics.GAME_STATE) == state, 300.0, f"state {state}")

    def collect(self, pellets: int) -> None:
        self.wait_for(lambda: self.value(topics.PELLETS_COLLECTED) >= pellets, 300.0, f"{pellets} pellets")

    def removed(self) -> set[int]:
        """Pellets that the planner has had removed in this round."""
        return set(self.values(topics.REMOVE_PELLET))

    def away_m(self) -> float:
        """How far from home the robot believes to be."""
        return math.hypot(*pose_of(self.latest(topics.AMCL_POSE))[:2])

    def play_to_the_end(self, score: int) -> None:
        """The round is completed; every pellet of it counts."""
        over = (topics.GAME_RESULT, topics.GAME_STATUS)
        self.wait_for(lambda: self.value(over[0]) or "death_detected" in self.values(over[1]), 300.0, "the end")
        assert self.value(topics.GAME_RESULT) == f"Complete - Score: {score}"
        assert self.value(topics.SCORE) == score

    @contextmanager
    def frozen(self, name: str) -> Iterator[None]:
        """Have a node stand still meanwhile, until it ends and is started again."""
        restarts, since_s = len(self.nodes.restarts), self.now_s
        member = self.member(name)
        self.freeze(member)
        yield
        self.advance(since_s + FROZEN_S - self.now_s)
        member.node.status = STOOD_STILL
        self.thaw(member, drop=True)
        self.within(lambda: None, member.node)  # a node with a status ends after its callback
        assert [one[1:] for one in self.nodes.restarts[restarts:]] == [(name, STOOD_STILL)]
        self.wait_for(lambda: self.nodes.member(name), RESTART_S + 0.1, f"{name} to be there")


@pytest.fixture(scope="module")
def game(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Game]:
    folder = tmp_path_factory.mktemp("game")
    ground = part_of_map("loop", 3.0).save(folder / "ground.yaml")
    with session.game(folder, ground, "lookahead", seed=3, session=Game, settings=SETTINGS) as game:
        game.record(*RECORDED)
        yield game
        assert game.errors() == []


@pytest.fixture
def spawned(game: Game) -> int:
    """The pellets of a new game's first round, of which nothing is collected yet."""
    assert game.call(topics.RESET_GAME).success
    game.until("menu")
    game.advance(2.0)  # the robot stands
    game.clear()
    assert game.call(topics.START_GAME).success
    game.until("running")
    assert not game.value(topics.PELLETS_COLLECTED)
    return int(game.value(topics.PELLETS_SPAWNED))


def test_restarted_goal_selector_collects_nothing_twice(game: Game, spawned: int) -> None:
    game.collect(1)
    commands = len(game.values(topics.GAME_COMMAND))
    game.nodes.kill(SELECTOR)
    game.play_to_the_end(spawned)
    reports = [word for word in game.values(topics.GAME_STATUS) if word.startswith("pellet_collected")]
    assert len(reports) == len(set(reports)) == spawned
    assert "reset_round" not in game.values(topics.GAME_COMMAND)[commands:]


def test_restarted_goal_selector_brings_robot_home(game: Game, spawned: int) -> None:
    game.play_to_the_end(spawned)
    assert game.away_m() > 1.0
    game.nodes.kill(SELECTOR)  # which was not told where home is
    game.until("menu")
    assert (game.value(topics.SCORE), game.value(topics.ROUND)) == (spawned, 2)
    assert game.away_m() < 0.6


def test_restarted_referee_learns_of_missed_death(game: Game, spawned: int) -> None:
    def caught() -> bool:  # Clyde is where the robot is
        place = pose_of(game.latest(topics.AMCL_POSE))
        game.publish(topics.CLYDE_POSE, pose_message(*place, game.stamp()))
        return "death_detected" in game.values(topics.GAME_STATUS)

    game.nodes.kill(REFEREE)
    said = len(game.values(topics.GAME_STATE))
    game.wait_for(caught, RESTART_S, "the death")
    game.until("dying")
    assert game.values(topics.GAME_STATE)[said:] == ["running", "dying"]
    assert game.value(topics.GAME_RESULT).startswith("Death")
    game.until("menu")


def test_frozen_referee_counts_all_later(game: Game, spawned: int) -> None:
    game.collect(1)
    with game.frozen(REFEREE):
        game.wait_for(lambda: len(game.removed()) > 1, FROZEN_S, "pellets that are not counted")
    game.play_to_the_end(spawned)
    assert {value for value in game.values(topics.PELLETS_SPAWNED) if value} == {spawned}


def test_frozen_pellet_manager_has_all_pellets_later(game: Game, spawned: int) -> None:
    game.until("returning_home")
    with game.frozen("pellet_manager"):
        game.play_to_the_end(spawned)
        game.until("menu")
        game.clear(topics.GAME_RESULT, topics.REMOVE_PELLET)
        assert game.call(topics.START_GAME).success
        game.until("starting")
    game.until("running")  # the round has waited for its pellets
    assert game.value(topics.ROUND) == 2
    game.play_to_the_end(2 * spawned)
