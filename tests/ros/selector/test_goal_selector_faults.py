"""The goal selector where the planner of the original failed: its faults 4 to 13, by number."""

from __future__ import annotations

import signal

import pytest

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import SELECTOR, module_of
from pacman_env.ros.message_conversion import markers_of, pose_message, uncertain_pose_message
from tests.ros.scripted_nav2 import ScriptedNav2
from tests.ros.selector_game import FAR_AWAY, Game, house, pellet
from tests.ros.system import Probe, System

NODE = module_of(SELECTOR)


def test_fault_4_aborted_goal_loses_no_pellet(game: Game) -> None:
    game.start()
    game.begin()
    first = game.running_goal(1)
    game.abort(first, error=208)
    second = game.running_goal(2)
    assert (second.x, second.y) != (first.x, first.y)
    condition = game.condition(lambda c: c["goals_aborted"] == 1)
    assert (condition["last_status"], condition["last_error_code"]) == (6, 208)
    assert condition["pellets_left"] == len(game.left)
    assert not game.session.values(topics.REMOVE_PELLET)
    assert not game.statuses()


def test_fault_5_rejected_goal_is_not_repeated(game: Game) -> None:
    game.nav2.script = ["reject"] * 3
    game.start()
    game.begin()
    game.running_goal(4)
    assert len(set(game.nav2.all[:4])) == 4
    condition = game.condition(lambda c: c["goals_rejected"] == 3)
    assert len(condition["masked"]) == 3


def test_fault_6_goal_accepted_after_disable_is_cancelled(game: Game) -> None:
    game.nav2.script = ["late"]
    game.start()
    game.begin()
    game.goal(1)
    game.say(topics.GAME_COMMAND, "disable")
    game.say(topics.GAME_STATE, "menu")
    game.condition(lambda c: c["state"] == "menu")
    game.let_in()
    assert game.nav2.goals[0].cancelled
    game.say(topics.GAME_COMMAND, "enable")  # nothing is ever driven in the menu
    game.session.advance(5.0)
    assert len(game.nav2.goals) == 1


def test_fault_10_rules_continue_without_nav2(game: Game) -> None:
    game.end_nav2()
    game.start()
    game.begin()
    game.condition(lambda c: c["state"] == "running" and not c["nav2"], "the round")
    number, (x, y) = next(iter(game.left.items()))
    game.stand(x, y)
    game.session.advance(0.2)  # two decisions
    assert game.statuses() == [f"pellet_collected:{number}"]
    game.start_nav2()
    game.running_goal(1)
    game.end_nav2()
    game.condition(lambda c: not c["nav2"], "Nav2's end")
    game.clyde(x, y)
    game.session.advance(0.2)
    assert game.statuses()[1:] == ["death_detected"]


@pytest.mark.parametrize("answer", ["accept", "late"])
def test_fault_13_node_stops_robot_at_its_end(game: Game, answer: str) -> None:
    game.nav2.script = [answer]
    game.start()
    game.begin()
    goal = game.running_goal(1) if answer == "accept" else game.goal(1)
    assert game.stops() == 0
    game.nav2.create_timer(0.5, game.nav2.let_in)
    began_s = game.session.now_s
    game.session.stop(SELECTOR)
    assert goal.cancelled
    waited_s = game.session.now_s - began_s
    assert waited_s == pytest.approx(0.0 if answer == "accept" else 0.5, abs=0.051)
    stops = game.session.on(topics.CMD_VEL)
    assert stops[0].at == pytest.approx(began_s), "at once"
    assert stops[-1].at == pytest.approx(began_s + waited_s, abs=0.051), "and when Nav2 drives no more"
    assert len(stops) == game.stops() >= 3


def test_fault_13_signal_stops_robot_before_process_ends(probe: Probe, system: System) -> None:
    nav2 = ScriptedNav2(namespace=system.namespace, context=probe.context)
    probe.executor.add_node(nav2)
    probe.record(topics.CMD_VEL, topics.DIAGNOSTICS)
    process = system.start(NODE, policy="nearest", map_yaml="house", diagnostics_rate=10.0)
    probe.wait_for(lambda: probe.messages(topics.DIAGNOSTICS), what="the goal selector")
    stamp = probe.stamp()
    left = {int(n): pellet(slot) for slot, n in enumerate(house().pellet_ids)}
    for topic, message in (
        (topics.AMCL_POSE, uncertain_pose_message(0.0, 0.0, 0.0, stamp)),
        (topics.CLYDE_POSE, pose_message(*FAR_AWAY, 0.0, stamp)),
        (topics.PELLET_MARKERS, markers_of(left, stamp)),
        (topics.GAME_STATE, "running"),
        (topics.GAME_COMMAND, "enable"),
    ):
        probe.publish(topic, message)
    probe.wait_for(nav2.running, what="a goal")
    process.send(signal.SIGTERM)
    probe.wait_for(lambda: process.popen.poll() is not None, what="the end")
    assert process.wait() == 0
    assert nav2.goals[-1].cancelled
    assert probe.wait_for(lambda: probe.messages(topics.CMD_VEL), what="zero velocity")[-1].twist.linear.x == 0.0
    assert "Traceback" not in process.output
    probe.executor.remove_node(nav2)
    nav2.destroy_node()
