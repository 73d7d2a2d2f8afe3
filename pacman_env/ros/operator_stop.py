"""The operator's stop: one request that every node which moves the robot obeys, and that outlives its sender.

It is JSON on a latched topic: ``stopped``, ``at``, ``who``, ``by`` (the publishing node)."""

import json
import threading
from collections.abc import Callable
from typing import Any

from .messages import BadMessage
from .surroundings import current
from .topics import OPERATOR_STOP

_LONGEST = 1000  # characters
_MOST = 100  # nodes that are remembered
_LATEST = 2**62  # ns
_INSISTS_S = 2.0  # a release received so soon after one's own stop was sent before it, by a clock that is ahead


class OperatorStop:
    """Receives and publishes the request for one node, a ``BaseNode`` or any with ``listen``.

    A node that obeys publishes again what it has received: the request holds for nodes that start later, when its
    sender is gone. Of two requests the later counts, by ``at``: nanoseconds of the wall's clock, but always more than
    what was received before, so that a release counts where clocks differ; of two at the same time, the stop.
    """

    def __init__(self, node: Any, changed: Callable[[bool, str], None] | None = None, obeys: bool = True) -> None:
        self._surroundings = current()
        self._changed, self._obeys = changed, obeys
        self._by = node.get_fully_qualified_name()
        self._received: dict[str, tuple[int, bool]] = {}  # by other node: its last request
        self._lock = threading.RLock()
        self._last = (0, False)  # when (ns), and whether the robot is to stand
        self._insists_s = 0.0  # until when
        self.who = ""
        self._publisher = OPERATOR_STOP.publisher(node)
        self._subscription = node.listen(OPERATOR_STOP, self._on_message, "bad stop")
        if obeys:
            self._publish()  # the sender of a stop sees that it is obeyed

    @property
    def stopped(self) -> bool:
        return self._last[1]

    @property
    def known(self) -> bool:
        """Whether any other node has published a request."""
        return bool(self._received)

    @property
    def obeyed_by(self) -> list[str]:
        """The other nodes that have published the last request again."""
        with self._lock:
            return sorted(by.rpartition("/")[2] for by, request in self._received.items() if request == self._last)

    @property
    def obeyed_by_all(self) -> bool:
        """Whether every other node that has published any request has published the last one."""
        with self._lock:
            return all(request == self._last for request in self._received.values())

    def request(self, stopped: bool, who: str) -> None:
        """Stop or release, from any thread."""
        with self._lock:
            self._insists_s = self._surroundings.monotonic() + _INSISTS_S if stopped else 0.0
            self._apply((max(self._surroundings.time_ns(), self._last[0] + 1), stopped), who)
            self._publish()

    def _publish(self) -> None:
        at, stopped = self._last
        content = {"stopped": stopped, "at": at, "who": self.who, "by": self._by}
        self._publisher.publish(OPERATOR_STOP.type(data=json.dumps(content)))

    def _apply(self, request: tuple[int, bool], who: str) -> None:
        was = self.stopped
        self._last, self.who = request, who
        if was != self.stopped and self._changed is not None:
            self._changed(self.stopped, who)

    def _on_message(self, message: Any) -> None:
        request, who, by = _request_of(message, self._surroundings.time_ns(), self._last[0])
        with self._lock:
            if by == self._by:
                return
            if by in self._received or len(self._received) < _MOST:
                self._received[by] = request
            if request <= self._last:
                return
            insists = not request[1] and self._surroundings.monotonic() < self._insists_s
            if insists:
                request, who = (request[0] + 1, True), self.who
            self._apply(request, who)
            if insists or self._obeys:
                self._publish()

    def destroy(self, node: Any) -> None:
        node.destroy_subscription(self._subscription)
        node.destroy_publisher(self._publisher)


def _request_of(message: Any, now_ns: int, last_ns: int) -> tuple[tuple[int, bool], str, str]:
    """When and whether the robot is to stand; who requested it; which node publishes it."""
    text = message.data
    if len(text) > _LONGEST:
        raise BadMessage(f"{len(text)} characters: at most {_LONGEST}")
    if text.strip().lower() == "stop":  # by ROS's own tools
        return (max(now_ns, last_ns + 1), True), "another program", ""
    try:
        content = json.loads(text)
        at, stopped, who, by = (content[name] for name in ("at", "stopped", "who", "by"))
        if isinstance(stopped, bool) and isinstance(at, int) and 0 <= at < _LATEST:
            return (at, stopped), str(who)[:100], str(by)[:200]
    except (ValueError, TypeError, LookupError, RecursionError):
        pass
    raise BadMessage(f"neither a stop nor a release: {text[:100]!r}")
