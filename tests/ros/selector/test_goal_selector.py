"""The goal selector in front of a navigation server that answers as the test says."""

from __future__ import annotations

import pytest

from pacman_env.ros import topics
from tests.ros.selector_game import Game, number_at

# A round


def test_round_leads_from_first_goal_to_home(game: Game) -> None:
    game.start()
    game.begin()
    first = game.running_goal(1)
    assert first.handle.request.pose.header.frame_id == "map"

    game.stand(first.x - 0.2, first.y)  # within the pick-up radius
    number = number_at(first)
    game.status(f"pellet_collected:{number}")
    assert game.session.values(topics.REMOVE_PELLET) == [number]
    second = game.running_goal(2)
    assert number_at(second) != number
    assert not first.cancelled, "switched by sending, never by cancelling"

    game.pellets()  # a report from before the removal: it is not counted twice
    game.stand(second.x + 0.28, second.y)  # within the goal tolerance alone
    game.condition(lambda c: c["pose"][0] == pytest.approx(second.x + 0.28), "the pose")
    game.succeed(second)
    assert game.statuses() == [f"pellet_collected:{pellet}" for pellet in (number, number_at(second))]
    third = game.running_goal(3)

    game.say(topics.GAME_COMMAND, "disable")
    game.say(topics.GAME_COMMAND, "return_home")
    game.say(topics.GAME_STATE, "returning_home")
    assert third.cancelled
    home = game.running_goal(4)
    assert (home.x, home.y) == pytest.approx(game.pose[:2])
    assert game.stops() > 0
    game.stand(0.1, 0.0)
    game.condition(lambda c: c["pose"][0] == pytest.approx(0.1), "the pose")
    game.succeed(home)
    assert game.statuses()[2:] == ["home_reached"]


def test_death_names_ghost_and_ends_drive(game: Game) -> None:
    game.start()
    game.begin()
    goal = game.running_goal(1)
    x, y, _ = game.pose
    game.clyde(x + 0.2, y)
    game.status("death_detected")
    assert goal.cancelled
    assert game.stops() > 0
    game.say(topics.GAME_STATE, "dying")  # so the referee answers
    game.session.advance(5.0)
    assert game.session.values(topics.GAME_EVENT) == ["clyde killed"]
    assert len(game.nav2.goals) == 1
    assert game.statuses() == ["death_detected"]
