"""Sessions of pages: their websockets, and permissions and order of their messages."""

import asyncio
import contextlib
import threading
import time
from collections.abc import Awaitable, Callable
from concurrent.futures import Future
from functools import partial
from typing import Any, TypeVar

from starlette.websockets import WebSocket, WebSocketDisconnect

from pacman_env import __version__
from pacman_env.web import messages
from pacman_env.web.access import Kind, refusal_response
from pacman_env.web.control import KEPT_S, ROBOT, ROLES, Control
from pacman_env.web.game import Game, Refused
from pacman_env.web.log import Log
from pacman_env.web.messages import Message, as_json, parse
from pacman_env.web.viewers import MOST_TEXTS, Audience, RateLimit, Viewer
from pacman_env.web.vocabulary import vocabulary

MOST_THREADS = 32  # waiting for the game
MOST_STOPS = 4  # simultaneous stops
MOST_REMEMBERED = 1000
MOST_WORDS = 500
GOODBYE_S = 0.5
VIEW_ONLY = "your link is view only; STOP still works"
STOPPED_AGAIN = "stopped again meanwhile"
#: Messages of operators that do not need control.
_FREE = (messages.Control, messages.Role, messages.Goal, messages.Drive)
T = TypeVar("T")


async def in_thread(limit: asyncio.Semaphore, work: Callable[..., T], *arguments: Any) -> T:
    """Return the result of ``work``, run in a daemon thread, so that the process can end even if the work hangs."""
    result: Future[T] = Future()
    result.set_running_or_notify_cancel()

    def run() -> None:
        try:
            result.set_result(work(*arguments))
        except BaseException as error:
            result.set_exception(error)

    async with limit:
        threading.Thread(target=run, name="web", daemon=True).start()
        return await asyncio.wrap_future(result)


