"""What the campaign's recorder makes of messages; the rest of it is seen in the campaign's own test."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("rclpy")

from action_msgs.msg import GoalInfo, GoalStatus, GoalStatusArray
from unique_identifier_msgs.msg import UUID

from eval.campaign.recorder import Recorder
from pacman_env.ros import topics
from pacman_env.ros.simulated_robot.sim_robot import FAULTS_NOW

if TYPE_CHECKING:
    from tests.ros.system import Probe


def test_the_goals_of_a_server_that_goes_are_over(probe: Probe) -> None:
    recorder = Recorder(probe.system.namespace)
    try:
        info = GoalInfo(goal_id=UUID(uuid=[7] * 16))
        running = GoalStatusArray(status_list=[GoalStatus(goal_info=info, status=GoalStatus.STATUS_EXECUTING)])
        assert recorder.resting
        probe.publish(topics.NAVIGATE_TO_POSE.statuses, running)
        assert recorder.wait_for(lambda: not recorder.resting, 15.0)
        probe.publish(FAULTS_NOW, json.dumps(["reject"]))
        assert recorder.wait_for(lambda: recorder.faults == ["reject"], 15.0)
        assert not recorder.resting
        probe.publish(FAULTS_NOW, json.dumps(["nav2_away", "reject"]))
        assert recorder.wait_for(lambda: recorder.resting, 15.0)
    finally:
        recorder.close()
