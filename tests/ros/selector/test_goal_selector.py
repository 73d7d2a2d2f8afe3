"""How the goal selector begins, changes its policy, watches, stops and ends; see also ``test_whole_game.py``."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from typing import Any

import pytest
from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters

from pacman_env.cli import main as cli
from pacman_env.ros import topics
from pacman_env.ros.game_nodes import SELECTOR
from pacman_env.ros.message_conversion import seconds_of, uncertain_pose_message
from pacman_env.ros.selector import goal_selector_node
from pacman_env.ros.selector.goal_selector_node import GoalSelectorNode
from tests.ros.direct_policy import DirectPolicy
from tests.ros.selector_game import FAR_AWAY, QUICK, Game, house, number_of_slot, pellet, slot_of
from tests.ros.session import Session


def test_killed_node_forgets_fright(game: Game) -> None:
    nodes, settings = game.session, [*QUICK, "power.pellets=1"]
    nodes.record(topics.HARMLESS_GHOSTS)
    game.power = {number_of_slot(0)}
    game.start(settings=settings)
    game.begin()
    game.running_goal(1)
    assert not any(nodes.last(topics.HARMLESS_GHOSTS).data)
    game.stand(*pellet(0))
    game.status(f"pellet_collected:{number_of_slot(0)}")
    harmless, away = nodes.last(topics.HARMLESS_GHOSTS).data
    assert (harmless - seconds_of(nodes.stamp()), away) == (pytest.approx(20.0, abs=0.5), 0.0)
    nodes.clock_ns -= 100 * 10**9  # as after a restart of the simulated robot
    game.clyde(*pellet(0))
    game.status("ghost_caught:1:clyde")
    harmless, away = nodes.last(topics.HARMLESS_GHOSTS).data
    assert harmless == away == pytest.approx(seconds_of(nodes.stamp()) + 5.0, abs=0.5)
    nodes.kill(SELECTOR)
    game.start(settings=settings)
    assert not any(nodes.last(topics.HARMLESS_GHOSTS).data)


def test_node_started_in_round_continues_it(game: Game) -> None:
    game.start()
    game.begin()
    game.running_goal(1)
    game.session.stop(SELECTOR)
    assert game.nav2.goals[0].cancelled
    for word in ("disable", "reset_round", "return_home", "enable"):  # as a game before has left it
        game.say(topics.GAME_COMMAND, word)
    game.start()
    game.clyde(*FAR_AWAY)
    game.pellets()
    goal = game.running_goal(2)
    assert slot_of((goal.x, goal.y)) < house().pellets
    assert not game.statuses()


@pytest.mark.parametrize("state", ["menu", "running"])
def test_goals_of_killed_node_are_cancelled(game: Game, state: str) -> None:
    game.start()
    game.begin()
    orphan = game.running_goal(1)
    game.session.kill(SELECTOR)
    game.say(topics.GAME_STATE, state)
    game.session.advance(5.0)
    assert orphan.running
    game.start()
    game.session.wait_for(lambda: orphan.cancelled, what="its end")
    if state == "running":
        game.clyde(*FAR_AWAY)
        game.pellets()
        assert not game.running_goal(2).cancelled
    else:
        game.session.advance(5.0)
        assert len(game.nav2.goals) == 1


def test_shadow_decides_and_sends_nothing(game: Game, log: Callable[[], str]) -> None:
    game.start(shadow=True)
    game.begin()
    chosen = game.session.wait_for(lambda: re.search(r"goal 1: pellet (\d+)", log()), what="a decision")
    assert chosen is not None
    x, y = game.left[int(chosen[1])]
    game.stand(x, y)
    game.session.wait_for(lambda: f"shadow: status pellet_collected:{chosen[1]}" in log(), what="a pellet")
    game.session.wait_for(lambda: "goal 2" in log(), what="the next goal")
    for slot in (0, 5, 0, 5):  # the nearest pellet changes, and the goals before end as with Nav2
        game.stand(*pellet(slot))
        game.session.advance(12.0)
    assert "goal 3" in log()
    assert "shadow: cancel" not in log()
    game.clyde(*pellet(5))
    game.session.wait_for(lambda: "shadow: status death_detected" in log(), what="death")
    game.session.stop(SELECTOR)
    assert not game.nav2.goals
    assert not game.session.on(topics.GAME_STATUS, topics.GAME_EVENT, topics.REMOVE_PELLET, topics.CMD_VEL)


@pytest.mark.parametrize("name", ["goal_selector", "shadow"])
def test_command_passes_options_to_node(nodes: Session, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    words: list[str] = []
    monkeypatch.setattr(goal_selector_node, "main", lambda argv: words.extend(argv) or 0)
    options = "--map house --policy nearest --namespace lab/r2 --sim --set clyde.speed_mps=0.1 --home 0.1 0 0.5"
    shadow = ["--shadow"] if name == "shadow" else []
    assert cli.main(["ros", "goal_selector", *options.split(), *shadow]) == 0
    node = nodes.add_node(lambda **options: GoalSelectorNode(DirectPolicy, **{**options, "cli_args": words}))
    assert node.get_fully_qualified_name() == f"/lab/r2/{name}"
    assert node.config.clyde.speed_mps == 0.1
    assert node.get_parameter("home").value == [0.1, 0.0, 0.5]
    assert [node.get_parameter(one).value for one in ("policy", "use_sim_time")] == ["nearest", True]
    driven = node.count_publishers("/lab/r2/cmd_vel"), node.count_publishers("/lab/r2/game_status")
    assert driven == ((0, 0) if shadow else (1, 1))


def set_policy(game: Game, value: str) -> Any:
    service = topics.Service("goal_selector/set_parameters", "rcl_interfaces/SetParameters")
    text = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=value)
    request = SetParameters.Request(parameters=[Parameter(name="policy", value=text)])
    return game.session.call(service, request).results[0]


def test_policy_changes_in_menu_alone(game: Game) -> None:
    game.start()
    game.begin()
    game.running_goal(1)
    answer = set_policy(game, "lookahead")
    assert not answer.successful
    assert "running" in answer.reason
    game.say(topics.GAME_COMMAND, "disable")
    game.say(topics.GAME_STATE, "menu")
    game.condition(lambda c: c["state"] == "menu")
    answer = set_policy(game, "absent.onnx")
    assert not answer.successful
    assert "absent.onnx" in answer.reason
    assert set_policy(game, "lookahead").successful
    game.condition(lambda c: c["policy"] == "lookahead", "the policy")
    game.begin()
    game.running_goal(2)
    wanted = set(range(house().pellets, len(house().goal_xy)))  # refuges, which the policy before did not rate
    shown = game.session.wait_for(
        lambda: next(
            (m.markers for m in game.session.messages(topics.SCORES) if wanted & {one.id for one in m.markers}), []
        ),
        what="scores",
    )
    assert all(marker.text for marker in shown[1:])
    assert sum(marker.color.g > 0.5 for marker in shown) == 1


def test_node_follows_lifecycle(game: Game) -> None:
    game.session.start(SELECTOR, policy="nearest", map_yaml="house", autostart=False)

    def change(transition: int) -> bool:
        service = topics.Service("goal_selector/change_state", "lifecycle_msgs/ChangeState")
        request = ChangeState.Request(transition=Transition(id=transition))
        return bool(game.session.call(service, request).success)

    def state() -> str:
        service = topics.Service("goal_selector/get_state", "lifecycle_msgs/GetState")
        return str(game.session.call(service, GetState.Request()).current_state.label)

    assert state() == "unconfigured"
    assert change(Transition.TRANSITION_CONFIGURE)
    game.begin()
    game.session.advance(5.0)
    assert not game.nav2.goals
    assert change(Transition.TRANSITION_ACTIVATE)
    goal = game.running_goal(1)
    assert change(Transition.TRANSITION_DEACTIVATE)
    assert goal.cancelled
    assert game.stops() > 0
    assert change(Transition.TRANSITION_ACTIVATE)
    game.running_goal(2)
    assert change(Transition.TRANSITION_DEACTIVATE)
    assert change(Transition.TRANSITION_CLEANUP)
    assert state() == "unconfigured"
    assert change(Transition.TRANSITION_CONFIGURE)
    game.session.stop(SELECTOR)


def test_home_is_where_robot_leaves_menu(game: Game) -> None:
    game.start()
    game.stand(*game.pose)
    game.say(topics.GAME_STATE, "menu")

    def home() -> list[float]:
        game.session.advance(0.2)  # a decision
        return game.condition(lambda c: c["home"], "home")["home"]  # type: ignore[no-any-return]

    def click(x: float, y: float) -> None:
        game.say(topics.INITIAL_POSE, uncertain_pose_message(x, y, 0.0, game.session.stamp()))

    def play() -> None:
        for state in ("returning_home", "starting", "running", "returning_home", "menu"):
            game.say(topics.GAME_STATE, state)

    assert home() == pytest.approx(list(game.pose))
    (x, y), (other_x, other_y) = pellet(0), pellet(1)
    for where in ((x, y, 0.1), (other_x, other_y, 0.0)):
        click(*where[:2])
        game.stand(*where)  # as AMCL begins
        converged = where[0] + 0.2, where[1] - 0.1, 0.3
        game.stand(*converged)
        assert home() == pytest.approx(list(converged))
        play()
        game.stand(where[0] + 0.4, where[1], 0.0)  # as far as a goal may be missed
        assert home() == pytest.approx(list(converged)), "it does not wander from round to round"
        play()
        assert home() == pytest.approx(list(converged))
    game.begin()
    click(x, y)
    game.stand(x, y)
    game.say(topics.GAME_STATE, "menu")
    assert home() == pytest.approx(list(converged)), "a pose that is set in a round does not move it"


# The operator's stop


def stop_word(stopped: bool, at: int, by: str = "/robot_15/page") -> str:
    return json.dumps({"stopped": stopped, "at": at, "who": "guest-1", "by": by})


def test_stop_ends_goal_until_release(game: Game) -> None:
    game.session.record(topics.OPERATOR_STOP)
    game.start()
    game.begin()
    first = game.running_goal(1)
    game.say(topics.OPERATOR_STOP, stop_word(True, 10))
    assert first.ended
    condition = game.condition(lambda c: c["stopped"])
    assert condition["task"] == "play"
    assert condition["state"] == "running"
    assert "stopped by the operator" in condition["troubles"]
    assert game.stops() > 0
    game.stand(*pellet(0))  # rules go on: a pellet is a pellet
    game.status(f"pellet_collected:{house().pellet_ids[0]}")
    game.session.advance(5.0)
    assert game.condition()["stopped"]
    assert len(game.nav2.goals) == 1
    game.say(topics.OPERATOR_STOP, stop_word(False, 11))
    game.running_goal(2)
    assert "stopped by the operator" not in game.condition(lambda c: not c["stopped"])["troubles"]
    said = [json.loads(text) for text in game.session.values(topics.OPERATOR_STOP)]
    echoed = [(one["stopped"], one["at"]) for one in said if one["by"] == "/robot_15/goal_selector"]
    assert echoed[-2:] == [(True, 10), (False, 11)]


@pytest.mark.parametrize("when", ["before the stop", "after it"])
def test_goal_of_other_node_is_cancelled_while_stopped(game: Game, when: str) -> None:
    client = topics.NAVIGATE_TO_POSE.client(game.session.observer)  # RViz's, say

    def send() -> None:
        game.session.within(lambda: client.send_goal_async(topics.NAVIGATE_TO_POSE.type.Goal()))

    game.start()
    game.begin()
    game.running_goal(1)
    game.session.advance(5.0)
    if when == "before the stop":
        send()
        assert game.nav2.goals[1].running
    game.say(topics.OPERATOR_STOP, "stop")  # as a person types it
    if when == "after it":
        game.condition(lambda c: c["stopped"])
        send()
    assert len(game.nav2.goals) == 2
    assert not game.nav2.running()


@pytest.mark.parametrize(
    ("state", "command", "task"), [("returning_home", "return_home", "home"), ("running", "enable", "play")]
)
def test_node_started_while_stopped_waits_for_release(game: Game, state: str, command: str, task: str) -> None:
    game.say(topics.OPERATOR_STOP, stop_word(True, 10))
    game.start()
    game.begin()
    game.stand(*pellet(0))
    game.say(topics.GAME_STATE, state)
    game.say(topics.GAME_COMMAND, command)
    game.condition(lambda c: c["stopped"] and c["task"] == task)
    game.session.advance(5.0)
    assert not game.nav2.goals
    assert "home_failed" not in game.statuses()
    game.say(topics.OPERATOR_STOP, stop_word(False, 11))
    game.running_goal(1)


def test_reasons_are_published_with_terms(game: Game) -> None:
    game.session.record(topics.WHY, topics.CANDIDATES)
    game.start(policy="clyde_aware")
    game.begin()
    game.running_goal(1)
    game.session.wait_for(lambda: game.session.messages(topics.WHY), what="reasons")
    why: dict[str, Any] = json.loads(game.session.values(topics.WHY)[-1])
    candidates = json.loads(game.session.values(topics.CANDIDATES)[-1])
    assert candidates["pellets"] == house().pellet_ids.tolist()
    assert len(candidates["places"]) == len(house().goal_xy)
    row = next(row for row in why["rows"] if row["candidate"] == why["goal"])
    assert row["kind"] == "pellet"
    assert {"score", "allowed"} <= set(row["terms"]["clyde_aware"])
    assert why["chosen"] == {"clyde_aware": why["goal"]}