class Sessions:
    def __init__(self, game: Game, log: Log, most: int, rate: float):
        self.control = Control()
        self.audience = Audience(game, most, self.people)
        self._game, self._log, self._rate = game, log, rate
        # Never call the game in the thread of the connections, because any call may take long.
        self.in_thread = partial(in_thread, asyncio.Semaphore(MOST_THREADS))
        self._poll_thread = asyncio.Semaphore(1)  # own thread, so that frames continue while requests wait
        self._stop_threads = asyncio.Semaphore(MOST_STOPS)  # only for stops and leaving
        self._known: dict[str, Viewer] = {}  # by key of the page
        self._guests = 0
        self._stops = 0
        self._arriving = 0
        self._ending = False

    def people(self) -> dict[str, Any]:
        control = self.control
        return {
            "viewers": len(self.audience.viewers),
            "operator": control.operator,
            "asking": control.asking,
            "roles": {role: control.roles.people.get(role) for role in ROLES},
        }

    async def tick(self) -> None:
        expired = self.control.expire(time.monotonic())
        for person in expired:
            self._log.add("expired", f"{person} did not come back: control and role are free")
        if expired:
            self._forget_gone()
        try:
            self.audience.send(await in_thread(self._poll_thread, self.audience.poll))
        except Exception as error:
            self._log.error("the game cannot be shown", error)

    async def end(self) -> None:
        self._ending = True
        for viewer in self.audience.viewers:
            viewer.outbox.end("the server ends")
        end_s = time.monotonic() + GOODBYE_S
        while self.audience.viewers and time.monotonic() < end_s:
            await asyncio.sleep(0.01)

    async def serve(self, socket: WebSocket) -> None:
        access = socket.scope["access"]
        if self._ending or not self.audience.has_room(access, self._arriving):
            words = "the limit of viewers is reached; try again later"
            self._log.add("full", f"refused: {words}")
            await socket.send_denial_response(refusal_response(503, words))
            return
        self._arriving += 1
        try:
            await socket.accept()
            viewer = await self._connect(access, socket.query_params.get("again", ""))
        except WebSocketDisconnect:
            return
        except Exception as error:
            self._log.error("the game cannot be shown", error)
            await socket.close(1011, "internal error")
            return
        finally:
            self._arriving -= 1
        try:
            await self._converse(socket, viewer)
        finally:
            self._disconnect(viewer)

    async def _converse(self, socket: WebSocket, viewer: Viewer) -> None:
        outbox = viewer.outbox

        async def send() -> None:
            with contextlib.suppress(WebSocketDisconnect, RuntimeError):
                while texts := await outbox.get():
                    for text in texts:
                        await socket.send_text(text)
                reason = outbox.why_ended.encode()[:100].decode(errors="ignore")
                await socket.close(1001 if self._ending else 1008, reason)

        async def receive() -> None:
            with contextlib.suppress(WebSocketDisconnect, RuntimeError):
                while (message := await socket.receive())["type"] == "websocket.receive":
                    text = message.get("text")
                    self._receive(viewer, message.get("bytes", b"") if text is None else text)

        sender = asyncio.create_task(send())
        tasks = (sender, asyncio.create_task(outbox.ended.wait()), asyncio.create_task(receive()))
        try:
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
            if outbox.ended.is_set() and not sender.done():
                await asyncio.wait((sender,), timeout=GOODBYE_S)  # the page may not read
        finally:
            for task in tasks:
                task.cancel()
            for result in await asyncio.gather(*tasks, return_exceptions=True):
                if isinstance(result, Exception):
                    self._log.error("a viewer", result)

    async def _connect(self, access: Kind, key: str) -> Viewer:
        """Register a page that has connected; the key of an earlier connection restores its person."""
        choices = await in_thread(self._poll_thread, self._game.choices)
        previous = self._known.pop(key, None)
        if previous is None or previous.access != access:
            previous = None
            if not self.audience.viewers:
                await in_thread(self._poll_thread, self._game.greet)
            self._guests += 1
            viewer = Viewer(f"guest-{self._guests}", access, RateLimit(self._rate, time.monotonic()))
        else:
            viewer = Viewer(previous.name, access, previous.rate_limit)
            previous.is_replaced = True
            if previous.gone_s is None:  # the old connection is dead, but not noticed yet
                previous.outbox.end("your page is connected anew")
                self.audience.remove(previous)
        viewer.worker = asyncio.create_task(self._work(viewer, previous))
        self._forget_gone()
        self._known[viewer.key] = viewer
        self.control.came(viewer.name)
        facts = {"version": __version__, "source": self._game.source, "access": access, "choices": choices}
        viewer.send({"kind": "hello", **vocabulary(), **facts, "you": viewer.name, "again": viewer.key})
        self.audience.viewers.append(viewer)
        return viewer

    def _disconnect(self, viewer: Viewer) -> None:
        self.audience.remove(viewer)
        while not viewer.waiting.empty():
            viewer.waiting.get_nowait()
        viewer.waiting.put_nowait(None)
        if not viewer.is_replaced:
            viewer.outbox.end("gone")
            viewer.gone_s = time.monotonic()
            self.control.went(viewer.name, viewer.gone_s)
            leaving = in_thread(self._stop_threads, self._game.leave, viewer.name)
            viewer.leaving = asyncio.create_task(self._attempt("a person left", leaving))

    def _forget_gone(self) -> None:
        late_s = time.monotonic() - KEPT_S
        for key, viewer in list(self._known.items()):
            late = viewer.gone_s is not None and (viewer.gone_s <= late_s or len(self._known) > MOST_REMEMBERED)
            if late and viewer.name not in self.control.gone:
                del self._known[key]

    # Messages

    def _receive(self, viewer: Viewer, text: str | bytes) -> None:
        """Process a message; a stop is executed at once, before all others and at any rate."""
        message, error = None, "bad message: text is understood, bytes are not"
        if isinstance(text, str):
            try:
                message = parse(text)
            except ValueError as invalid:
                error = str(invalid)[:MOST_WORDS]
        if isinstance(message, messages.Stop):
            self._stops += 1
            if not viewer.stops or (message.id and len(viewer.stops) < MOST_TEXTS):  # only an id needs an answer
                viewer.stops.append(message)
            if viewer.stopping is None or viewer.stopping.done():
                viewer.stopping = asyncio.create_task(self._stop(viewer))
        elif not viewer.is_within_rate(time.monotonic()):
            return
        elif message is None:
            viewer.send({"kind": "refused", "words": error})
        elif isinstance(message, messages.Ping):
            _answer(viewer, message)
        elif isinstance(message, messages.Watch):
            viewer.why, viewer.lidar = message.why, message.lidar
            _answer(viewer, message)
        elif viewer.access == "viewer" and not isinstance(message, messages.FOR_ALL):
            _answer(viewer, message, VIEW_ONLY)
        elif viewer.waiting.qsize() >= MOST_TEXTS - 1:  # one place is reserved for the end
            _answer(viewer, message, "too much at once: the game has not done yet what you asked for")
        else:
            viewer.waiting.put_nowait((message, self._stops))

    async def _stop(self, viewer: Viewer) -> None:
        """Execute one stop at a time; all stops that arrive meanwhile are combined into the next one."""
        while viewer.stops:
            stops, viewer.stops = viewer.stops, []
            refusal = await self._attempt("a stop", in_thread(self._stop_threads, self._game.stop, viewer.name))
            for message in stops:
                _answer(viewer, message, refusal)

    async def _attempt(self, what: str, work: Awaitable[Any]) -> str:
        """Await ``work`` and return words about a failure, or "" on success."""
        try:
            await work
        except Refused as refused:
            return str(refused)[:MOST_WORDS] or "refused"
        except Exception as error:
            self._log.error(what, error)
            return "internal error"
        return ""

    async def _work(self, viewer: Viewer, previous: Viewer | None) -> None:
        """Process the messages of one person in order, after those of the connection ``previous``."""
        pending = [task for task in (previous.worker, previous.leaving) if task is not None] if previous else []
        if pending:
            await asyncio.wait(pending)
        role = self.control.roles.of(viewer.name)
        if role is not None:  # the person is back: restore its role in the game
            try:
                await self.in_thread(self._game.handle, viewer.name, messages.Role(role=role))  # type: ignore[arg-type]
            except Exception:
                self.control.roles.leave(viewer.name)
        while (item := await viewer.waiting.get()) is not None:
            message, stops = item
            what = f"what a page asked for ({type(message).__name__.lower()})"
            if refusal := await self._attempt(what, self._do(viewer, message, stops)):
                _answer(viewer, message, refusal)
            if viewer.gone_s is not None and not viewer.is_replaced:  # the page was closed meanwhile
                await self._attempt("a person left", self.in_thread(self._game.leave, viewer.name))

    async def _do(self, viewer: Viewer, message: Message, stops: int) -> None:
        name = viewer.name
        if not isinstance(message, (*messages.FOR_ALL, *_FREE)):
            self.control.take(name)
        if isinstance(message, messages.Role):
            await self._change_role(viewer, message)
        elif isinstance(message, messages.Control):
            await self._change_control(name, message.what)
            _answer(viewer, message)
        elif isinstance(message, messages.Release):
            await self._release(name, stops)
            _answer(viewer, message)
        else:
            if isinstance(message, messages.Goal | messages.Drive):
                role, drives = self.control.roles.of(name), isinstance(message, messages.Drive)
                if role is None or (drives and role != ROBOT):
                    raise Refused(
                        "choose the robot's role in the tab Play first"
                        if drives
                        else "choose a role in the tab Play first"
                    )
                if role == ROBOT and self._game.source == "ros":
                    self.control.take(name)
            await self._handle(viewer, message)

    async def _handle(self, viewer: Viewer, message: Message) -> None:
        """Pass a message to the game; the answer, which may be long, is encoded in the same thread."""

        def handle() -> str:
            data = self._game.handle(viewer.name, message)
            answer = {"kind": "answer", "id": message.id, "ok": True, "words": "", "data": data}
            return as_json(answer) if message.id else ""

        if answer := await self.in_thread(handle):
            viewer.outbox.put_text(answer)

    async def _release(self, name: str, stops: int) -> None:
        """Release the robot, unless a stop arrived after the request; a later stop always wins."""
        if stops != self._stops:
            raise Refused(STOPPED_AGAIN)
        await self.in_thread(self._game.release, name)
        if stops != self._stops:
            await self.in_thread(self._game.stop, name)
            raise Refused(STOPPED_AGAIN)

    async def _change_control(self, name: str, what: str) -> None:
        control = self.control
        {"take": control.take, "ask": control.ask, "give": control.give}[what](name)
        if what == "give" and self._game.source == "ros" and control.roles.of(name) == ROBOT:
            control.roles.leave(name)
            await self.in_thread(self._game.handle, name, messages.Role(role="none"))

    async def _change_role(self, viewer: Viewer, message: messages.Role) -> None:
        name, roles = viewer.name, self.control.roles
        previous = roles.of(name)
        if message.role == ROBOT and self._game.source == "ros":
            self.control.take(name)
        if message.role == "none":
            roles.leave(name)
        else:
            roles.assume(name, message.role)
        try:
            await self._handle(viewer, message)
        except Exception:
            roles.leave(name)
            if previous is not None:
                with contextlib.suppress(Refused):
                    roles.assume(name, previous)
            raise


def _answer(viewer: Viewer, message: Message, refusal: str = "") -> None:
    if message.id:
        viewer.send({"kind": "answer", "id": message.id, "ok": not refusal, "words": refusal, "data": None})
    elif refusal:
        viewer.send({"kind": "refused", "words": refusal})
