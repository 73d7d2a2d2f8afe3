"""Server of the operator page, which runs in a thread, and the links to the page."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import io
import itertools
import logging
import signal
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import uvicorn
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect
from starlette.routing import WebSocketRoute
from starlette.types import ASGIApp, Receive, Scope, Send
from starlette.websockets import WebSocketDisconnect
from uvicorn.protocols.http.h11_impl import H11Protocol, RequestResponseCycle

from pacman_env.web.access import AccessControl, Name, Tokens, is_loopback, names_of
from pacman_env.web.game import Game
from pacman_env.web.log import Log
from pacman_env.web.messages import MOST_BYTES
from pacman_env.web.routes import STATIC, Routes
from pacman_env.web.sessions import Sessions
from pacman_env.web.viewers import MESSAGES_PER_S

TICK_S = 0.05
REQUEST_S = 120.0  # limit of HTTP requests except uploads
PING_S, PONG_S = 3.0, 5.0  # a page without answers is gone after 8 s
CONNECTIONS = 3  # per viewer: browsers open up to six for the page's files, and close them soon
SPARE_CONNECTIONS = 50
CLOSING_S = 2.0  # for sending the rest when a connection ends
HIGH_WATER = 16 << 10  # bytes; a small buffer gives slow readers newer frames
_WAKE_S = 0.5
MOST_UNSENT = 1 << 20  # for example answers to pings of a client that does not read
_FULL = (
    b"HTTP/1.1 503 Service Unavailable\r\nconnection: close\r\ncontent-length: 26\r\n\r\ntoo many connections here.\n"
)


@dataclass(frozen=True)
class Limits:
    viewers: int = 100
    messages_per_s: float = MESSAGES_PER_S  # per viewer
    headers_s: float = 10.0  # for the headers of a request
    body_s: float = 20.0  # for an upload


class WebServer:
    """Serves the page of a game in a thread; ``with`` starts and closes the server, but not the game."""

    def __init__(
        self,
        game: Game,
        host: str = "127.0.0.1",  # address or host name of this machine; 0.0.0.0: all addresses
        port: int = 0,  # 0: any free port
        *,
        tokens: Tokens | None = None,  # None: new tokens if other machines can reach the page, else no tokens
        names: Iterable[str] = (),  # more accepted host names; for a proxy, the complete address of the page
        write: Callable[[str], None] | None = None,  # writes a line of the log; None: to stderr
        limits: Limits = Limits(),
        static: Path = STATIC,
    ):
        self.host, self.port, self.address = host, port, host
        self.tokens = tokens
        self._game, self._limits, self._static = game, limits, static
        self._names = tuple(map(Name.parse, names))
        self._write = write or partial(print, "pacman-env web:", file=sys.stderr, flush=True)
        self._thread: threading.Thread | None = None
        self._started: Future[tuple[asyncio.AbstractEventLoop, asyncio.Event]] = Future()

    @property
    def url(self) -> str:
        return with_token(link(self.address, self.port), self.tokens.operator if self.tokens else "")

    @property
    def public_url(self) -> str:
        """Address for others, without a token."""
        return next((name.url for name in self._names if name.url), link(self.address, self.port))

    def __enter__(self) -> WebServer:
        self.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def start(self) -> None:
        """Start serving. Raises OSError if the address is in use or does not belong to this machine."""
        bound = bind(self.host, self.port)
        self.address, self.port = bound.getsockname()[:2]
        if self.tokens is None and not (is_loopback(self.address) and all(name.is_local for name in self._names)):
            self.tokens = Tokens.new()

        def run() -> None:
            try:
                asyncio.run(self._serve(bound))
            except BaseException as error:
                if not self._started.done():
                    self._started.set_exception(error)

        self._thread = threading.Thread(target=run, name="web", daemon=True)
        self._thread.start()
        try:
            self._started.result()
        except BaseException as error:
            self._thread.join()
            raise OSError(f"the page cannot be served: {error}") from error

    def close(self) -> None:
        """Close all connections and end the server, within 2 s."""
        if self._thread is None:
            return
        loop, stop = self._started.result()
        with contextlib.suppress(RuntimeError):  # the loop has ended already
            loop.call_soon_threadsafe(stop.set)
        self._thread.join()
        self._thread = None

    async def _serve(self, bound: Any) -> None:
        loop, stop = asyncio.get_running_loop(), asyncio.Event()
        limits = self._limits
        log = Log(self._write, (self.tokens.operator, self.tokens.viewer) if self.tokens else ())

        def log_context(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
            what, error = str(context.get("message", "the server")), context.get("exception")
            if isinstance(error, Exception):
                log.error(what, error)
            else:
                log.add("loop", what)

        loop.set_exception_handler(log_context)
        sessions = Sessions(self._game, log, limits.viewers, limits.messages_per_s)
        routes = Routes(self._game, sessions, log, self._static, limits.body_s)
        application = Starlette(routes=[*routes.all(), WebSocketRoute("/ws", sessions.serve)])
        names = (*map(Name, names_of(self.host, self.address)), *self._names)
        controlled = AccessControl(_bounded(application, log), self.tokens, names, log)
        connections = Connections(CONNECTIONS * limits.viewers + SPARE_CONNECTIONS, limits.headers_s)
        server = uvicorn.Server(_configuration(controlled, connections))
        logging.getLogger("uvicorn.error").addFilter(log.redact)
        serving = loop.create_task(server.serve(sockets=[bound]))
        ticking = loop.create_task(_tick(sessions, connections, log))
        try:
            while not server.started and not serving.done():
                await asyncio.sleep(0.005)
            self._started.set_result((loop, stop))
            stopping = loop.create_task(stop.wait())
            await asyncio.wait((serving, stopping), return_when=asyncio.FIRST_COMPLETED)
            stopping.cancel()
            await sessions.end()
            server.should_exit = True
            for _ in range(2):  # first for slow connections, then for stuck ones
                await asyncio.wait((serving,), timeout=0.4)
                connections.abort_all()
                server.force_exit = True
            await serving
        finally:
            ticking.cancel()
            logging.getLogger("uvicorn.error").removeFilter(log.redact)


def _configuration(application: ASGIApp, connections: Connections) -> uvicorn.Config:
    return uvicorn.Config(
        application,
        http=type("Connection", (LimitedConnection,), {"owner": connections}),
        ws="websockets-sansio",
        lifespan="off",
        log_config=None,
        log_level="critical",  # this server writes its own log
        access_log=False,  # would contain the token
        proxy_headers=False,
        server_header=False,
        ws_max_size=MOST_BYTES,
        ws_ping_interval=PING_S,
        ws_ping_timeout=PONG_S,
        ws_per_message_deflate=False,  # would compress each frame for every viewer
        h11_max_incomplete_event_size=16 << 10,
        timeout_graceful_shutdown=1,
    )


class Connections:
    """Open connections of a server: at most ``most``; as many more get a 503, and further ones are aborted."""

    def __init__(self, most: int, headers_s: float):
        self.most = most
        #: By connection: its state (waits for a request, busy or closes) with its last request, and since when.
        self.open: dict[LimitedConnection, tuple[tuple[str, RequestResponseCycle | None], float]] = {}
        self._headers_s = headers_s  # for the headers of a request

    def end_slow(self) -> None:
        """End connections that do not send their request or do not receive data; must be called twice a second."""
        now = time.monotonic()
        for connection, (previous, since) in list(self.open.items()):
            transport = connection.transport
            unsent = transport.get_write_buffer_size()
            state = "closes" if transport.is_closing() else "waits" if connection.waits_for_request() else "busy"
            if (state, connection.cycle) != previous:  # changed since the last call
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


async def _tick(sessions: Sessions, connections: Connections, log: Log) -> None:
    at = time.monotonic()
    for count in itertools.count(1):
        try:
            await sessions.tick()
            if count % 10 == 0:
                connections.end_slow()
        except Exception as error:
            log.error("a tick", error)
        at = max(at + TICK_S, time.monotonic())  # skip missed ticks
        await asyncio.sleep(at - time.monotonic())


def _bounded(application: ASGIApp, log: Log) -> ASGIApp:
    async def bounded(scope: Scope, receive: Receive, send: Send) -> None:
        try:
            async with asyncio.timeout(REQUEST_S if scope["type"] == "http" else None):
                await application(scope, receive, send)
        except (TimeoutError, ClientDisconnect, WebSocketDisconnect):
            return
        except Exception as error:
            log.error("a request", error)

    return bounded


def serve(
    game: Game,
    host: str = "127.0.0.1",
    port: int = 8000,
    *,
    names: Iterable[str] = (),
    limits: Limits = Limits(),
    opened: Callable[[str], Any] | None = None,  # called with the page's address, such as to open a browser
) -> None:
    """Print the links and serve the page until Ctrl-C or SIGTERM, in the main thread. Raises OSError."""
    ended = threading.Event()
    with WebServer(game, host, port, names=names, limits=limits) as server:
        handlers = {one: signal.signal(one, lambda *_: ended.set()) for one in (signal.SIGINT, signal.SIGTERM)}
        try:
            print(greeting(server.public_url, server.tokens), flush=True)
            if opened is not None:
                opened(server.url)
            while not ended.wait(_WAKE_S):
                pass  # poll, because a signal received by another thread does not end this wait
        finally:
            for number, handler in handlers.items():
                signal.signal(number, handler)


def link(address: str, port: int) -> str:
    shown = shown_address(address)
    return f"http://[{shown}]:{port}/" if ":" in shown else f"http://{shown}:{port}/"


def with_token(url: str, token: str) -> str:
    return f"{url}?token={token}" if token else url


def own_address(family: int = socket.AF_INET) -> str | None:
    """Return the address by which others reach this machine, or None; no packet is sent."""
    target = "192.0.2.1" if family == socket.AF_INET else "2001:db8::1"  # reserved for documentation
    with socket.socket(family, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect((target, 9))
            return str(probe.getsockname()[0])
        except OSError:
            return None


def shown_address(address: str) -> str:
    if address not in ("0.0.0.0", "::"):
        return address
    return own_address(socket.AF_INET6 if ":" in address else socket.AF_INET) or socket.gethostname()


def qr_code(text: str) -> str:
    """Return a QR code for a terminal in half blocks, or "" without the package segno."""
    try:
        import segno
    except ImportError:
        return ""
    out = io.StringIO()
    segno.make(text, error="l", micro=False).terminal(out, compact=True, border=2)
    return out.getvalue().rstrip("\n")


def greeting(url: str, tokens: Tokens | None) -> str:
    if tokens is None:
        return f"The page: {url} (on this computer alone; Ctrl-C ends it)"
    operator = with_token(url, tokens.operator)
    readable = ", and the network can read it (http, not https)" if url.startswith("http:") else ""
    return (
        f"To play and run it: {operator}\n{qr_code(operator)}\n"
        f"To view, and to STOP: {with_token(url, tokens.viewer)}\n"
        f"Anyone with a link can use it{readable}.\nCtrl-C ends the page."
    )


def bind(host: str, port: int) -> socket.socket:
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except (OSError, UnicodeError) as error:
        raise OSError(f"{host}: no such address") from error
    bound = socket.socket(family, kind, protocol)
    try:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 17)  # a small buffer gives slow readers newer frames
        bound.bind(address)
    except OSError as error:
        bound.close()
        reasons = {
            errno.EADDRINUSE: f"port {port} of {host} is in use: choose another port, or 0 for any free one",
            errno.EADDRNOTAVAIL: f"{host} is no address of this computer",
            errno.EACCES: f"port {port} of {host} may not be used: one from 1024 on, or 0 for any that is free",
        }
        raise OSError(reasons.get(error.errno or 0, f"{host}, port {port}: {error.strerror}")) from error
    return bound
