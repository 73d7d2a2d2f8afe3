"""A hanging policy does not keep the robot from standing; all faults and keys are in ``campaign/stops.py``."""

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from pacman_env.ros.game_nodes import SELECTOR
from pacman_env.ros.supervisor.up import HAD_TO_KILL
from tests.system.campaign.stops import CTRL_C, POLICY, rows


@pytest.mark.daily
def test_robot_stands_soon_while_policy_hangs(domain: int) -> None:
    played = list(rows(domain, POLICY, "hangs", ("r", CTRL_C)))
    assert [row for row in played if not row.ok] == []
    assert "goal_selector is started again" in played[0].said
    assert played[1].status == HAD_TO_KILL
    assert f"had to be killed: {SELECTOR}" in played[1].said
