"""What the campaign's recorder makes of messages; the rest of it is seen in the campaign's own test."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from action_msgs.msg import GoalInfo, GoalStatus, GoalStatusArray
from unique_identifier_msgs.msg import UUID

from pacman_env.ros import topics
from pacman_env.ros.simulated_robot.sim_robot import FAULTS_NOW
from tests.ros import session
from tests.system.campaign.recorder import Recorder


def test_the_goals_of_a_server_that_goes_are_over(domain: int, tmp_path: Path) -> None:
    with session.nodes(tmp_path) as nodes:
        recorder = nodes.start("recorder", Recorder).node
        assert isinstance(recorder, Recorder)
        info = GoalInfo(goal_id=UUID(uuid=[7] * 16))
        running = GoalStatusArray(status_list=[GoalStatus(goal_info=info, status=GoalStatus.STATUS_EXECUTING)])
        assert recorder.resting
        nodes.publish(topics.NAVIGATE_TO_POSE.statuses, running)
        assert not recorder.resting
        nodes.publish(FAULTS_NOW, json.dumps(["reject"]))
        assert recorder.faults == ["reject"]
        assert not recorder.resting
        nodes.publish(FAULTS_NOW, json.dumps(["nav2_away", "reject"]))
        assert recorder.resting


def test_instants_are_in_the_order_of_publication_within_a_step_of_time(domain: int, tmp_path: Path) -> None:
    with session.nodes(tmp_path) as nodes:
        recorder = nodes.start("recorder", Recorder).node
        assert isinstance(recorder, Recorder)
        for word, topic in (
            ("running", topics.GAME_STATE),
            ("pellet", topics.GAME_EVENT),
            ("dying", topics.GAME_STATE),
        ):
            nodes.publish(topic, word)
        nodes.advance(0.05)
        nodes.publish(topics.GAME_EVENT, "death")
        first = recorder.records[0].at
        assert [(r.at - first, r.value) for r in recorder.records] == [
            *((0, "running"), (1, "pellet"), (2, "dying"), (50_000_000, "death")),
        ]
