"""A robot whose pose is lost, jumps or is of another map, or whose Nav2 fails: reported, and not driven."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import GAME, SELECTOR
from pacman_env.ros.message_conversion import pose_message, transform_message, uncertain_pose_message
from pacman_env.ros.selector.nav2_failures import error_words
from pacman_env.ros.simulated_robot.sim_robot import FAULT
from pacman_env.ros.simulated_robot.sim_sensors import map_message
from pacman_env.world.maps.occupancy import load_map
from tests.ros import session
from tests.ros.selector_game import Game, house, pellet
from tests.ros.session import Session

LOST, FAILS, SILENT = "pose lost", "Nav2 fails", "no odometry"
JUMPED, OTHER = "pose jumped", "another map"
SETTINGS = ("show.start_s=1.0", "show.death_s=1.0", "clyde.speed_mps=0.02")


class Played:
    """A round in the simulated robot's world, with faults."""

    def __init__(self, nodes: Session) -> None:
        self.nodes = nodes
        nodes.record(topics.GAME_STATE, topics.GAME_STATUS, topics.SCORE, topics.DIAGNOSTICS, topics.CMD_VEL)
        assert nodes.call(topics.START_GAME).success
        nodes.wait_for(lambda: "running" in nodes.values(topics.GAME_STATE), 60)
        self.wait(lambda c: c["goals_sent"] > 0, "a goal")

    @property
    def condition(self) -> dict[str, Any]:
        found: dict[str, Any] = json.loads(self.nodes.values(topics.DIAGNOSTICS)[-1])
        return found

    def wait(self, holds: Callable[[dict[str, Any]], Any], what: str, limit_s: float = 60.0) -> dict[str, Any]:
        self.nodes.wait_for(lambda: holds(self.condition), limit_s, what)
        return self.condition

    def fault(self, text: str) -> None:
        self.nodes.publish(FAULT, text)


@pytest.fixture
def played(domain: int, tmp_path: Path) -> Iterator[Played]:
    """A round that has begun, with a Clyde that is no danger."""
    with session.game(tmp_path, settings=SETTINGS, extra={GAME: {"diagnostics_rate": 5.0}}) as nodes:
        yield Played(nodes)


@pytest.mark.parametrize(
    ("fault", "trouble", "text"),
    [
        ("pose_lost", LOST, "pose lost: no transform from map to base_link for 30 s"),
        ("base_silent", SILENT, "no odometry for 30 s: the base is silent"),
    ],
)
def test_cause_of_lost_pose_stops_goals_until_its_end(
    played: Played, log: Callable[[], str], fault: str, trouble: str, text: str
) -> None:
    nodes = played.nodes
    nodes.advance(3.0)
    played.fault(fault)
    condition = played.wait(lambda c: trouble in c["troubles"], "the report")
    sent, statuses = condition["goals_sent"], len(nodes.values(topics.GAME_STATUS))
    nodes.advance(28.0)
    condition = played.condition
    assert (condition["goals_sent"], condition["pursued"], condition["state"]) == (sent, -1, "running")
    assert condition["pose"] is None
    assert len(nodes.values(topics.GAME_STATUS)) == statuses
    assert condition["trouble_texts"][trouble] == text
    assert [one for one in (LOST, SILENT) if one in condition["troubles"]] == [trouble]
    assert log().count("pose lost: no transform") == (fault == "pose_lost")
    played.fault("end")
    condition = played.wait(lambda c: c["goals_sent"] > sent, "the next goal", 5.0)
    assert trouble not in condition["troubles"]
    score = nodes.values(topics.SCORE)[-1]
    nodes.wait_for(lambda: nodes.values(topics.SCORE)[-1] > score, 120, "the next pellet")


def test_node_started_without_pose_waits(game: Game) -> None:
    game.start()
    for _ in range(30):  # the base alone, no localization; the latched pose is of another time
        links = [transform_message("odom", "base_link", (0.0, 0.0, 0.0), game.session.stamp())]
        game.say(topics.TF, topics.TF.type(transforms=links))
        game.session.advance(0.1)
    game.begin()
    condition = game.condition(lambda c: LOST in c["troubles"] and c["task"] == "play")
    assert condition["pose"] is None
    game.session.advance(2.0)
    assert not game.nav2.goals


def test_failing_goals_are_reported_until_one_succeeds(game: Game, log: Callable[[], str]) -> None:
    game.start()
    game.begin()
    for number in range(1, 5):
        game.abort(game.running_goal(number), 208)
    condition = game.condition(lambda c: FAILS in c["troubles"])
    assert condition["trouble_texts"][FAILS] == f"Nav2 aborted 4 goals in a row ({condition['last_error']})"
    assert log().count("goals in a row") == 1
    fifth = game.running_goal(5)
    game.stand(fifth.x, fifth.y)
    game.condition(lambda c: FAILS not in c["troubles"], "the end of the trouble")


