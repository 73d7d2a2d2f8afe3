"""Messages that wait until somebody looks, for what comes far more often than it is looked at.

Each waking of an executor costs rclpy half a millisecond, whatever the message: transforms and Nav2's feedback at their
usual rates would keep a node busier than all that it does with them.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.callback_groups import CallbackGroup


class _Nobody(CallbackGroup):
    """Of entities that no executor attends to."""

    def can_execute(self, entity: Any) -> bool:
        """Never."""
        return False

    def beginning_execution(self, entity: Any) -> bool:
        """Never."""
        return False

    def ending_execution(self, entity: Any) -> None:
        """Nothing to do."""


class MessageQueue:
    """A subscription that wakes nobody.

    Args:
        node: of rclpy.
        topic: one of ``topics.py``; of more messages than its depth the newest wait.
        take: called with each message and how long it has waited, s of wall time.
    """

    def __init__(self, node: Any, topic: Any, take: Callable[[Any, float], object]) -> None:
        self._node, self._take = node, take
        self._subscription = topic.subscription(node, lambda message: None, callback_group=_Nobody())

    def catch_up(self) -> None:
        """Take what waits."""
        with self._subscription.handle:
            while taken := self._subscription.handle.take_message(self._subscription.msg_type, False):
                message, info = taken
                received_ns = info["received_timestamp"]  # 0 where the middleware does not say
                self._take(message, max(0.0, (time.time_ns() - received_ns) * 1e-9) if received_ns else 0.0)

    def destroy(self) -> None:
        """Take no more."""
        self._node.destroy_subscription(self._subscription)
