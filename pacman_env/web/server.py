"""Serve the operator page of a game by uvicorn, in its own thread."""

from __future__ import annotations

import asyncio
import logging
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable
from contextlib import ExitStack
from functools import partial
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.middleware import Middleware
from starlette.middleware.gzip import GZipMiddleware
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import WebSocketRoute

from pacman_env.web.access import AccessControl, Name, Tokens, is_local, names_of
from pacman_env.web.address import bind, link, start_text, with_token
from pacman_env.web.game_interface import Game
from pacman_env.web.log import Log
from pacman_env.web.page_messages import MOST_BYTES
from pacman_env.web.routes import Routes
from pacman_env.web.sessions import Sessions

MOST_VIEWERS = 100
CONNECTIONS = 3  # per viewer: browsers open up to six for the page's files, and close them soon
SPARE_CONNECTIONS = 50
PING_S, PONG_S = 3.0, 5.0  # a page without answers is gone after 8 s
_START_S = 0.005  # polling period while the server starts
_WAKE_S = 0.5
_LOGGER = logging.getLogger("uvicorn.error")


class WebServer:
    """Server of the page in its own thread; ``with`` starts and closes it. The caller closes the game."""

    def __init__(
        self,
        game: Game,
        host: str = "127.0.0.1",  # address or host name of this machine; 0.0.0.0: all addresses
        port: int = 0,  # 0: any free port
        *,
        tokens: Tokens | None = None,  # None: new tokens if other machines can reach the page, else no tokens
        names: Iterable[str] = (),  # more accepted host names; for a proxy, the complete address of the page
        write: Callable[[str], None] | None = None,  # writes a line of the log; None: to stderr
        viewers: int = MOST_VIEWERS,  # at the same time
    ):
        self.host, self.port, self.address = host, port, host
        self.tokens = tokens
        self._game, self._viewers = game, viewers
        self._names = tuple(map(Name.parse, names))
        self._write = write or partial(print, "pacman-env web:", file=sys.stderr, flush=True)
        self._opened = ExitStack()

    @property
    def url(self) -> str:
        return with_token(link(self.address, self.port), self.tokens.operator if self.tokens else "")

    @property
    def public_url(self) -> str:
        """Return the address that others use, without a token."""
        proxied = [f"{name.origin}{name.path}/" for name in self._names if name.origin]
        return proxied[0] if proxied else link(self.address, self.port)

    def start(self) -> WebServer:
        """Start to serve. Raises OSError if the address is in use or does not belong to this machine."""
        bound = bind(self.host, self.port)
        self.address, self.port = bound.getsockname()[:2]
        if self.tokens is None and not all(map(is_local, [self.address, *(name.host for name in self._names)])):
            self.tokens = Tokens.new()
        log = Log(self._write, (self.tokens.operator, self.tokens.viewer) if self.tokens else ())
        _LOGGER.addFilter(log.redact)
        self._opened.callback(_LOGGER.removeFilter, log.redact)
        sessions = Sessions(self._game, log, self._viewers)
        server = _Server(self._configuration(sessions, log), sessions)
        thread = threading.Thread(target=server.run, args=([bound],), name="web", daemon=True)
        thread.start()
        self._opened.callback(thread.join)
        self._opened.callback(setattr, server, "should_exit", True)
        while not server.started:
            if not thread.is_alive():
                self.close()
                raise OSError("the page cannot be served")
            time.sleep(_START_S)
        return self

    __enter__ = start

    def close(self) -> None:
        """Close all connections and end the server, within 2 s."""
        self._opened.close()

    def __exit__(self, *error: object) -> None:
        self.close()

    def _configuration(self, sessions: Sessions, log: Log) -> uvicorn.Config:
        async def failed(request: Request, error: Exception) -> Response:
            log.error("a request", error)
            return PlainTextResponse("internal error\n", 500)

        routes = [*Routes(self._game, sessions, log).all(), WebSocketRoute("/ws", sessions.serve)]
        compression = Middleware(GZipMiddleware, compresslevel=6)  # 9 takes longer and saves hardly any bytes
        application = Starlette(routes=routes, middleware=[compression], exception_handlers={Exception: failed})
        names = (*map(Name, names_of(self.host, self.address)), *self._names)
        return uvicorn.Config(
            AccessControl(application, self.tokens, names, log),
            http="h11",
            ws="websockets-sansio",
            loop="asyncio",
            lifespan="off",
            log_config=None,
            log_level="critical",  # this server logs each kind of event once, without addresses
            access_log=False,  # the token would be in it
            proxy_headers=False,
            server_header=False,
            limit_concurrency=CONNECTIONS * self._viewers + SPARE_CONNECTIONS,
            ws_max_size=MOST_BYTES,
            ws_ping_interval=PING_S,
            ws_ping_timeout=PONG_S,
            ws_per_message_deflate=False,  # compression costs more than it saves, because it is done for each viewer
            h11_max_incomplete_event_size=16 << 10,
            timeout_graceful_shutdown=1,
        )


class _Server(uvicorn.Server):
    """Uvicorn server that sends the game to all pages, and a good-bye before it ends."""

    def __init__(self, config: uvicorn.Config, sessions: Sessions):
        super().__init__(config)
        self._sessions = sessions

    async def startup(self, sockets: list[Any] | None = None) -> None:
        self._sessions.spawn(self._sessions.run())
        await super().startup(sockets)

    async def shutdown(self, sockets: list[Any] | None = None) -> None:
        await self._sessions.end()
        await super().shutdown(sockets)
        for connection in list(self.server_state.connections):  # close the connections of clients that do not read
            connection.transport.abort()
        await asyncio.sleep(0)


def serve(
    game: Game,
    host: str = "127.0.0.1",
    port: int = 8000,
    *,
    names: Iterable[str] = (),
    viewers: int = MOST_VIEWERS,
    opened: Callable[[str], Any] | None = None,  # called with the address of the page, for example to open a browser
) -> None:
    """Print the page's links and serve it until Ctrl-C or SIGTERM, in the main thread; OSError for a bad address."""
    ended = threading.Event()
    with WebServer(game, host, port, names=names, viewers=viewers) as server:
        before = {one: signal.signal(one, lambda *_: ended.set()) for one in (signal.SIGINT, signal.SIGTERM)}
        try:
            print(start_text(server.public_url, server.tokens), flush=True)
            if opened is not None:
                opened(server.url)
            while not ended.wait(_WAKE_S):
                pass  # a signal received by another thread does not end this thread's wait
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
