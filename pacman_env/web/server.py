"""The server of the operator's page: uvicorn in a thread of its own, over a game."""

from __future__ import annotations

import asyncio
import logging
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import PlainTextResponse, Response
from starlette.routing import WebSocketRoute
from starlette.types import ASGIApp

from pacman_env.web.access import AccessControl, Name, Tokens, is_loopback, names_of
from pacman_env.web.address import bind, greeting, link, with_token
from pacman_env.web.game import Game
from pacman_env.web.log import Log
from pacman_env.web.messages import MOST_BYTES
from pacman_env.web.routes import STATIC, Routes
from pacman_env.web.sessions import Sessions

MOST_VIEWERS = 100
CONNECTIONS = 3  # for each viewer: a browser opens up to six for the page's files, and soon closes them
SPARE_CONNECTIONS = 50
PING_S, PONG_S = 3.0, 5.0  # a page that does not answer is gone after 8 s
_START_S = 0.005  # between two looks whether the server has started
_WAKE_S = 0.5
_LOGGER = logging.getLogger("uvicorn.error")


class WebServer:
    """The page over a game, which the caller closes, in a thread of its own; ``with`` starts and closes it."""

    def __init__(
        self,
        game: Game,
        host: str = "127.0.0.1",  # an address of this machine, or a name of one; 0.0.0.0: all of them
        port: int = 0,  # 0: any that is free
        *,
        tokens: Tokens | None = None,  # None: new ones if other machines reach the address or a name, else none
        names: Iterable[str] = (),  # accepted as Host beside the address; of a proxy the whole address of the page
        write: Callable[[str], None] | None = None,  # a line of the log; to stderr if not given
        viewers: int = MOST_VIEWERS,  # at once
        static: Path = STATIC,
    ):
        self.host, self.port, self.address = host, port, host
        self.tokens = tokens
        self._game, self._viewers, self._static = game, viewers, static
        self._names = tuple(map(Name.parse, names))
        self._write = write or partial(print, "pacman-env web:", file=sys.stderr, flush=True)
        self._log: Log | None = None
        self._server: _Server | None = None
        self._thread: threading.Thread | None = None

    @property
    def url(self) -> str:
        return with_token(link(self.address, self.port), self.tokens.operator if self.tokens else "")

    @property
    def public_url(self) -> str:
        """The address that others use, without a token."""
        return next((name.url for name in self._names if name.url), link(self.address, self.port))

    def __enter__(self) -> WebServer:
        self.start()
        return self

    def __exit__(self, *error: object) -> None:
        self.close()

    def start(self) -> None:
        """Serve from now on. Raises OSError if the address is in use, or none of this machine's."""
        bound = bind(self.host, self.port)
        self.address, self.port = bound.getsockname()[:2]
        if self.tokens is None and not (is_loopback(self.address) and all(name.is_local for name in self._names)):
            self.tokens = Tokens.new()
        self._log = log = Log(self._write, (self.tokens.operator, self.tokens.viewer) if self.tokens else ())
        _LOGGER.addFilter(log.redact)
        sessions = Sessions(self._game, log, self._viewers)
        self._server = server = _Server(self._configuration(sessions, log), sessions)
        self._thread = threading.Thread(target=server.run, args=([bound],), name="web", daemon=True)
        self._thread.start()
        while not server.started:
            if not self._thread.is_alive():
                raise OSError("the page cannot be served")
            time.sleep(_START_S)

    def close(self) -> None:
        """Close every page's connection and end; it takes 2 s at most."""
        if self._thread is None or self._server is None or self._log is None:
            return
        self._server.should_exit = True
        self._thread.join()
        self._thread = None
        _LOGGER.removeFilter(self._log.redact)

    def _configuration(self, sessions: Sessions, log: Log) -> uvicorn.Config:
        async def failed(request: Request, error: Exception) -> Response:
            log.error("a request", error)
            return PlainTextResponse("internal error\n", 500)

        routes = Routes(self._game, sessions, log, self._static)
        application: ASGIApp = Starlette(
            routes=[*routes.all(), WebSocketRoute("/ws", sessions.serve)], exception_handlers={Exception: failed}
        )
        names = (*map(Name, names_of(self.host, self.address)), *self._names)
        config = uvicorn.Config(
            AccessControl(application, self.tokens, names, log),
            http="h11",
            ws="websockets-sansio",
            loop="asyncio",
            lifespan="off",
            log_config=None,
            log_level="critical",  # this server writes its own log, once for each kind, without addresses
            access_log=False,  # the token would be in it
            proxy_headers=False,
            server_header=False,
            limit_concurrency=CONNECTIONS * self._viewers + SPARE_CONNECTIONS,
            ws_max_size=MOST_BYTES,
            ws_ping_interval=PING_S,
            ws_ping_timeout=PONG_S,
            ws_per_message_deflate=False,  # costs more than it saves: once for each viewer
            h11_max_incomplete_event_size=16 << 10,
            timeout_graceful_shutdown=1,
        )
        config.load()
        return config


class _Server(uvicorn.Server):
    """Shows the game to all pages from the start on, and says good-bye to them before it ends."""

    def __init__(self, config: uvicorn.Config, sessions: Sessions):
        super().__init__(config)
        self._sessions = sessions
        self._ticks: asyncio.Task[None] | None = None

    async def startup(self, sockets: list[Any] | None = None) -> None:
        self._ticks = asyncio.create_task(self._sessions.run())
        await super().startup(sockets)

    async def shutdown(self, sockets: list[Any] | None = None) -> None:
        await self._sessions.end()
        await super().shutdown(sockets)
        for connection in list(self.server_state.connections):  # of clients that read nothing
            connection.transport.abort()
        await asyncio.sleep(0)


def serve(
    game: Game,
    host: str = "127.0.0.1",
    port: int = 8000,
    *,
    names: Iterable[str] = (),
    viewers: int = MOST_VIEWERS,
    opened: Callable[[str], Any] | None = None,  # called with the page's address, such as to open a browser
) -> None:
    """Print the page's links and serve it until Ctrl-C or SIGTERM, in the main thread; OSError for a bad address."""
    ended = threading.Event()
    with WebServer(game, host, port, names=names, viewers=viewers) as server:
        before = {one: signal.signal(one, lambda *_: ended.set()) for one in (signal.SIGINT, signal.SIGTERM)}
        try:
            print(greeting(server.public_url, server.tokens), flush=True)
            if opened is not None:
                opened(server.url)
            while not ended.wait(_WAKE_S):
                pass  # a signal that another thread has received does not end a wait of this one
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
