"""The server of the operator's page: the page's files, the websocket, maps and rounds over HTTP."""

from __future__ import annotations

import asyncio
import base64
import binascii
import contextlib
import errno
import hashlib
import logging
import re
import signal
import socket
import sys
import threading
import time
from collections.abc import AsyncIterator, Awaitable, Callable, Iterable
from functools import partial
from pathlib import Path
from types import TracebackType
from typing import Any

import msgspec
import uvicorn
from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse, PlainTextResponse, Response, StreamingResponse
from starlette.routing import Route, WebSocketRoute
from starlette.websockets import WebSocket, WebSocketDisconnect

from pacman_env import __version__
from pacman_env.web.access import Access, Guard, Tokens, is_loopback, names_of, refuse
from pacman_env.web.address import greeting, link, shown_address
from pacman_env.web.connections import HEADERS_S, Connection, Door
from pacman_env.web.desk import Desk
from pacman_env.web.game import Game, Refused
from pacman_env.web.messages import MOST_BYTES
from pacman_env.web.said import Said, WithoutTokens
from pacman_env.web.viewers import MESSAGES_PER_S, Viewer

STATIC = Path(__file__).with_name("static")
TICK_S = 0.05
MOST_UPLOAD = 8 << 20
BODY_S = 20.0  # for an upload
REQUEST_S = 120.0  # for all else over HTTP
GOODBYE_S = 0.5
PING_S, PONG_S = 3.0, 5.0  # a page that says nothing is gone after 8 s
CONNECTIONS = 3  # for each viewer: a browser opens up to six for the page's files, and soon closes them
SPARE_CONNECTIONS = 50
#: By the end of a file's name: not the system's list, which may be wrong or empty.
TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".mjs": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".json": "application/json",
    ".webmanifest": "application/manifest+json",
    ".svg": "image/svg+xml",
    ".png": "image/png",
    ".ico": "image/vnd.microsoft.icon",
    ".txt": "text/plain; charset=utf-8",
    ".woff2": "font/woff2",
}


