"""Queues of messages that are read only when needed, for topics with a high rate.

rclpy needs half a millisecond to wake an executor, whatever the message: at their usual rates, transforms and Nav2's
feedback would cost a node more time than its work with them.
"""

from collections import deque
from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import CallbackGroup

from pacman_env.ros.surroundings import current


class _Unattended(CallbackGroup):
    """Callback group of entities that no executor serves."""

    def can_execute(self, entity: Any) -> bool:
        return False

    def beginning_execution(self, entity: Any) -> bool:
        return False

    def ending_execution(self, entity: Any) -> None:
        pass


class MessageQueue:
    """Subscription that wakes no executor and queues the newest messages, up to the topic's depth.

    ``catch_up`` calls ``handle`` with each message and its waiting time in s of wall time.
    """

    def __init__(self, node: Any, topic: Any, handle: Callable[[Any, float], object]) -> None:
        self._node, self._handle = node, handle
        self._surroundings = current()
        self._waiting: deque[tuple[Any, float]] = deque(maxlen=topic.qos.depth)  # in lock-step: message and arrival
        if self._surroundings.lock_step:  # each message arrives at a simulated time, and waking is free
            self._subscription = topic.subscription(node, self._put)
        else:
            self._subscription = topic.subscription(node, lambda message: None, callback_group=_Unattended())

    def _put(self, message: Any) -> None:
        self._waiting.append((message, self._surroundings.monotonic()))

    def catch_up(self) -> None:
        now_s = self._surroundings.monotonic()
        while self._waiting:
            message, arrival_s = self._waiting.popleft()
            self._handle(message, now_s - arrival_s)
        if self._surroundings.lock_step:
            return
        with self._subscription.handle:
            while item := self._subscription.handle.take_message(self._subscription.msg_type, False):
                message, info = item
                received_ns = info["received_timestamp"]  # 0 if the middleware does not report it
                wait_ns = self._surroundings.time_ns() - received_ns if received_ns else 0
                self._handle(message, max(0.0, wait_ns * 1e-9))

    def destroy(self) -> None:
        self._node.destroy_subscription(self._subscription)
