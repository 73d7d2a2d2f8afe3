"""A node killed and started again finds its way back into the running game; all other nodes go on.

One whole game in lock-step serves every test; each brings it to where it needs it. Times are simulated. That processes
killed with SIGKILL find one another again is in ``test_killed_processes.py``.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import pytest

from pacman_env.ros import topics
from pacman_env.ros.messages import seconds_of
from tests.ros import session
from tests.ros.running_game import CLYDE_MPS, FAR_M, HOME, POLICY, SETTINGS, Game

MAP = "loop"


@pytest.fixture(scope="module")
def whole(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Game]:
    folder = tmp_path_factory.mktemp("game")
    with session.game(folder, MAP, POLICY, seed=2, settings=SETTINGS, home=HOME) as running:
        yield Game(running, MAP)
        assert running.errors() == []


@pytest.fixture
def game(whole: Game) -> Game:
    """With all its nodes, even if a test before this one has failed halfway."""
    whole.nodes_are_there()
    return whole


def test_restarted_goal_selector_collects_nothing_twice(game: Game) -> None:
    game.play(7)
    game.collect(1)
    game.kill("goal_selector")
    game.start("goal_selector")
    had, commands = len(game.collected()), len(game.values(topics.GAME_COMMAND))
    game.wait(lambda: len(game.collected()) >= had + 2, "two pellets more")
    assert len(set(game.collected())) == len(game.collected())
    game.collect(0)
    assert "reset_round" not in game.values(topics.GAME_COMMAND)[commands:]


def test_restarted_goal_selector_brings_robot_home(game: Game) -> None:
    score, round_ = game.complete()
    game.kill("goal_selector")
    game.start("goal_selector", "home")
    game.until("menu")
    game.stands_at(score, round_ + 1)
    assert math.hypot(*game.robot()) < FAR_M / 2


def test_restarted_referee_counts_meanwhile_collected_pellets(game: Game) -> None:
    game.play(7)
    game.collect(1)
    game.kill("game_controller")
    had = len(game.collected())
    commands = len(game.values(topics.GAME_COMMAND))
    game.wait(lambda: len(game.collected()) > had, "a pellet that is not counted")
    game.start("game_controller")
    game.wait(lambda: len(game.values(topics.GAME_COMMAND)) > commands, "the referee")
    # The planner repeats every 2 s what was unanswered 2 s before.
    game.wait(game.counted, "the pellet to be counted", 4.1)
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
    game.start("game_controller")
    game.until("dying")
    assert game.values(topics.GAME_STATE)[said:] == ["running", "dying"]
    assert game.value(topics.GAME_RESULT).startswith("Death")
    game.until("menu")


def test_spinning_robot_stands_when_mapper_is_killed(game: Game) -> None:
    def turns(since_s: float) -> bool:
        velocities = [one for one in game.messages(topics.CMD_VEL) if one.twist.angular.z != 0.0]
        return any(seconds_of(one.header.stamp) > since_s for one in velocities)

    game.begin()
    game.wait(lambda: turns(0.0) and game.turn() > 1.0, "the spin")
    game.kill("game_event_mapper")
    game.wait(lambda: not game.drives(), "the robot to stand", 2.0)
    assert game.state == "starting"  # by the base's own time-out: nothing else has stopped it
    stood_s = seconds_of(game.latest(topics.ODOMETRY).header.stamp)
    game.forget(topics.GAME_LIGHT)
    game.start("game_event_mapper")
    game.until("running")
    game.wait(lambda: "pellet" in game.values(topics.GAME_LIGHT), "an event to be shown again")
    assert not turns(stood_s)
