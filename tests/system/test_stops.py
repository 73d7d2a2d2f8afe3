"""A hanging policy does not keep the robot from standing; all faults and keys are in ``campaign/stops.py``."""

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from tests.system.campaign.stops import CTRL_C, POLICY, rows


@pytest.mark.daily
def test_robot_stands_soon_while_policy_hangs(domain: int) -> None:
    played = list(rows(domain, POLICY, "hangs", ("r", CTRL_C)))
    assert [row for row in played if not row.ok] == []
    assert [row.status for row in played] == [0, 0], "nothing had to be killed"
