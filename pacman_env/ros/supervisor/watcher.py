"""Node ``watcher``: halts the robot at once if the game on this machine dies or is frozen, and ends a frozen game.

The process that started the game (``ros up``, the launch file) starts it again. The watcher runs no code of a game.
"""

import contextlib
import os
import signal
import sys
import time
from functools import partial
from typing import Any

from rclpy.clock import Clock
from rclpy.clock_type import ClockType

from pacman_env.ros import topics
from pacman_env.ros.discovery import domain_of
from pacman_env.ros.heartbeat import Listener, is_running, watcher_address
from pacman_env.ros.node import BaseNode
from pacman_env.ros.process import run

NAME = "watcher"
_PERIOD_S = 0.1
_END_S = 0.5  # until a frozen game is ended here: ``ros up``, if there is one, does it at once and says so
_HALTS = 10  # repetitions, because a goal of the dead game may be accepted a moment later


class Watcher(BaseNode):
    def __init__(self, **options: Any) -> None:
        super().__init__(NAME, **options)
        address = watcher_address(self.get_namespace(), domain_of(os.environ.get("ROS_DOMAIN_ID", "")))
        try:
            self._listener = Listener(address)
        except OSError as error:
            raise ValueError(f"another watcher runs for {self.get_namespace()} on this machine") from error
        self._cmd_vel = topics.CMD_VEL.publisher(self)
        self._cancel = topics.cancel_client(self, topics.NAVIGATE_TO_POSE.name)
        self._halts = 0  # repetitions that are left
        self._frozen: dict[int, float] = {}  # by process: when it is ended
        self.create_timer(_PERIOD_S, self._look, clock=Clock(clock_type=ClockType.STEADY_TIME))

    def destroy_node(self) -> None:
        """Destroy the node and free its address."""
        self._listener.close()
        super().destroy_node()

    def _look(self) -> None:
        for pid, silent_s in self._listener.lost().items():
            words = f"is frozen, no heartbeat for {silent_s:.0f} s" if silent_s else "has died"
            self.get_logger().warning(f"the game, process {pid}, {words}: the robot is halted")
            self._halts = _HALTS
            if is_running(pid):
                self._frozen[pid] = time.monotonic() + _END_S
        for pid in [pid for pid, due_s in self._frozen.items() if time.monotonic() >= due_s]:
            del self._frozen[pid]
            with contextlib.suppress(ProcessLookupError, PermissionError):
                os.kill(pid, signal.SIGKILL)
        if self._halts:
            self._halts -= 1
            self._halt()

    def _halt(self) -> None:
        """Cancel all goals in Nav2, also goals of other programs, and command zero velocity."""
        self._cmd_vel.publish(topics.CMD_VEL.type())
        if self._cancel.service_is_ready():
            self._cancel.call_async(self._cancel.srv_type.Request())  # all zero: every goal


main = partial(run, Watcher, NAME)

if __name__ == "__main__":
    sys.exit(main())
