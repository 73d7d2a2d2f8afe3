"""A navigation that has ``scan``, odometry and ``cmd_vel`` alone drives the simulated base: goals, and a round."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from pacman_env.ros import topics
from pacman_env.ros.messages import pose_message, pose_of
from pacman_env.ros.supervisor.game_nodes import SIMULATOR
from pacman_env.world.navigation.localization import Pose, wrap
from tests.ros import session
from tests.ros.nav2_stand_in import BASE_ONLY, StandIn, StandInGame
from tests.ros.simulated import ABORTED, CANCELED, LEFT, SUCCEEDED, Goal
from tests.sim.robots import RIGHT, rooms

OFF = (0.2, -0.1, 0.1)  # m, m, rad: of the initial pose that is given


class Drive:
    """The base in the two rooms, and the stand-in, which has no pose yet."""

    def __init__(self, nodes: session.Session, seed: int) -> None:
        self.nodes = nodes
        nodes.record(topics.AMCL_POSE, topics.TF, topics.CMD_VEL)
        map_yaml = rooms().save(nodes.folder / "rooms.yaml")
        self.robot = nodes.start(SIMULATOR, map_yaml=map_yaml, seed=seed, **BASE_ONLY).node.robot  # type: ignore[attr-defined]
        self.stand_in: Any = nodes.start("bt_navigator", lambda: StandIn(rooms(), seed=seed)).node
        self.client = topics.NAVIGATE_TO_POSE.client(nodes.observer)
        nodes.advance(1.0)

    def give_pose(self, off: Pose) -> None:
        """As a person does: beside the truth."""
        x, y, heading = self.robot.pose
        stamp = self.nodes.stamp()
        message = topics.INITIAL_POSE.type()
        message.header.frame_id, message.header.stamp = "map", stamp
        message.pose.pose = pose_message(x + off[0], y + off[1], heading + off[2], stamp).pose
        message.pose.covariance[[0, 7, 35]] = (0.25, 0.25, 0.07)  # RViz's
        self.nodes.publish(topics.INITIAL_POSE, message)

    def goal(self, x: float, y: float) -> Goal:
        pose = pose_message(x, y, 0.0, self.nodes.stamp())
        return Goal(self.nodes, self.client, topics.NAVIGATE_TO_POSE.type.Goal(pose=pose))

    def error(self) -> tuple[float, float]:
        """Of the believed pose, m and rad."""
        return error(self.stand_in.amcl.belief, self.robot.pose)


def error(believed: Pose, true: Pose) -> tuple[float, float]:
    return math.dist(believed[:2], true[:2]), abs(wrap(believed[2] - true[2]))


@contextmanager
def drive(folder: Path, seed: int = 0) -> Iterator[Drive]:
    with session.nodes(folder, gives_time=False) as nodes:
        yield Drive(nodes, seed)
        assert nodes.errors() == []


def test_without_an_initial_pose_nothing_is_believed_and_with_one_a_drive_corrects_it(
    domain: int, tmp_path: Path
) -> None:
    with drive(tmp_path) as base:
        assert base.nodes.messages(topics.AMCL_POSE) == []
        assert base.stand_in.amcl.belief is None
        base.give_pose(OFF)
        base.nodes.wait_for(lambda: base.nodes.messages(topics.AMCL_POSE), 2.0, "a pose")
        goal = base.goal(*RIGHT)
        assert goal.end()[0] == SUCCEEDED
        assert math.dist(base.robot.pose[:2], RIGHT) < 0.3 + 0.15
        assert base.error() < (0.15, 0.1)
        assert pose_of(base.nodes.last(topics.AMCL_POSE))[:2] == pytest.approx(base.robot.pose[:2], abs=0.5)


def test_goals_are_replaced_and_cancelled_as_nav2_does(domain: int, tmp_path: Path) -> None:
    with drive(tmp_path) as base:
        base.give_pose((0.0, 0.0, 0.0))
        first = base.goal(*RIGHT)
        assert first.accepted
        base.nodes.advance(3.0)
        second = base.goal(*LEFT)
        status, result = first.end(1.0)
        assert (status, result.error_code) == (ABORTED, 0)
        assert second.end()[0] == SUCCEEDED
        third = base.goal(*RIGHT)
        base.nodes.advance(3.0)
        assert third.cancel() == 1
        assert third.end(1.0)[0] == CANCELED
        base.nodes.advance(1.0)
        assert base.robot.velocity == pytest.approx((0.0, 0.0), abs=1e-3)
        nowhere = base.goal(50.0, 50.0)
        assert nowhere.end(2.0)[1].error_code == 208


@pytest.mark.daily
def test_a_round_is_played_by_velocities_scans_and_odometry_alone(domain: int, tmp_path: Path) -> None:
    extra = {SIMULATOR: dict(BASE_ONLY)}
    with session.game(tmp_path, "house", "ppo", seed=2, extra=extra, kind=StandInGame) as game:
        wanted = (topics.GAME_STATE, topics.GAME_RESULT, topics.GAME_STATUS, topics.SCORE)
        game.record(*wanted, topics.PELLETS_COLLECTED, topics.PELLETS_SPAWNED)
        robot, stand_in = game.node(SIMULATOR).robot, game.node("bt_navigator")
        assert game.call(topics.START_GAME).success
        game.wait_for(lambda: game.values(topics.GAME_STATE)[-1] == "running", 60.0, "the round")
        began_s, apart, turned = game.now_s, [], []
        while game.values(topics.GAME_STATE)[-1] == "running" and game.now_s - began_s < 400.0:
            game.advance(0.05)
            m, rad = error(stand_in.amcl.belief, robot.pose)
            apart.append(m)
            turned.append(rad)
            assert not robot.navigating
        lasted_s = game.now_s - began_s
        reported = [word for word in game.values(topics.GAME_STATUS) if word.startswith("pellet_collected")]
        spawned = game.values(topics.PELLETS_SPAWNED)[-1]
        assert len(set(reported)) == len(reported) == spawned == game.values(topics.PELLETS_COLLECTED)[-1] > 10
        assert game.values(topics.SCORE)[-1] == spawned
        assert game.values(topics.GAME_RESULT)[-1] == f"Complete - Score: {spawned}"
        assert game.errors() == []
        assert game.game.restarts == []
    figures = {
        "round_s": lasted_s,
        "goals": len(stand_in.goals),
        "pose_error_median_m": np.median(apart),
        "pose_error_95_m": np.percentile(apart, 95),
        "heading_error_95_rad": np.percentile(turned, 95),
    }
    print(", ".join(f"{name} {value:.3f}" for name, value in figures.items()))  # pytest -s
    assert figures["pose_error_95_m"] < 0.2
    assert figures["heading_error_95_rad"] < 0.15
