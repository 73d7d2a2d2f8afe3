"""A node that is killed, or stands still for too long, is started again and finds its way back into the running game.

Whole games in lock-step serve all tests; each brings its game to where it needs it. Times are simulated. That processes
killed with SIGKILL find one another again is in ``test_killed_processes.py``, how a node notices that it stood still in
``test_node.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest

from pacman_env.ros import topics
from pacman_env.ros.messages import seconds_of
from tests.map_parts import part_of_map
from tests.ros.running_game import CLYDE_MPS, FAR_M, FROZEN_S, Game, running


@pytest.fixture(scope="module")
def whole(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Game]:
    with running(tmp_path_factory.mktemp("game"), "loop", seed=2) as game:
        yield game


@pytest.fixture
def game(whole: Game) -> Game:
    """On the whole map, with all its nodes, even if a test before this one has failed halfway."""
    whole.start_absent_nodes()
    return whole


@pytest.fixture(scope="module")
def small(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Game]:
    folder = tmp_path_factory.mktemp("small")
    with running(folder, str(part_of_map("loop", 3.0).save(folder / "ground.yaml")), seed=3) as game:
        yield game


@pytest.fixture
def spawned(small: Game) -> int:
    """The pellets of a round on a part of the map that runs, of which nothing is collected yet."""
    small.begin()
    small.until("running")
    assert not small.value(topics.PELLETS_COLLECTED)
    return int(small.value(topics.PELLETS_SPAWNED))


def test_restarted_goal_selector_collects_nothing_twice(game: Game) -> None:
    game.play(7)
    game.collect(1)
    game.kill("goal_selector")
    game.start_node("goal_selector")
    had, commands = len(game.collected()), len(game.values(topics.GAME_COMMAND))
    game.wait_for(lambda: len(game.collected()) >= had + 2, 300.0, "two pellets more")
    assert len(set(game.collected())) == len(game.collected())
    game.collect(0)
    assert "reset_round" not in game.values(topics.GAME_COMMAND)[commands:]


def test_restarted_goal_selector_brings_robot_home(game: Game) -> None:
    score, round_ = game.complete()
    game.kill("goal_selector")
    game.start_node("goal_selector", "home")
    game.until("menu")
    assert (game.value(topics.SCORE), game.value(topics.ROUND)) == (score, round_ + 1)
    assert math.hypot(*game.robot()) < FAR_M / 2


def test_restarted_referee_counts_meanwhile_collected_pellets(game: Game) -> None:
    game.play(7)
    game.collect(1)
    game.kill("game_controller")
    had = len(game.collected())
    commands = len(game.values(topics.GAME_COMMAND))
    game.wait_for(lambda: len(game.collected()) > had, 300.0, "a pellet that is not counted")
    game.start_node("game_controller")
    game.wait_for(lambda: len(game.values(topics.GAME_COMMAND)) > commands, what="the referee")
    # The planner repeats every 2 s what was unanswered 2 s before.
    game.wait_for(game.counted, 4.1, "the pellet to be counted")
    assert game.state == "running"
    game.collect(1)
    assert set(game.values(topics.GAME_COMMAND)[commands:]) == {"enable"}
    assert game.value(topics.SCORE) >= had + 2
    assert game.value(topics.CLYDE_SPEED) == pytest.approx(CLYDE_MPS)


def test_restarted_referee_learns_of_missed_death(game: Game) -> None:
    game.play(1)
    game.kill("game_controller")
    game.die()
    said = len(game.values(topics.GAME_STATE))
    game.start_node("game_controller")
    game.until("dying")
    assert game.values(topics.GAME_STATE)[said:] == ["running", "dying"]
    assert game.value(topics.GAME_RESULT).startswith("Death")
    game.until("menu")


def test_spinning_robot_stands_when_mapper_is_killed(game: Game) -> None:
    def turns(since_s: float) -> bool:
        velocities = [one for one in game.messages(topics.CMD_VEL) if one.twist.angular.z != 0.0]
        return any(seconds_of(one.header.stamp) > since_s for one in velocities)

    game.begin()
    game.wait_for(lambda: turns(0.0) and game.turn() > 1.0, what="the spin")
    game.kill("game_event_mapper")
    game.wait_for(lambda: not game.drives(), 2.0, "the robot to stand")
    assert game.state == "starting"  # by the base's own time-out: nothing else has stopped it
    stood_s = seconds_of(game.latest(topics.ODOMETRY).header.stamp)
    game.forget(topics.GAME_LIGHT)
    game.start_node("game_event_mapper")
    game.until("running")
    game.wait_for(lambda: "pellet" in game.values(topics.GAME_LIGHT), 300.0, "an event to be shown again")
    assert not turns(stood_s)


def test_frozen_referee_counts_all_later(small: Game, spawned: int) -> None:
    small.collect(1)
    with small.frozen("game_controller"):
        small.wait_for(lambda: len(small.removed()) > 1, FROZEN_S, "pellets that are not counted")
    small.play_to_the_end(spawned)
    assert {value for value in small.values(topics.PELLETS_SPAWNED) if value} == {spawned}


def test_frozen_pellet_manager_has_all_pellets_later(small: Game, spawned: int) -> None:
    small.until("returning_home")
    with small.frozen("pellet_manager"):
        small.play_to_the_end(spawned)
        small.until("menu")
        small.forget(topics.GAME_RESULT, topics.REMOVE_PELLET)
        assert small.call(topics.START_GAME).success
        small.until("starting")
    small.until("running")  # the round has waited for its pellets
    assert small.value(topics.ROUND) == 2
    small.play_to_the_end(2 * spawned)
