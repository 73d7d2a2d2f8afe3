"""The goal selector in front of a navigation server that answers as the test says."""

from __future__ import annotations

import logging

import pytest
import rclpy
from std_msgs.msg import Header, String

from pacman_env.config import make_config
from pacman_env.ros import topics
from pacman_env.ros.messages import markers_of, pose_message
from pacman_env.ros.node import Once
from pacman_env.ros.selector.pose_watch import PoseLimits
from pacman_env.ros.selector.selection import Selection
from tests.calls import calls_of
from tests.ros.selector_game import Game, house, number_at, pellet

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


# What comes in


# How much work


@pytest.mark.parametrize("policy", ["ppo", "clyde_aware"])
def test_decision_takes_few_hundred_calls(policy: str) -> None:
    once = Once(logging.getLogger(__name__), lambda: 0.0)
    selection = Selection(make_config(), "house", policy, None, PoseLimits(), once)
    executor, sent = selection.executor, []
    calls: list[int] = []
    stamp = pose_message(0.0, 0.0, 0.0, rclpy.time.Time().to_msg()).header.stamp
    amcl = topics.AMCL_POSE.type(header=Header(stamp=stamp, frame_id="map"))
    amcl.pose.pose.orientation.w = 1.0
    selection.on_amcl(amcl, 0.0)
    selection.on_pellets(markers_of({int(n): pellet(k) for k, n in enumerate(house().pellet_ids)}, stamp), 0.0)
    executor.activate(0.0)
    executor.nav2(True, 0.0)
    selection.on_state(String(data="running"), 0.0)
    selection.on_command(String(data="enable"), 0.0)
    cells = house().clyde.position[house().clyde.cells_in(0)]
    for k in range(300):
        now = 0.5 * k
        selection.view.see_ghost(0, *cells[(37 * k) % len(cells)].tolist(), int(now * 1e9) + 1)
        calls.append(calls_of(lambda now=now: selection.decide(now, sent.extend)))
        if any(action.value == "death_detected" for action in sent[-6:]):
            for word in ("disable", "enable"):
                selection.on_command(String(data=word), now)
        for action in sent[-3:]:
            if action.kind == "send":
                executor.sent.accepted(int(action.value), now)
    assert sum(action.kind == "send" for action in sent) > 2
    assert sorted(calls)[296] < 400, "99 of 100 decisions; the first imports and compiles"
    assert not once.counts
