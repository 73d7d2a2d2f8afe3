"""Command ``wait_for_amcl_pose``: ends when the robot knows where it is (Algorithm 9), so launch files continue."""

import sys
from collections.abc import Sequence
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from .. import topics
from ..message_conversion import pose_of
from ..node import BaseNode, parameter
from ..process import run

NAME = "wait_for_amcl_pose"
FOUND, NOT_FOUND = 0, 1  # exit status
_STOPPED = -1


class PoseWaiter(BaseNode):
    def __init__(self, **options: Any) -> None:
        super().__init__(NAME, **options)
        self._timeout_s = parameter(self, "timeout_s", 0.0, "give up after this time, s; 0: never", 0.0, 86400.0)
        if self._timeout_s > 0.0:  # wall time: a simulated clock may start with the robot
            self.create_timer(self._timeout_s, self._give_up, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self.listen(topics.AMCL_POSE, self._on_pose, "bad pose")

    def _on_pose(self, message: Any) -> None:
        x, y, theta = pose_of(message)
        self.get_logger().info(f"robot at ({x:.2f}, {y:.2f}), heading {theta:.2f}")
        self.status = FOUND

    def _give_up(self) -> None:
        print(f"{NAME}: no pose on {topics.AMCL_POSE.name} within {self._timeout_s:g} s", file=sys.stderr)
        self.status = NOT_FOUND


def main(argv: Sequence[str] | None = None) -> int:
    """Wait for a pose and return 0; 1 with a line on stderr if none arrives, 2 after a bad start."""
    status = run(PoseWaiter, NAME, argv, stopped=_STOPPED)
    if status == _STOPPED:
        print(f"{NAME}: stopped before a pose arrived", file=sys.stderr)
        return NOT_FOUND
    return status


if __name__ == "__main__":
    sys.exit(main())
