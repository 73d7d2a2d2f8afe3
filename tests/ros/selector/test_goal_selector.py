"""The goal selector in front of a navigation server that answers as the test says."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable

import pytest

rclpy = pytest.importorskip("rclpy")

from std_msgs.msg import Header, String  # noqa: E402

from pacman_env.config import make_config  # noqa: E402
from pacman_env.ros import topics  # noqa: E402
from pacman_env.ros.messages import markers_of, pose_message, transform_message  # noqa: E402
from pacman_env.ros.node import Once  # noqa: E402
from pacman_env.ros.selector.pose_watch import PoseLimits  # noqa: E402
from pacman_env.ros.selector.selection import Selection  # noqa: E402
from tests.calls import calls_of  # noqa: E402
from tests.ros.selector_game import FAR_AWAY, Game, house, number_at, pellet  # noqa: E402

# A round


def test_a_round_from_the_first_goal_to_the_way_home(game: Game) -> None:
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


def test_death_is_reported_with_the_ghosts_name_and_ends_the_drive(game: Game) -> None:
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


def test_a_burst_of_commands_loses_none(game: Game) -> None:
    game.start()
    game.stand(*game.pose)
    game.clyde(*FAR_AWAY)
    game.pellets()
    game.say(topics.GAME_STATE, "running")
    for word in ("disable", "reset_round", "return_home", "disable", "reset_round", "enable"):
        game.say(topics.GAME_COMMAND, word)
    game.running_goal(1)
    for word in ("enable", "return_home", "disable", "enable", "disable"):
        game.say(topics.GAME_COMMAND, word)
    game.condition(lambda c: c["task"] == "none")
    assert not game.nav2.running()
    assert not game.statuses()


def test_bad_messages_reach_nothing_but_the_log(game: Game, log: Callable[[], str]) -> None:
    game.start()
    game.begin()
    game.running_goal(1)
    wrong = topics.AMCL_POSE.type(header=Header(frame_id="odom"))
    bent = topics.AMCL_POSE.type(header=Header(frame_id="map"))
    bent.pose.pose.orientation.w = 0.5
    lost = topics.AMCL_POSE.type(header=Header(frame_id="map"))
    lost.pose.pose.position.x = math.nan
    for bad in (wrong, bent, lost):
        game.say(topics.AMCL_POSE, bad)
    assert game.troubles["bad amcl_pose"] == 3
    for bad_x in (math.nan, math.inf, 1e5):
        game.clyde(bad_x, 0.0)
    assert game.condition()["pose"] == pytest.approx(game.pose)
    game.stand(400.0, 400.0)  # no such place on this map
    game.condition(lambda c: "off the map" in c["troubles"] and c["pose"] is None, "the pose off the map")
    for word in ("", "jump", "x" * 5000):
        game.say(topics.GAME_COMMAND, word)
        game.say(topics.GAME_STATE, word)
    foreign = {99_999: pellet(0), int(house().pellet_ids[0]): (pellet(0)[0] + 0.3, pellet(0)[1])}
    game.say(topics.PELLET_MARKERS, markers_of(foreign, game.session.stamp()))
    game.say(topics.CLYDE_SPEED, -1.0)
    broken = [transform_message("odom", "base_link", (math.nan, 0.0, 0.0), game.session.stamp())]
    game.say(topics.TF, topics.TF.type(transforms=broken))
    condition = game.condition(lambda c: "bad tf" in c["troubles"] and c["pellets_unknown"], "the troubles")
    assert set(condition["troubles"]) >= {
        *("bad amcl_pose", "bad clyde_pose", "bad game_command", "bad game_state", "bad clyde/speed"),
        *("bad tf", "unknown pellets", "off the map"),
    }
    assert sorted(condition["pellets_unknown"]) == sorted(foreign)
    assert condition["state"] == "running"
    game.session.advance(5.0)
    assert log().count("bad") < 20
    game.stand(*game.pose)
    game.pellets()
    condition = game.condition(lambda c: c["pose"] is not None and c["pellets_left"] == len(game.left))
    assert not game.statuses()
    assert not game.nav2.goals[0].cancelled


def test_ten_thousand_markers_do_not_hold_the_robot_up(game: Game) -> None:
    game.start()
    game.begin()
    game.running_goal(1)
    many = dict(game.left) | {100_000 + k: (0.01 * k, 0.0) for k in range(10_000 - len(game.left) - 1)}
    game.say(topics.PELLET_MARKERS, markers_of(many, game.session.stamp()))
    game.condition(lambda c: len(c["pellets_unknown"]) == 20 and c["pellets_left"] == len(game.left), "the markers")
    x, y, _ = game.pose
    game.clyde(x, y + 0.1)
    game.status("death_detected")


def test_transforms_are_believed_before_the_latched_pose(game: Game) -> None:
    game.start(pose_timeout_s=1.0, pose_lost_s=5.0)
    game.begin()
    game.running_goal(1)
    stamp = game.session.stamp()
    links = [transform_message("map", "odom", (0.5, 0.0, 0.0), stamp)]
    links += [transform_message("odom", "base_link", (0.25, 0.125, 0.0), stamp)]
    game.say(topics.TF, topics.TF.type(transforms=links))
    condition = game.condition(lambda c: c["pose_source"] == "tf", "TF")
    assert condition["pose"] == pytest.approx([0.75, 0.125, 0.0])
    condition = game.condition(lambda c: c["pose_source"] == "amcl_pose", "the latched pose, TF being old")
    assert condition["pose"] == pytest.approx(game.pose)


# How much work


@pytest.mark.parametrize("policy", ["ppo", "lookahead", "clyde_aware"])
def test_a_decision_is_a_few_hundred_calls(policy: str) -> None:
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
    for k in range(1000):
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
    assert sorted(calls)[989] < 400, "99 of 100 decisions; the first imports and compiles"
    assert not once.counts
