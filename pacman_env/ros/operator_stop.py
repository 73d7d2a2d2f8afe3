"""The operator's stop: a request that every node which moves the robot obeys, and that outlives its sender.

It is JSON on a latched topic: ``stopped``, ``at``, ``who``, ``by`` (the publishing node)."""

import threading
import time
from collections.abc import Callable
from typing import Annotated, Any

import msgspec
from msgspec import Meta

from .message_conversion import BadMessage
from .topics import OPERATOR_STOP

_LONGEST = 1000  # characters
_MOST = 100  # most nodes whose last request is stored
#: A release within this time after this node's stop is ignored: it may be older, with a time of a clock that is ahead.
_INSISTS_S = 2.0


class _Request(msgspec.Struct):
    at: Annotated[int, Meta(ge=0, lt=2**62)]  # ns
    stopped: bool
    who: str  # person
    by: str = ""  # publishing node


class OperatorStop:
    """Receive and publish the request for one node, which needs the method ``listen`` of ``BaseNode``.

    A node that obeys publishes received requests again, so that nodes started later get them even if the sender is
    gone. The request with the largest ``at`` counts; if two are equal, the stop. ``at`` is wall time in ns, but always
    more than the last received value, so that a release counts even if clocks differ. If ``obeys`` is False, the node
    only observes and sends requests.
    """

    def __init__(self, node: Any, changed: Callable[[bool, str], None] | None = None, obeys: bool = True) -> None:
        self._changed, self._obeys = changed, obeys
        self._by = node.get_fully_qualified_name()
        self._received: dict[str, tuple[int, bool]] = {}  # by other node: its last request
        self._lock = threading.RLock()
        self._last = (0, False)  # time (ns), and True for a stop
        self._insists_s = 0.0  # releases are ignored until this time
        self.who = ""
        self._publisher = OPERATOR_STOP.publisher(node)
        self._subscription = node.listen(OPERATOR_STOP, self._on_message, "bad stop")
        if obeys:
            self._publish()  # tells the sender of a stop that this node obeys

    @property
    def stopped(self) -> bool:
        return self._last[1]

    @property
    def known(self) -> bool:
        """Return True if any other node has published a request."""
        return bool(self._received)

    @property
    def obeyed_by(self) -> list[str]:
        """Names of the other nodes that have repeated the last request."""
        with self._lock:
            return sorted(by.rpartition("/")[2] for by, request in self._received.items() if request == self._last)

    @property
    def obeyed_by_all(self) -> bool:
        """True if every other node that has ever published a request has repeated the last request."""
        with self._lock:
            return all(request == self._last for request in self._received.values())

    def request(self, stopped: bool, who: str, insists: bool = True) -> None:
        """Stop or release the robot; may be called in any thread. A stop that ``insists`` ignores older releases."""
        with self._lock:
            self._insists_s = time.monotonic() + _INSISTS_S if stopped and insists else 0.0
            self._apply((max(time.time_ns(), self._last[0] + 1), stopped), who)
            self._publish()

    def _publish(self) -> None:
        content = msgspec.json.encode(_Request(*self._last, self.who, self._by))
        self._publisher.publish(OPERATOR_STOP.type(data=content.decode()))

    def _apply(self, request: tuple[int, bool], who: str) -> None:
        previous = self.stopped
        self._last, self.who = request, who
        if previous != self.stopped and self._changed is not None:
            self._changed(self.stopped, who)

    def _on_message(self, message: Any) -> None:
        text, last_ns = message.data, self._last[0]
        if len(text) > _LONGEST:
            raise BadMessage(f"{len(text)} characters: at most {_LONGEST}")
        if text.strip().lower() == "stop":  # published by hand with ROS's tools
            received = _Request(max(time.time_ns(), last_ns + 1), True, "another program")
        else:
            try:
                received = msgspec.json.decode(text, type=_Request)
            except (msgspec.DecodeError, RecursionError):
                raise BadMessage(f"neither a stop nor a release: {text[:100]!r}") from None
        request, who, by = (received.at, received.stopped), received.who[:100], received.by[:200]
        with self._lock:
            if by == self._by:
                return
            if by in self._received or len(self._received) < _MOST:
                self._received[by] = request
            if request <= self._last:
                return
            insists = not received.stopped and time.monotonic() < self._insists_s
            if insists:
                request, who = (received.at + 1, True), self.who
            self._apply(request, who)
            if insists or self._obeys:
                self._publish()
