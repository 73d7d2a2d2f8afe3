"""Track requests of the referee to other nodes: repeat them until they are answered, and report overdue ones.

A server may be discovered but receive nothing, so its existence is no answer. Times are arguments, in s.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

AGAIN_S = 2.0  # a service without an answer is called again after this time
CALLS = 3  # a service is reported after this many calls without an answer
EFFECT_S = 5.0  # a pellet may be shown for this long after its removal
_ABSENT_S = CALLS * AGAIN_S  # a missing server is reported after this time


@dataclass
class _Request:
    since_s: float
    calls: int = 0
    due_s: float = -math.inf


class Requests:
    def __init__(self) -> None:
        self._open: dict[str, _Request] = {}

    def __contains__(self, service: str) -> bool:
        return service in self._open

    def ask(self, service: str, now: float) -> None:
        """Request a call of a service, even if it was called before."""
        self._open[service] = _Request(now)

    def answered(self, service: str) -> None:
        self._open.pop(service, None)

    def due(self, now: float, ready: Callable[[str], bool]) -> list[str]:
        """Return the services to call now and count the calls; ``ready(name)`` is True if there is a server."""
        services = [name for name, request in sorted(self._open.items()) if now >= request.due_s and ready(name)]
        for name in services:
            request = self._open[name]
            request.calls, request.due_s = request.calls + 1, now + AGAIN_S
        return services

    def unanswered(self, service: str) -> str:
        """Return a description of the request to a service that has not answered."""
        calls = self._open[service].calls
        return f"{service}: no answer to {calls} call{'s' if calls > 1 else ''}" if calls else f"{service}: no server"

    def overdue(self, now: float) -> dict[str, str]:
        """Return the services that should have answered by now, each with a description."""
        return {name: self.unanswered(name) for name, request in self._open.items() if self._late(request, now)}

    def _late(self, request: _Request, now: float) -> bool:
        if request.calls:
            return request.calls > CALLS or (request.calls == CALLS and now >= request.due_s)
        return now - request.since_s >= _ABSENT_S


class Removals:
    """Track collected pellets that are still shown."""

    def __init__(self) -> None:
        self._since_s: float | None = None
        self._pellets: frozenset[int] = frozenset()

    def shown(self, pellets: frozenset[int], now: float) -> None:
        """Record the collected pellets in the latest report; must be called for every report."""
        self._since_s = None if not pellets else now if self._since_s is None else self._since_s
        self._pellets = pellets

    def overdue(self, now: float) -> str:
        """Describe a collected pellet that is still shown after ``EFFECT_S``; return "" if there is none."""
        if self._since_s is None or now - self._since_s < EFFECT_S:
            return ""
        return f"remove_pellet: pellet {min(self._pellets)} still shown after {EFFECT_S:g} s"
