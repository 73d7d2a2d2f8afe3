"""Limits that uvicorn leaves open: how many connections there are, how long a request and a close may take."""

from __future__ import annotations

import asyncio
import time
from typing import ClassVar

from uvicorn.protocols.http.h11_impl import H11Protocol

CLOSING_S = 2.0  # for what is still to be sent on a connection that ends
HIGH_WATER = 16 << 10  # bytes; a slow reader gets a newer frame the sooner
MOST_UNSENT = 1 << 20  # such as answers to pings of a client that reads nothing
_FULL = (
    b"HTTP/1.1 503 Service Unavailable\r\nconnection: close\r\ncontent-length: 26\r\n\r\ntoo many connections here.\n"
)


class Connections:
    """All of a server: ``most`` at once; as many more get a 503, further ones are aborted."""

    def __init__(self, most: int, headers_s: float):
        self.most = most
        self.headers_s = headers_s  # for the head of a request
        self._closing: dict[asyncio.Transport, float | None] = {}  # since when, None: open

    def add(self, transport: asyncio.Transport) -> None:
        transport.set_write_buffer_limits(high=HIGH_WATER)
        self._closing[transport] = None

    def abort_slow(self) -> None:
        """Abort those that do not receive what is sent to them; called twice a second."""
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

    def abort_all(self) -> None:
        for transport in self._closing:
            transport.abort()
        self._closing.clear()

    def protocol(self) -> type[LimitedConnection]:
        return type("Connection", (LimitedConnection,), {"all": self})


class LimitedConnection(H11Protocol):
    all: ClassVar[Connections]
    _timer: asyncio.TimerHandle | None = None
    _is_full = False

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self.all.add(transport)
        if len(self.connections) > 2 * self.all.most:
            transport.abort()
            return
        self._is_full = len(self.connections) > self.all.most
        self._set_timer()

    def data_received(self, data: bytes) -> None:
        if self._is_full:
            self.transport.write(_FULL)
            self.transport.close()
            return
        super().data_received(data)
        self._set_timer()

    def connection_lost(self, exc: Exception | None) -> None:
        self._cancel_timer()
        super().connection_lost(exc)

    def _waits_for_request(self) -> bool:
        is_websocket = self.transport.get_protocol() is not self
        return not is_websocket and (self.cycle is None or self.cycle.response_complete)

    def _set_timer(self) -> None:
        if self.transport.is_closing() or not self._waits_for_request():
            self._cancel_timer()
        elif self._timer is None:
            self._timer = self.loop.call_later(self.all.headers_s, self._time_out)

    def _cancel_timer(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None

    def _time_out(self) -> None:
        self._timer = None
        if self._waits_for_request():
            self.transport.close()