def test_failing_goals_are_sent_at_intervals(game: Game) -> None:
    game.start()
    game.begin()
    began_s, number = game.session.now_s, 0
    while game.session.now_s - began_s < 28.0:
        number += 1
        game.abort(game.running_goal(number), 202)
    assert 5 <= number <= 12


def test_preempted_goal_has_not_failed(game: Game) -> None:
    game.start()
    game.begin()
    for slot in (0, 5, 0, 5, 0, 5):  # the nearest pellet changes; the goal before ends aborted
        game.stand(*pellet(slot))
        game.session.advance(2.0)
    assert len(game.nav2.goals) > 3
    assert FAILS not in game.session.node(SELECTOR).once.counts


@pytest.mark.parametrize(
    ("code", "words"),
    [
        *((0, "no error code"), (102, "102 FollowPath TF_ERROR"), (208, "208 ComputePathToPose NO_VALID_PATH")),
        *((723, "723 DriveOnHeading COLLISION_AHEAD"), (4711, "4711")),
    ],
)
def test_error_code_has_its_name(code: int, words: str) -> None:
    assert error_words(code) == words


# A robot that is carried away, and a localization in another map


def carry(played: Played) -> None:
    """The robot is put at the farthest pellet, and localization finds it there."""
    x, y, _ = played.condition["pose"]
    far = max(house().goal_xy[: len(house().pellet_ids)].tolist(), key=lambda at: math.dist(at, (x, y)))
    played.fault(f"kidnap {far[0]} {far[1]} 0")
    played.nodes.advance(0.5)
    played.fault("end kidnap")


def give(played: Played) -> None:
    """A person sets the pose to where localization has it already."""
    pose = played.nodes.node("sim_robot").robot.pose
    played.nodes.publish(topics.INITIAL_POSE, uncertain_pose_message(*pose, played.nodes.stamp()))


def test_carried_robot_stands_until_person_answers(played: Played) -> None:
    nodes = played.nodes
    nodes.advance(3.0)
    score, sent = nodes.values(topics.SCORE)[-1], played.condition["goals_sent"]
    carry(played)
    condition = played.wait(lambda c: JUMPED in c["troubles"], "the report", 5.0)
    assert "which odometry does not explain" in condition["trouble_texts"][JUMPED]
    x, y, heading = nodes.node("sim_robot").robot.pose
    for _ in range(10):  # a ghost beside it catches no robot whose place is not known
        nodes.publish(topics.CLYDE_POSE, pose_message(x, y, heading, nodes.stamp()))
        nodes.advance(0.1)
    nodes.advance(20.0)
    assert "death_detected" not in nodes.values(topics.GAME_STATUS)
    condition = played.condition
    assert condition["goals_sent"] <= sent + 1, "one may have been sent before localization noticed"
    sent = condition["goals_sent"]
    assert condition["pursued"] == -1
    assert nodes.values(topics.SCORE)[-1] <= score + 1
    assert nodes.node("sim_robot").robot.velocity == pytest.approx((0.0, 0.0), abs=0.01)
    give(played)
    condition = played.wait(lambda c: c["goals_sent"] > sent, "the next goal", 5.0)
    assert JUMPED not in condition["troubles"]
    score = nodes.values(topics.SCORE)[-1]
    nodes.wait_for(lambda: nodes.values(topics.SCORE)[-1] > score, 120, "the next pellet")


def test_jump_outlives_killed_game(played: Played) -> None:
    nodes = played.nodes

    def restart() -> None:
        """Kill the game, and start another process in its place."""
        nodes.kill(GAME)
        nodes.clear(topics.DIAGNOSTICS)
        nodes.advance(3.0)
        nodes.start(GAME)
        nodes.wait_for(lambda: nodes.values(topics.DIAGNOSTICS), 30, "the node")

    carry(played)
    played.wait(lambda c: JUMPED in c["troubles"], "the report", 5.0)
    restart()
    nodes.advance(5.0)
    assert JUMPED in played.condition["troubles"]
    assert played.condition["goals_sent"] == 0
    assert nodes.call(topics.CONTINUE).success
    played.wait(lambda c: c["goals_sent"] > 0, "a goal", 5.0)
    restart()
    played.wait(lambda c: c["goals_sent"] > 0, "a goal", 5.0)


def test_nothing_is_sent_while_map_differs(played: Played) -> None:
    nodes = played.nodes
    nodes.advance(2.0)
    nodes.publish(topics.MAP, map_message(load_map("loop"), nodes.stamp()))
    condition = played.wait(lambda c: OTHER in c["troubles"], "the report", 5.0)
    assert condition["trouble_texts"][OTHER].startswith("localization uses another map: size ")
    sent, statuses = condition["goals_sent"], len(nodes.values(topics.GAME_STATUS))
    nodes.advance(10.0)
    assert played.condition["goals_sent"] == sent
    assert len(nodes.values(topics.GAME_STATUS)) == statuses
    nodes.publish(topics.MAP, map_message(load_map("house"), nodes.stamp()))
    condition = played.wait(lambda c: c["goals_sent"] > sent, "the next goal", 5.0)
    assert OTHER not in condition["troubles"]
