"""The operator's stop: one word that every node which moves the robot obeys, and that outlives whoever said it.

It goes over a latched topic as ``{"stopped", "at", "who", "by"}``, ``by`` the node that says it. Each node that obeys
says what it has heard once more, in its own name: who comes later hears it from any of them, so that a stop holds when
the page that said it is gone, and when one of those nodes is started again. Of two words the later counts, by ``at``:
nanoseconds of the wall's clock, but always more than what was heard before, so that a release counts where clocks
differ; of two at the same time, the stop.
"""

from __future__ import annotations

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
_INSISTS_S = 2.0  # a release that is heard so soon after one's own stop was said before it, by a clock that is ahead


class OperatorStop:
    """Hears and says the word for one node.

    Args:
        node: a ``BaseNode``, or any with ``listen``.
        changed: called with whether the robot is to stand, and who said so, at each change.
        obeys: the node moves the robot, and says again what it has heard.
    """

    def __init__(self, node: Any, changed: Callable[[bool, str], None] | None = None, obeys: bool = True) -> None:
        self._surroundings = current()
        self._changed, self._obeys = changed, obeys
        self._by = node.get_fully_qualified_name()
        self._words: dict[str, tuple[int, bool]] = {}  # of the others
        self._lock = threading.RLock()
        self._last = (0, False)  # when, and what
        self._insists_s = 0.0  # until when
        self.who = ""
        self._publisher = OPERATOR_STOP.publisher(node)
        self._subscription = node.listen(OPERATOR_STOP, self._hear, "bad stop")
        if obeys:
            self._publish()  # who is to stop the robot sees that it is obeyed

    @property
    def stopped(self) -> bool:
        """Whether the robot is to stand."""
        return self._last[1]

    @property
    def known(self) -> bool:
        """Whether anybody else has said anything."""
        return bool(self._words)

    @property
    def obeyed_by(self) -> list[str]:
        """The other nodes that have said the last word again."""
        with self._lock:
            return sorted(by.rpartition("/")[2] for by, word in self._words.items() if word == self._last)

    def say(self, stopped: bool, who: str) -> None:
        """Stop or release, from any thread."""
        with self._lock:
            self._insists_s = self._surroundings.monotonic() + _INSISTS_S if stopped else 0.0
            self._take((max(self._surroundings.time_ns(), self._last[0] + 1), stopped), who)
            self._publish()

    def _publish(self) -> None:
        at, stopped = self._last
        said = {"stopped": stopped, "at": at, "who": self.who, "by": self._by}
        self._publisher.publish(OPERATOR_STOP.type(data=json.dumps(said)))

    def _take(self, word: tuple[int, bool], who: str) -> None:
        was = self.stopped
        self._last, self.who = word, who
        if was != self.stopped and self._changed is not None:
            self._changed(self.stopped, who)

    def _hear(self, message: Any) -> None:
        word, who, by = word_of_stop(message, self._surroundings.time_ns(), self._last[0])
        with self._lock:
            if by == self._by:
                return
            if by in self._words or len(self._words) < _MOST:
                self._words[by] = word
            if word <= self._last:
                return
            if not word[1] and self._surroundings.monotonic() < self._insists_s:
                word, who = (word[0] + 1, True), self.who
            elif not self._obeys:
                self._take(word, who)
                return
            self._take(word, who)
            self._publish()

    def destroy(self, node: Any) -> None:
        """Hear and say no more."""
        node.destroy_subscription(self._subscription)
        node.destroy_publisher(self._publisher)


def word_of_stop(message: Any, now_ns: int, last_ns: int = 0) -> tuple[tuple[int, bool], str, str]:
    """When, whether the robot is to stand, who said so, and which node says it.

    The bare word ``stop`` is one that is said now: somebody has nothing but ROS's own tools at hand.

    Raises:
        BadMessage: it is no such word.
    """
    text = message.data
    if len(text) > _LONGEST:
        raise BadMessage(f"{len(text)} characters: at most {_LONGEST}")
    if text.strip().lower() == "stop":
        return (max(now_ns, last_ns + 1), True), "somebody", ""
    try:
        said = json.loads(text)
        at, stopped, who, by = said["at"], said["stopped"], str(said["who"])[:100], str(said["by"])[:200]
    except (ValueError, TypeError, LookupError, RecursionError):
        raise BadMessage(f"neither a stop nor a release: {text[:100]!r}") from None
    if not (isinstance(stopped, bool) and isinstance(at, int) and 0 <= at < _LATEST):
        raise BadMessage(f"neither a stop nor a release: {text[:100]!r}")
    return (at, stopped), who, by
