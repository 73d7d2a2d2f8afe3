"""Command ``wait_for_amcl_pose``: ends when the robot knows where it is (Algorithm 9), for launch files to go on."""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Sequence
from typing import Any

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException

from .. import topics
from ..messages import pose_of
from ..node import BAD_START, GameNode, parameter

NAME = "wait_for_amcl_pose"
FOUND, NOT_FOUND = 0, 1  # exit status
_POLL_S = 0.2


class PoseWaiter(GameNode):
    """Hears the first good pose."""

    def __init__(self) -> None:
        super().__init__(NAME)
        self.found = False
        self.timeout_s = parameter(self, "timeout_s", 0.0, "give up after this time, s; 0: never", 0.0, 86400.0)
        self.listen(topics.AMCL_POSE, self._hear, "bad pose")

    def _hear(self, message: Any) -> None:
        x, y, theta = pose_of(message)
        self.get_logger().info(f"robot at ({x:.2f}, {y:.2f}), heading {theta:.2f}")
        self.found = True


def main(argv: Sequence[str] | None = None) -> int:
    """Wait; 0 when a pose has arrived, 1 with one line on stderr when none has, 2 for a bad start."""
    node = None
    try:
        rclpy.init(args=sys.argv[1:] if argv is None else list(argv))
        node = PoseWaiter()
        # On the wall: a simulated clock may not run before the robot is there.
        end = time.monotonic() + (node.timeout_s or math.inf)
        while not node.found and (left := end - time.monotonic()) > 0:
            rclpy.spin_once(node, timeout_sec=min(left, _POLL_S))
        if node.found:
            return FOUND
        print(f"{NAME}: no pose on {topics.AMCL_POSE.name} within {node.timeout_s:g} s", file=sys.stderr)
        return NOT_FOUND
    except (KeyboardInterrupt, ExternalShutdownException):
        print(f"{NAME}: stopped before a pose arrived", file=sys.stderr)
        return NOT_FOUND
    except (ValueError, ParameterException) as error:
        print(f"{NAME}: {error}", file=sys.stderr)
        return BAD_START
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.try_shutdown()


if __name__ == "__main__":
    sys.exit(main())
