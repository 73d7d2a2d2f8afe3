"""A node stands still for a while in a running game and goes on, or ends and is started again: the score is right.

One whole game in lock-step on a part of a map; times are simulated. What the middleware makes of processes that stand
still is in ``test_killed_processes.py``, how a node notices that it stood still for too long in ``test_node.py``.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from pacman_env.ros import topics
from pacman_env.ros.lock_step.game import RESTART_S, LockStepGame
from pacman_env.ros.standstill import DEFAULT_LEASE_S, STOOD_STILL
from tests.map_parts import part_of_map
from tests.ros import session
from tests.ros.running_game import HOME, POLICY, SETTINGS, Game

LASTS_S = DEFAULT_LEASE_S + 5.0  # longer than the middleware's lease


@pytest.fixture(scope="module")
def whole(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Game]:
    folder = tmp_path_factory.mktemp("game")
    ground = str(part_of_map("loop", 3.0).save(folder / "ground.yaml"))
    with session.game(folder, ground, POLICY, seed=3, settings=SETTINGS, home=HOME) as running:
        yield Game(running, ground)
        assert running.errors() == []


@pytest.fixture
def game(whole: Game) -> Game:
    """In a round that runs, of which nothing is collected yet."""
    whole.begin()
    whole.until("running")
    assert whole.value(topics.PELLETS_SPAWNED) > 0
    assert not whole.value(topics.PELLETS_COLLECTED)
    return whole


@contextmanager
def frozen(game: Game, name: str) -> Iterator[None]:
    """Have a node stand still meanwhile, until it ends and is started again."""
    nodes = game.session.game
    assert isinstance(nodes, LockStepGame)
    restarts, since_s = len(nodes.restarts), game.session.now_s
    nodes.freeze_node(name)
    yield
    game.session.advance(since_s + LASTS_S - game.session.now_s)
    nodes.thaw_node(name)
    assert [one[1:] for one in nodes.restarts[restarts:]] == [(name, STOOD_STILL)]
    game.wait(lambda: nodes.member(name), f"{name} to be there", RESTART_S + 0.1)


def to_the_end(game: Game, score: int) -> None:
    """The round is completed; every pellet of it counts."""
    game.wait(lambda: game.value(topics.GAME_RESULT) or game.state == "dying", "the end of the round")
    assert game.value(topics.GAME_RESULT) == f"Complete - Score: {score}"
    assert game.value(topics.SCORE) == score


def test_frozen_referee_counts_all_later(game: Game) -> None:
    spawned = game.value(topics.PELLETS_SPAWNED)
    game.collect(1)
    with frozen(game, "game_controller"):
        game.wait(lambda: len(game.removed()) > 1, "pellets that are not counted", LASTS_S)
    to_the_end(game, spawned)
    assert {value for value in game.values(topics.PELLETS_SPAWNED) if value} == {spawned}


def test_frozen_pellet_manager_has_all_pellets_later(game: Game) -> None:
    spawned = game.value(topics.PELLETS_SPAWNED)
    game.until("returning_home")
    with frozen(game, "pellet_manager"):
        to_the_end(game, spawned)
        game.until("menu")
        game.forget(topics.GAME_RESULT, topics.REMOVE_PELLET)
        assert game.session.call(topics.START_GAME).success
        game.until("starting")
    game.until("running")  # the round has waited for its pellets
    assert game.value(topics.ROUND) == 2
    to_the_end(game, 2 * spawned)
