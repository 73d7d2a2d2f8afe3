"""Messages that wait until they are needed, for topics whose messages come far more often than that.

Each waking of an executor costs rclpy half a millisecond, whatever the message: transforms and Nav2's feedback at their
usual rates would keep a node busier than all that it does with them.
"""

from collections import deque
from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import CallbackGroup

from pacman_env.ros.surroundings import current


class _Unattended(CallbackGroup):
    """Of entities that no executor attends to."""

    def can_execute(self, entity: Any) -> bool:
        return False

    def beginning_execution(self, entity: Any) -> bool:
        return False

    def ending_execution(self, entity: Any) -> None:
        pass


class MessageQueue:
    """A subscription that wakes no executor; of more messages than the topic's depth the newest wait.

    ``handle`` is called with each message and how long it has waited, s of wall time.
    """

    def __init__(self, node: Any, topic: Any, handle: Callable[[Any, float], object]) -> None:
        self._node, self._handle = node, handle
        self._surroundings = current()
        self._waiting: deque[tuple[Any, float]] = deque(maxlen=topic.qos.depth)  # of a lock-step game, with arrival
        if self._surroundings.lock_step:  # where each message comes at a simulated moment, and waking costs nothing
            self._subscription = topic.subscription(node, self._put)
        else:
            self._subscription = topic.subscription(node, lambda message: None, callback_group=_Unattended())

    def _put(self, message: Any) -> None:
        self._waiting.append((message, self._surroundings.monotonic()))

    def catch_up(self) -> None:
        now_s = self._surroundings.monotonic()
        while self._waiting:
            message, arrived_s = self._waiting.popleft()
            self._handle(message, now_s - arrived_s)
        if self._surroundings.lock_step:
            return
        with self._subscription.handle:
            while received := self._subscription.handle.take_message(self._subscription.msg_type, False):
                message, info = received
                received_ns = info["received_timestamp"]  # 0 if the middleware does not report it
                waited_ns = self._surroundings.time_ns() - received_ns if received_ns else 0
                self._handle(message, max(0.0, waited_ns * 1e-9))

    def destroy(self) -> None:
        self._node.destroy_subscription(self._subscription)
