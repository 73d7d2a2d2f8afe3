"""How the goal selector begins, changes its policy, watches as a shadow, and ends."""

from __future__ import annotations

import json
import re
import signal
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rclpy")

from lifecycle_msgs.msg import Transition
from lifecycle_msgs.srv import ChangeState, GetState
from rcl_interfaces.msg import Parameter, ParameterType, ParameterValue
from rcl_interfaces.srv import SetParameters
from std_msgs.msg import Header, String

from pacman_env.ros import topics
from pacman_env.ros.messages import pose_message
from pacman_env.ros.selector.goal_scores import DIAGNOSTICS, SCORES
from tests.ros.selector_game import FAR_AWAY, NODE, Game, house, pellet, slot_of

if TYPE_CHECKING:
    from tests.ros.system import System


def test_a_start_in_the_middle_of_a_round_goes_on_from_what_is_latched(game: Game) -> None:
    process = game.start()
    game.begin()
    game.running_goal(1)
    process.send(signal.SIGTERM)
    game.probe.wait_for(lambda: process.popen.poll() is not None, what="the end of the first")
    assert game.nav2.goals[0].cancelled
    for word in ("disable", "reset_round", "return_home", "enable"):  # as a game before has left it
        game.probe.publisher(topics.GAME_COMMAND).publish(String(data=word))
    game.start()
    game.clyde(*FAR_AWAY)
    game.pellets()
    goal = game.running_goal(2)
    assert slot_of((goal.x, goal.y)) < house().pellets
    assert not game.statuses()


@pytest.mark.parametrize("state", ["menu", "running"])
def test_goals_that_a_killed_node_has_left_are_cancelled_at_the_start(game: Game, state: str) -> None:
    process = game.start()
    game.begin()
    orphan = game.running_goal(1)
    process.popen.kill()
    process.popen.wait()
    game.system.processes.remove(process)
    game.say(topics.GAME_STATE, state)
    assert orphan.running
    game.start()
    game.probe.wait_for(lambda: orphan.cancelled, what="its end")
    if state == "running":
        game.clyde(*FAR_AWAY)
        game.pellets()
        assert not game.running_goal(2).cancelled
    else:
        game.probe.spin(0.5)
        assert len(game.nav2.goals) == 1


def test_what_the_referee_does_not_answer_is_reported_again(game: Game) -> None:
    game.start()
    game.begin()
    game.say(topics.PELLETS_COLLECTED, 0)
    first = game.running_goal(1)
    game.stand(first.x, first.y)
    number = int(house().pellet_ids[slot_of((first.x, first.y))])
    word = f"pellet_collected:{number}"
    game.probe.wait_for(lambda: game.statuses().count(word) >= 2, what="the pellet again")
    game.say(topics.PELLETS_COLLECTED, 1)
    game.probe.taken_in(topics.PELLETS_COLLECTED, "goal_selector")
    told = game.statuses().count(word)
    game.clyde(first.x, first.y)
    game.probe.wait_for(lambda: game.statuses().count("death_detected") >= 2, what="the death again")
    game.say(topics.GAME_STATE, "dying")
    game.probe.taken_in(topics.GAME_STATE, "goal_selector")
    said = game.statuses()
    game.probe.spin(2.5)
    assert game.statuses() == said
    assert said.count(word) == told
    assert game.probe.values(topics.GAME_EVENT) == ["clyde killed"]


def test_a_shadow_decides_and_sends_nothing(game: Game) -> None:
    process = game.start(shadow=True)
    game.begin()
    chosen = game.probe.wait_for(lambda: re.search(r"shadow: goal 1: pellet (\d+)", process.output), what="a decision")
    x, y = game.left[int(chosen[1])]
    game.stand(x, y)
    game.probe.wait_for(lambda: "shadow: status pellet_collected" in process.output, what="a pellet")
    game.probe.wait_for(lambda: "shadow: goal 2" in process.output, what="the next goal")
    game.clyde(x, y)
    game.probe.wait_for(lambda: "shadow: status death_detected" in process.output, what="death")
    assert process.stop() == 0
    assert not game.nav2.goals
    for topic in (topics.GAME_STATUS, topics.GAME_EVENT, topics.REMOVE_PELLET, topics.CMD_VEL):
        assert not game.probe.heard(topic), topic.name


