"""A robot that is carried away, and a localization in another map: nothing is sent or counted until that is settled."""

from __future__ import annotations

import math

import pytest

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import GAME
from pacman_env.ros.message_conversion import pose_message, uncertain_pose_message
from pacman_env.ros.simulated_robot.sim_sensors import map_message
from pacman_env.world.maps.occupancy import load_map
from tests.ros.played_round import Played
from tests.ros.selector_game import house

JUMPED, OTHER = "pose jumped", "another map"


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
