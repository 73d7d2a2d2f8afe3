"""Queues of messages that a node handles together, when it needs them, for topics with a high rate."""

from collections import deque
from collections.abc import Callable
from typing import Any

from pacman_env.ros.surroundings import current


class MessageQueue:
    """Subscription that queues the newest messages, up to the topic's depth.

    ``catch_up`` calls ``handle`` with each message and its waiting time in s of wall time.
    """

    def __init__(self, node: Any, topic: Any, handle: Callable[[Any, float], object]) -> None:
        self._node, self._handle = node, handle
        self._surroundings = current()
        self._waiting: deque[tuple[Any, float]] = deque(maxlen=topic.qos.depth)  # message and arrival, s
        self._subscription = topic.subscription(node, self._receive)

    def catch_up(self) -> None:
        now_s = self._surroundings.monotonic()
        while self._waiting:
            message, arrival_s = self._waiting.popleft()
            self._handle(message, now_s - arrival_s)

    def destroy(self) -> None:
        self._node.destroy_subscription(self._subscription)

    def _receive(self, message: Any) -> None:
        self._waiting.append((message, self._surroundings.monotonic()))
