"""The server of the operator's page: a thread with its connections, over a game."""

from __future__ import annotations

import asyncio
import contextlib
import logging
import signal
import socket
import sys
import threading
import time
from collections.abc import Awaitable, Callable, Iterable
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect
from starlette.routing import WebSocketRoute
from starlette.websockets import WebSocketDisconnect

from pacman_env.web.access import Access, Guard, Tokens, is_loopback, names_of
from pacman_env.web.address import bind, greeting, link, shown_address
from pacman_env.web.connections import HEADERS_S, Connection, Door
from pacman_env.web.desk import Desk
from pacman_env.web.game import Game
from pacman_env.web.messages import MOST_BYTES
from pacman_env.web.routes import BODY_S, STATIC, Routes
from pacman_env.web.said import Said, WithoutTokens
from pacman_env.web.viewers import MESSAGES_PER_S
from pacman_env.web.websocket import Conversations

TICK_S = 0.05
REQUEST_S = 120.0  # for all over HTTP but an upload
PING_S, PONG_S = 3.0, 5.0  # a page that says nothing is gone after 8 s
CONNECTIONS = 3  # for each viewer: a browser opens up to six for the page's files, and soon closes them
SPARE_CONNECTIONS = 50


class WebServer:
    """The page over a game, in a thread of its own; ``with`` starts and closes it. The game is the caller's to close.

    Args:
        game: that people look at.
        host: an address of this machine, or a name of one; 0.0.0.0: all of them.
        port: 0: any that is free.
        tokens: None: new ones where the address is reached from elsewhere, and none where it is not.
        names: by which the page may be asked for too, such as that of a router that passes connections on.
        say: writes a line of the log; a line on stderr if not given.
        most_viewers: at once.
        messages_per_s: of one viewer.
        headers_s: how long a request's head may take; ``body_s``: an upload.
        static: the page's files.

    Raises:
        OSError: of :meth:`start`: the address cannot be had; the words say why.
    """

    def __init__(
        self,
        game: Game,
        host: str = "127.0.0.1",
        port: int = 0,
        *,
        tokens: Tokens | None = None,
        names: Iterable[str] = (),
        say: Callable[[str], None] | None = None,
        most_viewers: int = 100,
        messages_per_s: float = MESSAGES_PER_S,
        headers_s: float = HEADERS_S,
        body_s: float = BODY_S,
        static: Path = STATIC,
    ):
        self.host, self.port, self.address = host, port, host
        self.tokens = tokens
        self._game = game
        self._names = tuple(names)
        self._say = say or partial(print, "pacman-env web:", file=sys.stderr, flush=True)
        self._most = most_viewers
        self._rate = messages_per_s
        self._headers_s, self._body_s = headers_s, body_s
        self._static = static
        self._socket: socket.socket | None = None
        self._thread: threading.Thread | None = None
        self._ready = threading.Event()
        self._failed: BaseException | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._stop: asyncio.Event | None = None

    @property
    def url(self) -> str:
        """The page, with the operator's token where one is needed."""
        return link(shown_address(self.address), self.port, self.tokens.operator if self.tokens else "")

    @property
    def viewer_url(self) -> str:
        """The page for one who only looks."""
        return link(shown_address(self.address), self.port, self.tokens.viewer if self.tokens else "")

    def greeting(self) -> str:
        """What is to be printed: links, and a QR code for telephones."""
        return greeting(self.address, self.port, self.tokens)

    def __enter__(self) -> WebServer:
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def start(self) -> None:
        """Be there for everybody from now on.

        Raises:
            OSError: the address is taken, or none of this machine's.
        """
        self._socket = bind(self.host, self.port)
        self.address, self.port = self._socket.getsockname()[:2]
        if self.tokens is None and not is_loopback(self.address):
            self.tokens = Tokens.new()
        self._thread = threading.Thread(target=self._run, name="web", daemon=True)
        self._thread.start()
        self._ready.wait()
        if self._failed is not None:
            self._thread.join()
            raise OSError(f"the page cannot be served: {self._failed}") from self._failed

    def close(self) -> None:
        """Say good bye to everybody, and end; it takes 2 s at most."""
        thread, loop, stop = self._thread, self._loop, self._stop
        if thread is None or loop is None or stop is None:
            return
        with contextlib.suppress(RuntimeError):  # it has ended by itself
            loop.call_soon_threadsafe(stop.set)
        thread.join()
        self._thread = None

    def thread_cpu_s(self) -> float:
        """Time on the processor that the server's own thread has had."""
        assert self._thread is not None
        assert self._thread.ident is not None
        return time.clock_gettime(time.pthread_getcpuclockid(self._thread.ident))

    def _run(self) -> None:
        try:
            with asyncio.Runner() as runner:
                runner.run(self._serve())
        except BaseException as error:
            self._failed = error
        finally:
            self._ready.set()

    async def _serve(self) -> None:
        assert self._socket is not None
        loop = self._loop = asyncio.get_running_loop()
        self._stop = asyncio.Event()
        hidden = (self.tokens.operator, self.tokens.viewer) if self.tokens else ()
        said = Said(self._say, hidden)
        loop.set_exception_handler(lambda _, context: _say_context(said, context))
        desk = Desk(self._game, said, self._most, self._rate)
        conversations = Conversations(desk, said)
        routes = Routes(self._game, desk, said, self._static, self._body_s)
        application = Starlette(routes=[*routes.all(), WebSocketRoute("/ws", conversations.serve)])
        access = Access(self.tokens, (*names_of(self.host, self.address), *self._names))
        door = Door(CONNECTIONS * self._most + SPARE_CONNECTIONS, self._headers_s)
        guarded = Guard(_bounded(application, said), access, said)
        without_tokens = WithoutTokens(said)
        server = uvicorn.Server(_configuration(guarded, door))
        logging.getLogger("uvicorn.error").addFilter(without_tokens)
        serving = loop.create_task(server.serve(sockets=[self._socket]))
        ticking = loop.create_task(_tick(desk, door, said))
        try:
            while not server.started and not serving.done():
                await asyncio.sleep(0.005)
            self._ready.set()
            stopping = loop.create_task(self._stop.wait())
            await asyncio.wait((serving, stopping), return_when=asyncio.FIRST_COMPLETED)
            stopping.cancel()
            await conversations.end()
            server.should_exit = True
            for _ in range(2):  # the first cut is for those who take their time, the second for those who do not move
                await asyncio.wait((serving,), timeout=0.4)
                door.cut()
                server.force_exit = True
            await serving
        finally:
            ticking.cancel()
            desk.close()
            logging.getLogger("uvicorn.error").removeFilter(without_tokens)