class Upload(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A map of one's own."""

    name: str
    yaml: str
    image: str


def map_name(name: str) -> str:
    """What a map of somebody's own is called: small letters, digits, - and _."""
    return re.sub(r"[^a-z0-9_-]+", "-", name.lower())[:40].strip("-_") or "map"


class Pages:
    """What is answered to each path.

    Args:
        game: that people look at.
        desk: hears them.
        said: told what goes wrong.
        static: the page's files.
        body_s: for an upload.
    """

    def __init__(self, game: Game, desk: Desk, said: Said, static: Path, body_s: float):
        self._game = game
        self._desk = desk
        self._said = said
        self._static = static
        self._body_s = body_s
        self._upload = asyncio.Semaphore(1)  # their size is bounded: so is that of all together
        self.connected: set[asyncio.Task[Any]] = set()
        self.ending = False
        self._arriving = 0

    def application(self) -> Starlette:
        """The paths."""
        return Starlette(
            routes=[
                Route("/", self._page),
                Route("/static/{path:path}", self._file),
                Route("/health", self._health),
                Route("/map", self._add_map, methods=["POST"]),
                Route("/map/{revision:int}.png", self._picture),
                Route("/story/{number:int}.json", self._story),
                WebSocketRoute("/ws", self._socket),
            ]
        )

    async def _page(self, request: Request) -> Response:
        return self._answer_file(request, "index.html")

    async def _file(self, request: Request) -> Response:
        return self._answer_file(request, request.path_params["path"])

    def _answer_file(self, request: Request, name: str) -> Response:
        root = self._static.resolve()
        try:
            path = (root / name).resolve()
            content = path.read_bytes() if path.is_relative_to(root) and path.suffix in TYPES else None
        except (OSError, ValueError):
            content = None
        if content is None:
            return PlainTextResponse("no such file\n", 404)
        return _cached(request, content, TYPES[path.suffix])

    async def _health(self, request: Request) -> Response:
        return JSONResponse({"ok": True, "version": __version__}, headers={"cache-control": "no-store"})

    async def _picture(self, request: Request) -> Response:
        picture = self._desk.audience.pictures.get(request.path_params["revision"])
        return _cached(request, picture, "image/png") if picture else PlainTextResponse("no such map\n", 404)

    async def _story(self, request: Request) -> Response:
        number = request.path_params["number"]
        story = await self._desk.in_thread(self._game.story, number) if number < 2**31 else None
        if story is None:
            return PlainTextResponse("no such round\n", 404)

        async def pieces() -> AsyncIterator[bytes]:  # whoever reads slowly holds one of them, not all
            for at in range(0, len(story), 1 << 16):
                yield story[at : at + (1 << 16)]

        headers = {"cache-control": "no-store", "content-length": str(len(story))}
        return StreamingResponse(pieces(), media_type="application/json", headers=headers)

    async def _add_map(self, request: Request) -> Response:
        if request.scope["access"] != "operator":
            return _map_answer(403, "your link is for looking, and for STOP")
        if self._upload.locked():
            return _map_answer(429, "another map is on its way: again in a moment")
        async with self._upload:
            try:
                async with asyncio.timeout(self._body_s):
                    body = await _body(request)
            except TimeoutError:
                return _map_answer(408, "the map did not come in time")
            except ClientDisconnect:
                return Response(status_code=400)
            if body is None:
                return _map_answer(413, f"a map of more than {MOST_UPLOAD >> 20} MB")
            try:
                added = await self._desk.in_thread(self._add, body)
            except msgspec.DecodeError as error:
                return _map_answer(400, f"no map: {error}")
            except Refused as refused:  # asked rightly: the page shows the words, the browser no error
                return _map_answer(200, str(refused))
            except Exception as error:
                self._said.error("a map", error)
                return _map_answer(500, "internal error")
            return JSONResponse({"ok": True, "words": added["words"], "map": added["map"]})

    def _add(self, body: bytes) -> dict[str, Any]:
        try:
            upload = msgspec.json.decode(body, type=Upload)
            image = base64.b64decode(upload.image, validate=True)
        except (UnicodeDecodeError, RecursionError, binascii.Error) as error:
            raise msgspec.DecodeError(str(error)) from error
        return self._game.add_map(map_name(upload.name), upload.yaml, image)

    # the websocket

    async def _socket(self, socket: WebSocket) -> None:
        access = socket.scope["access"]
        if self.ending or not self._desk.audience.has_room(access, self._arriving):
            words = "no room: there are as many viewers as may be"
            self._said("full", f"refused: {words}")
            await refuse(socket.scope, socket.send, 503, words)
            return
        self._arriving += 1
        try:
            await socket.accept()
            viewer = await self._desk.arrive(access, socket.query_params.get("again", ""))
        except WebSocketDisconnect:
            return
        except Exception as error:
            self._said.error("the game cannot be shown", error)
            await socket.close(1011, "internal error")
            return
        finally:
            self._arriving -= 1
        task = asyncio.current_task()
        assert task is not None
        self.connected.add(task)
        try:
            await self._converse(socket, viewer)
        finally:
            self.connected.discard(task)
            self._desk.depart(viewer)

    async def _converse(self, socket: WebSocket, viewer: Viewer) -> None:
        """Until one of both sides has enough."""
        place = viewer.place
        assert place is not None

        async def send() -> None:
            with contextlib.suppress(WebSocketDisconnect, RuntimeError):
                while things := await place.take():
                    for thing in things:
                        await socket.send_text(thing)
                await socket.close(
                    1001 if self.ending else 1008, place.why_ended.encode()[:100].decode(errors="ignore")
                )

        async def listen() -> None:
            with contextlib.suppress(WebSocketDisconnect, RuntimeError):
                while (message := await socket.receive())["type"] == "websocket.receive":
                    text = message.get("text")
                    self._desk.hear(viewer, message.get("bytes", b"") if text is None else text)

        loop = asyncio.get_running_loop()
        sender, ended = loop.create_task(send()), loop.create_task(place.ended.wait())
        listener = loop.create_task(listen())
        tasks = (sender, ended, listener)
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            if place.ended.is_set() and not sender.done():
                await asyncio.wait((sender,), timeout=GOODBYE_S)  # he may not take it
        finally:
            for task in tasks:
                task.cancel()
            for result in await asyncio.gather(*tasks, return_exceptions=True):
                if isinstance(result, Exception):
                    self._said.error("a viewer", result)


async def _body(request: Request) -> bytes | None:
    """What was uploaded; None: too much of it, but read, so that the answer is heard."""
    parts: list[bytes] = []
    size = 0
    async for part in request.stream():
        size += len(part)
        if size > 8 * MOST_UPLOAD:
            return None
        if size > MOST_UPLOAD:
            parts.clear()
        else:
            parts.append(part)
    return b"".join(parts) if size <= MOST_UPLOAD else None


def _map_answer(status: int, words: str) -> Response:
    headers = {"connection": "close"} if status in (408, 413) else {}  # the rest of it is not waited for
    return JSONResponse({"ok": False, "words": words, "map": None}, status, headers)


def _cached(request: Request, content: bytes, kind: str) -> Response:
    tag = f'"{hashlib.sha256(content).hexdigest()[:24]}"'
    headers = {"etag": tag, "cache-control": "no-cache"}
    if tag in [word.strip().removeprefix("W/") for word in request.headers.get("if-none-match", "").split(",")]:
        return Response(status_code=304, headers=headers)
    return Response(content, media_type=kind, headers=headers)


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
        self._socket = _bind(self.host, self.port)
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
        pages = Pages(self._game, desk, said, self._static, self._body_s)
        access = Access(self.tokens, (*names_of(self.host, self.address), *self._names))
        door = Door(CONNECTIONS * self._most + SPARE_CONNECTIONS, self._headers_s)
        guarded = Guard(_bounded(pages.application(), said), access, said)
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
            pages.ending = True
            for viewer in list(desk.audience.here):
                if viewer.place is not None:
                    viewer.place.end("the server ends")
            if pages.connected:
                await asyncio.wait(pages.connected, timeout=GOODBYE_S)
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


def _bind(host: str, port: int) -> socket.socket:
    """A socket that listens soon.

    Raises:
        OSError: the address cannot be had.
    """
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
    except (OSError, UnicodeError) as error:
        raise OSError(f"{host}: no such address") from error
    bound = socket.socket(family, kind, protocol)
    try:
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        bound.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 1 << 17)  # a slow reader is shown what is new
        bound.bind(address)
    except OSError as error:
        bound.close()
        raise OSError(_why_not(error, host, port)) from error
    return bound


def _why_not(error: OSError, host: str, port: int) -> str:
    if error.errno == errno.EADDRINUSE:
        return f"port {port} of {host} is taken: another one, or 0 for any that is free"
    if error.errno == errno.EADDRNOTAVAIL:
        return f"{host} is no address of this computer"
    if error.errno == errno.EACCES:
        return f"port {port} of {host} may not be used: one from 1024 on, or 0 for any that is free"
    return f"{host}, port {port}: {error.strerror}"


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
