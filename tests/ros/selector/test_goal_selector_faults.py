"""The goal selector where the planner of the original failed: its faults 4 to 13, by number."""

from __future__ import annotations

import signal
import time
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("rclpy")


from pacman_env.ros import topics
from tests.ros.scripted_nav2 import ScriptedNav2
from tests.ros.selector_game import Game, pellet

if TYPE_CHECKING:
    from tests.ros.system import Probe, System


def test_fault_4_an_aborted_goal_loses_no_pellet_and_another_one_is_next(game: Game) -> None:
    game.start()
    game.begin()
    first = game.running_goal(1)
    game.nav2.abort(first, error=208)
    second = game.running_goal(2)
    assert (second.x, second.y) != (first.x, first.y)
    condition = game.condition(lambda c: c["goals_aborted"] == 1)
    assert (condition["last_status"], condition["last_error_code"]) == (6, 208)
    assert condition["pellets_left"] == len(game.left)
    assert not game.probe.values(topics.REMOVE_PELLET)
    assert not game.statuses()


def test_fault_5_a_rejected_goal_is_not_asked_for_again_and_again(game: Game) -> None:
    game.nav2.script = ["reject"] * 3
    game.start()
    game.begin()
    game.running_goal(4)
    assert len(set(game.nav2.all[:4])) == 4
    condition = game.condition(lambda c: c["goals_rejected"] == 3)
    assert len(condition["masked"]) == 3


def test_fault_6_a_goal_accepted_after_disable_is_cancelled_at_once(game: Game) -> None:
    game.nav2.script = ["late"]
    game.start()
    game.begin()
    game.goal(1)
    game.say(topics.GAME_COMMAND, "disable")
    game.say(topics.GAME_STATE, "menu")
    game.condition(lambda c: c["state"] == "menu")
    game.nav2.let_in()
    game.probe.wait_for(lambda: game.nav2.goals[0].cancelled, what="its end")
    game.say(topics.GAME_COMMAND, "enable")  # nothing is ever driven in the menu
    game.probe.spin(0.5)
    assert len(game.nav2.goals) == 1


def test_fault_8_goals_do_not_alternate_at_a_boundary(game: Game) -> None:
    game.start()
    game.begin()
    a, b = pellet(0), pellet(1)
    middle = (a[0] + b[0]) / 2, (a[1] + b[1]) / 2
    began = time.monotonic()
    flips = 0
    while time.monotonic() < began + 4.0:
        side = (a, b)[flips % 2]
        game.stand(middle[0] + 0.25 * (side[0] - middle[0]), middle[1] + 0.25 * (side[1] - middle[1]))
        flips += 1
        game.probe.spin(0.25)
    passed = time.monotonic() - began
    assert flips > 10
    assert len(set(game.nav2.all)) >= 2, "the policy never wavered"
    assert len(game.nav2.goals) <= 2 + passed / 1.0


@pytest.mark.parametrize(("at", "report"), [((0.2, 0.0), "home_reached"), ((3.0, 0.0), "home_failed")])
def test_fault_9_home_has_failed_only_if_the_robot_is_not_there(
    game: Game, at: tuple[float, float], report: str
) -> None:
    game.start()
    game.stand(*game.pose)
    game.say(topics.GAME_STATE, "menu")
    game.condition(lambda c: c["home"] is not None, "home")
    x, y = pellet(0)
    game.stand(x, y)
    game.condition(lambda c: c["pose"][:2] == pytest.approx((x, y)), "the pose")
    game.say(topics.GAME_COMMAND, "return_home")
    game.say(topics.GAME_STATE, "returning_home")
    goal = game.running_goal(1)
    assert (goal.x, goal.y) == pytest.approx(game.pose[:2])
    game.stand(*at)
    game.condition(lambda c: c["pose"][:2] == pytest.approx(at), "the pose")
    if report == "home_failed":
        game.nav2.succeed(goal)  # Nav2 counts the nearest place that can be reached
    else:
        game.nav2.abort(goal)
    game.status(report)
    assert game.statuses() == [report]


def test_fault_10_without_nav2_the_rules_go_on_and_it_is_used_once_it_is_there(probe: Probe, system: System) -> None:
    game = Game(probe, system, None)
    game.start()
    game.begin()
    game.condition(lambda c: c["state"] == "running" and not c["nav2"], "the round")
    number, (x, y) = next(iter(game.left.items()))
    before = time.monotonic()
    game.stand(x, y)
    game.status(f"pellet_collected:{number}")
    assert time.monotonic() - before < 1.5
    game.nav2 = ScriptedNav2(probe)
    game.running_goal(1)
    game.nav2.close()
    game.condition(lambda c: not c["nav2"], "Nav2's end")
    before = time.monotonic()
    game.clyde(x, y)
    game.status("death_detected")
    assert time.monotonic() - before < 1.5


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda n: n.name)
@pytest.mark.parametrize("answer", ["accept", "late"])
def test_fault_13_a_signal_stops_the_robot_before_the_node_ends(game: Game, number: int, answer: str) -> None:
    game.nav2.script = [answer]
    process = game.start()
    game.begin()
    goal = game.running_goal(1) if answer == "accept" else game.goal(1)
    process.send(number)
    game.probe.wait_for(game.stopped, what="zero velocity")
    game.nav2.let_in()
    game.probe.wait_for(lambda: goal.cancelled, what="the cancel")
    game.probe.wait_for(lambda: process.popen.poll() is not None, what="the end")
    assert process.wait() == 0
    assert "Traceback" not in process.output
