"""Requests of the referee to other nodes, repeated until they are answered; which of them are not answered in time.

A middleware can know a server that receives nothing: being there is no answer. Times are arguments, s.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

AGAIN_S = 2.0  # a service that has not answered by then is called again
CALLS = 3  # without an answer: then it is reported
EFFECT_S = 5.0  # so long a pellet may be shown after its removal
_ABSENT_S = CALLS * AGAIN_S  # without a server


@dataclass
class _Request:
    since_s: float
    calls: int = 0
    due_s: float = -math.inf


class Requests:
    def __init__(self) -> None:
        self._open: dict[str, _Request] = {}  # by service

    def __contains__(self, service: str) -> bool:
        return service in self._open

    def ask(self, service: str, now: float) -> None:
        """Have it called, again if it was before."""
        self._open[service] = _Request(now)

    def answered(self, service: str) -> None:
        self._open.pop(service, None)

    def due(self, now: float, ready: Callable[[str], bool]) -> list[str]:
        """Services to be called now; ``ready``: whether there is a server."""
        found = [name for name, request in sorted(self._open.items()) if now >= request.due_s and ready(name)]
        for name in found:
            request = self._open[name]
            request.calls, request.due_s = request.calls + 1, now + AGAIN_S
        return found

    def unanswered(self, service: str) -> str:
        """What is known of a request that has no answer."""
        calls = self._open[service].calls
        return f"{service}: no answer to {calls} call{'s' if calls > 1 else ''}" if calls else f"{service}: no server"

    def overdue(self, now: float) -> dict[str, str]:
        """Services that should have answered by now, and what is known of them."""
        return {name: self.unanswered(name) for name, request in self._open.items() if self._late(request, now)}

    def _late(self, request: _Request, now: float) -> bool:
        if request.calls:
            return request.calls > CALLS or (request.calls == CALLS and now >= request.due_s)
        return now - request.since_s >= _ABSENT_S


class Removals:
    """Pellets that are shown although they were removed."""

    def __init__(self) -> None:
        self._since_s: float | None = None
        self._pellets: frozenset[int] = frozenset()

    def shown(self, pellets: frozenset[int], now: float) -> None:
        """By the latest report, of those that were collected; to be called often."""
        self._since_s = None if not pellets else now if self._since_s is None else self._since_s
        self._pellets = pellets

    def overdue(self, now: float) -> str:
        """What is wrong; empty while it may still come right."""
        if self._since_s is None or now - self._since_s < EFFECT_S:
            return ""
        return f"remove_pellet: pellet {min(self._pellets)} still shown after {EFFECT_S:g} s"
