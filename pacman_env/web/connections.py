"""Limits that uvicorn leaves open: how many connections there are, how long a request and a close may take."""

from __future__ import annotations

import asyncio
import time
from typing import ClassVar

from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle

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
        #: Whether it waits for a request, is busy or closes; its last request; since when.
        self.open: dict[LimitedConnection, tuple[tuple[str, RequestResponseCycle | None], float]] = {}
        self._headers_s = headers_s  # for the head of a request

    def protocol(self) -> type[LimitedConnection]:
        return type("Connection", (LimitedConnection,), {"owner": self})

    def end_slow(self) -> None:
        """End those that do not send their request, or do not receive what is sent to them; called twice a second."""
        now = time.monotonic()
        for connection, (before, since) in list(self.open.items()):
            transport = connection.transport
            unsent = transport.get_write_buffer_size()
            state = "closes" if transport.is_closing() else "waits" if connection.waits_for_request() else "busy"
            if (state, connection.cycle) != before:  # since the last sweep, also by another request
                since = now
                self.open[connection] = (state, connection.cycle), since
            if state == "closes" and unsent == 0:
                del self.open[connection]
            elif unsent > MOST_UNSENT or (state == "closes" and now - since > CLOSING_S):
                transport.abort()
                del self.open[connection]
            elif state == "waits" and now - since > self._headers_s:
                transport.close()

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
        self.owner.open[self] = ("waits", None), time.monotonic()
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
