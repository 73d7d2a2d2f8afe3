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
        self.open: dict[LimitedConnection, float | None] = {}  # since when it closes or waits for a request
        self._headers_s = headers_s  # for the head of a request

    def protocol(self) -> type[LimitedConnection]:
        return type("Connection", (LimitedConnection,), {"owner": self})

    def end_slow(self) -> None:
        """End those that do not send their request, or do not receive what is sent to them; called twice a second."""
        now = time.monotonic()
        for connection, since in list(self.open.items()):
            transport = connection.transport
            unsent = transport.get_write_buffer_size()
            waits_s = 0.0 if since is None else now - since
            if transport.is_closing() and unsent == 0:
                del self.open[connection]
            elif unsent > MOST_UNSENT or (transport.is_closing() and waits_s > CLOSING_S):
                transport.abort()
                del self.open[connection]
            elif not transport.is_closing() and not connection.waits_for_request():
                self.open[connection] = None
            elif since is None:
                self.open[connection] = now
            elif not transport.is_closing() and waits_s > self._headers_s:
                transport.close()
                self.open[connection] = now

    def abort_all(self) -> None:
        for connection in self.open:
            connection.transport.abort()
        self.open.clear()


class LimitedConnection(H11Protocol):
    owner: ClassVar[Connections]
    _is_full = False

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        transport.set_write_buffer_limits(high=HIGH_WATER)
        self.owner.open[self] = time.monotonic()
        if len(self.connections) > 2 * self.owner.most:
            transport.abort()
        self._is_full = len(self.connections) > self.owner.most

    def data_received(self, data: bytes) -> None:
        if self._is_full:
            self.transport.write(_FULL)
            self.transport.close()
        else:
            super().data_received(data)

    def waits_for_request(self) -> bool:
        is_websocket = self.transport.get_protocol() is not self
        return not is_websocket and (self.cycle is None or self.cycle.response_complete)
