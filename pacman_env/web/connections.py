"""How many connections there are, and how long one may take: what uvicorn leaves to whoever uses it."""

from __future__ import annotations

import asyncio
import time
from typing import ClassVar

from uvicorn.protocols.http.h11_impl import H11Protocol

HEADERS_S = 10.0  # until a request is there
CLOSING_S = 2.0  # for what is still to be sent on a connection that ends
HIGH_WATER = 16 << 10  # bytes; a reader that is behind sees a newer frame the sooner
MOST_UNSENT = 1 << 20  # such as answers to pings of somebody who reads nothing
_FULL = (
    b"HTTP/1.1 503 Service Unavailable\r\nconnection: close\r\ncontent-length: 26\r\n\r\ntoo many connections here.\n"
)


class Door:
    """All connections of a server.

    Args:
        most: at once; twice as many are told that it is full, further ones are cut off.
        headers_s: how long a request's head may take.
    """

    def __init__(self, most: int, headers_s: float = HEADERS_S):
        self.most = most
        self.headers_s = headers_s
        self._closing: dict[asyncio.Transport, float | None] = {}

    def enter(self, transport: asyncio.Transport) -> None:
        """One more connection."""
        transport.set_write_buffer_limits(high=HIGH_WATER)
        self._closing[transport] = None

    def sweep(self) -> None:
        """Cut off who does not take what is sent to him; called now and then."""
        now = time.monotonic()
        for transport, since in list(self._closing.items()):
            unsent = transport.get_write_buffer_size()
            if transport.is_closing() and unsent == 0:
                del self._closing[transport]
            elif unsent > MOST_UNSENT or (since is not None and now - since > CLOSING_S):
                transport.abort()
                del self._closing[transport]
            elif transport.is_closing() and since is None:
                self._closing[transport] = now

    def cut(self) -> None:
        """Cut off everybody: the server ends."""
        for transport in self._closing:
            transport.abort()
        self._closing.clear()


class Connection(H11Protocol):
    """A connection whose requests have to come within a time, and that is refused where there are too many."""

    door: ClassVar[Door]
    _timer: asyncio.TimerHandle | None = None
    _is_full = False

    @classmethod
    def of(cls, door: Door) -> type[Connection]:
        """The class of the connections that come through a door."""
        return type("Connection", (cls,), {"door": door})

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        """One more is there."""
        super().connection_made(transport)
        self.door.enter(transport)
        if len(self.connections) > 2 * self.door.most:
            transport.abort()
            return
        self._is_full = len(self.connections) > self.door.most
        self._mind_time()

    def data_received(self, data: bytes) -> None:
        """A piece of a request."""
        if self._is_full:
            self.transport.write(_FULL)
            self.transport.close()
            return
        super().data_received(data)
        self._mind_time()

    def connection_lost(self, exc: Exception | None) -> None:
        """It is gone."""
        self._forget_time()
        super().connection_lost(exc)

    def _mind_time(self) -> None:
        waits = self.cycle is None or self.cycle.response_complete
        if not waits or self.transport.is_closing() or self.transport.get_protocol() is not self:  # a websocket now
            self._forget_time()
        elif self._timer is None:
            self._timer = self.loop.call_later(self.door.headers_s, self._too_late)

    def _forget_time(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _too_late(self) -> None:
        self._timer = None
        waits = self.cycle is None or self.cycle.response_complete
        if waits and self.transport.get_protocol() is self:
            self.transport.close()
