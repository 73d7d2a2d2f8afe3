"""Queues of messages that a node handles together, when it needs them, for topics with a high rate."""

import time
from collections import deque
from collections.abc import Callable
from typing import Any


class MessageQueue:
    """Subscription that queues the newest messages, up to the topic's depth.

    ``catch_up`` calls ``handle`` with each message and its waiting time, s by ``now_s``.
    """

    def __init__(
        self, node: Any, topic: Any, handle: Callable[[Any, float], object], now_s: Callable[[], float] = time.monotonic
    ) -> None:
        self._node, self._handle, self._now_s = node, handle, now_s
        self._waiting: deque[tuple[Any, float]] = deque(maxlen=topic.qos.depth)  # message and arrival, s
        self._subscription = topic.subscription(node, self._receive)

    def catch_up(self) -> None:
        now_s = self._now_s()
        while self._waiting:
            message, arrival_s = self._waiting.popleft()
            self._handle(message, now_s - arrival_s)

    def _receive(self, message: Any) -> None:
        if now_s := self._now_s():  # 0: a simulated clock has not been received
            self._waiting.append((message, now_s))