def _configuration(application: Any, door: Door) -> uvicorn.Config:
    return uvicorn.Config(
        application,
        http=Connection.of(door),
        ws="websockets-sansio",
        loop="asyncio",
        lifespan="off",
        interface="asgi3",
        log_config=None,
        log_level="critical",  # what happens is said by us, once, and not by address
        access_log=False,  # the token would be in it
        proxy_headers=False,
        server_header=False,
        ws_max_size=MOST_BYTES,
        ws_ping_interval=PING_S,
        ws_ping_timeout=PONG_S,
        ws_per_message_deflate=False,  # costs more than it saves: once for each viewer
        h11_max_incomplete_event_size=16 << 10,
        timeout_graceful_shutdown=1,
    )


async def _tick(desk: Desk, door: Door, said: Said) -> None:
    """Twenty times a second, as long as the server is there."""
    at, count = time.monotonic(), 0
    while True:
        try:
            await desk.tick()
            count += 1
            if count % 10 == 0:
                door.sweep()
        except Exception as error:
            said.error("a tick", error)
        at = max(at + TICK_S, time.monotonic())  # what was missed is not made up for
        await asyncio.sleep(at - time.monotonic())


def _bounded(application: Starlette, said: Said) -> Callable[[Any, Any, Any], Awaitable[None]]:
    """The application, with an end to every request, and one line for every error that nobody expected."""

    async def bounded(scope: Any, receive: Any, send: Any) -> None:
        try:
            async with asyncio.timeout(REQUEST_S if scope["type"] == "http" else None):
                await application(scope, receive, send)
        except (TimeoutError, ClientDisconnect, WebSocketDisconnect):
            return
        except Exception as error:
            said.error("a request", error)

    return bounded


def _say_context(said: Said, context: dict[str, Any]) -> None:
    error = context.get("exception")
    if isinstance(error, Exception):
        said.error(str(context.get("message", "the server")), error)
    else:
        said("loop", str(context.get("message", "the server")))


def serve(
    game: Game,
    host: str = "127.0.0.1",
    port: int = 8000,
    *,
    names: Iterable[str] = (),
    most_viewers: int = 100,
    say: Callable[[str], None] | None = None,
    tell: Callable[[str], None] = print,
    opened: Callable[[str], Any] | None = None,
) -> None:
    """Serve the page until Ctrl-C or SIGTERM; to be called in the main thread. The game is the caller's to close.

    Args:
        game: that people look at.
        host, port, names, most_viewers, say: as of :class:`WebServer`.
        tell: told where the page is.
        opened: called with the page's address once it is there, such as to open a browser.

    Raises:
        OSError: the address cannot be had.
    """
    ended = threading.Event()
    signals = (signal.SIGINT, signal.SIGTERM)
    with WebServer(game, host, port, names=names, most_viewers=most_viewers, say=say) as server:
        before = {number: signal.signal(number, lambda *_: ended.set()) for number in signals}
        try:
            tell(server.greeting())
            if opened is not None:
                opened(server.url)
            ended.wait()
        finally:
            for number, handler in before.items():
                signal.signal(number, handler)