def set_policy(game: Game, value: str) -> Any:
    service = topics.Service("goal_selector/set_parameters", "rcl_interfaces/SetParameters")
    text = ParameterValue(type=ParameterType.PARAMETER_STRING, string_value=value)
    request = SetParameters.Request(parameters=[Parameter(name="policy", value=text)])
    return game.probe.call(service, request).results[0]


def test_the_policy_changes_in_menu_alone_and_only_to_one_that_can_be_used(game: Game) -> None:
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
    game.probe.wait_for(lambda: len(game.nav2.goals) == 2, what="a goal of the new one")
    wanted = set(range(house().pellets, len(house().goal_xy)))  # refuges, which the policy before did not rate
    shown = game.probe.wait_for(
        lambda: next((m.markers for m in game.probe.messages(SCORES) if wanted & {one.id for one in m.markers}), None),
        what="scores",
    )
    assert all(marker.text for marker in shown[1:])
    assert sum(marker.color.g > 0.5 for marker in shown) == 1


def test_the_node_follows_the_lifecycle(game: Game) -> None:
    process = game.system.start(NODE, policy="nearest", map_yaml="house", autostart=False)

    def change(transition: int) -> bool:
        service = topics.Service("goal_selector/change_state", "lifecycle_msgs/ChangeState")
        request = ChangeState.Request(transition=Transition(id=transition))
        return bool(game.probe.call(service, request).success)

    def state() -> str:
        service = topics.Service("goal_selector/get_state", "lifecycle_msgs/GetState")
        return str(game.probe.call(service, GetState.Request()).current_state.label)

    assert state() == "unconfigured"
    assert change(Transition.TRANSITION_CONFIGURE)
    game.begin()
    game.probe.spin(0.5)
    assert not game.nav2.goals
    assert change(Transition.TRANSITION_ACTIVATE)
    goal = game.running_goal(1)
    assert change(Transition.TRANSITION_DEACTIVATE)
    game.probe.wait_for(lambda: goal.cancelled and game.stopped(), what="the stop")
    assert change(Transition.TRANSITION_ACTIVATE)
    game.running_goal(2)
    assert change(Transition.TRANSITION_DEACTIVATE)
    assert change(Transition.TRANSITION_CLEANUP)
    assert state() == "unconfigured"
    assert change(Transition.TRANSITION_CONFIGURE)
    assert process.stop() == 0


@pytest.mark.parametrize(
    ("parameters", "complaint"),
    [
        ({"policy": "bold"}, "unknown policy 'bold'"),
        ({"map_yaml": "nowhere.yaml"}, "nowhere.yaml"),
        ({"home": "[1.0, 2.0]"}, "home: 2 numbers"),
        ({"settings": ["execution.tick_s=0"]}, "execution.tick_s"),
    ],
)
def test_what_cannot_be_used_is_said_at_the_start(system: System, parameters: dict[str, Any], complaint: str) -> None:
    process = system.start(NODE, **{"map_yaml": "house", **parameters})
    assert process.wait() == 2
    system.processes.clear()
    assert complaint in process.output
    assert "Traceback" not in process.output


def test_an_initial_pose_that_is_corrected_in_the_menu_moves_home_and_in_a_round_it_does_not(game: Game) -> None:
    game.start()
    game.stand(*game.pose)
    game.say(topics.GAME_STATE, "menu")

    def home() -> list[float]:
        told = [json.loads(text)["home"] for text in game.probe.values(DIAGNOSTICS)]
        return told[-1] if told and told[-1] else []

    def corrected(x: float, y: float) -> None:
        message = topics.INITIAL_POSE.type(header=Header(stamp=game.probe.stamp(), frame_id="map"))
        message.pose.pose = pose_message(x, y, 0.0, game.probe.stamp()).pose
        game.say(topics.INITIAL_POSE, message)

    game.probe.wait_for(lambda: home() == pytest.approx(list(game.pose)), what="home")
    corrected(*pellet(0))
    game.probe.wait_for(lambda: home()[:2] == pytest.approx(list(pellet(0))), what="home to move")
    game.begin()
    game.running_goal(1)
    corrected(*pellet(1))
    game.probe.taken_in(topics.INITIAL_POSE, "goal_selector")
    game.probe.forget()
    game.probe.wait_for(home, what="what is told then")
    assert home()[:2] == pytest.approx(list(pellet(0)))
