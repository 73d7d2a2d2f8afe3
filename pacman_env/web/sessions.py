"""Carry clicks to the game and the game to every page; read this file from top to bottom.

All pages receive news twenty times a second (:meth:`Sessions.run`). A page connects (:meth:`Sessions.serve`).
Each of its messages is checked (``_receive``), waits for its turn (``_take_turn``) and is carried out
(``_carry_out``); STOP overtakes all others (``_stop``).
"""

import asyncio
import contextlib
import threading
import time
from collections.abc import Awaitable, Callable, Coroutine
from concurrent.futures import Future
from functools import partial
from typing import Any, TypeVar

from starlette.websockets import WebSocket, WebSocketDisconnect

from pacman_env.web import page_messages, roles
from pacman_env.web.access import Kind, refusal_response
from pacman_env.web.game_interface import Game, Refused
from pacman_env.web.log import Log
from pacman_env.web.page_messages import Message, parse
from pacman_env.web.roles import ROBOT, ROLES, RoleControl
from pacman_env.web.viewers import MOST_TEXTS, Audience, Viewer

TICK_S = 0.05
MOST_THREADS = 32  # most requests that the game handles at the same time
MOST_STOPS = 4  # at the same time
MOST_WORDS = 500
SLOW_S = 10.0  # a page that needs longer to receive a message is disconnected
GOODBYE_S = 0.5
VIEW_ONLY = "your link is view only; STOP still works"
#: Messages that operators may send without control; other messages that are not for everyone need control.
_FREE = (page_messages.Control, page_messages.Role, page_messages.Goal, page_messages.Drive)
T = TypeVar("T")


async def in_thread(limit: asyncio.Semaphore, work: Callable[..., T], *arguments: Any) -> T:
    """Run ``work`` in a daemon thread, which does not keep the process alive, and return the result."""
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
    def __init__(self, game: Game, log: Log, most: int):
        self.audience = Audience(game, most, self._people)
        self._game, self._log, self._control = game, log, RoleControl()
        # The game is never called in the thread of the connections, because any call may take long.
        self.in_thread = partial(in_thread, asyncio.Semaphore(MOST_THREADS))
        self._poll_thread = asyncio.Semaphore(1)  # frames continue, however many requests wait for the game
        self._stop_threads = asyncio.Semaphore(MOST_STOPS)  # only other stops and departures can delay a stop
        self._known: dict[str, Viewer] = {}  # keyed by the key of the page
        self._tasks: set[asyncio.Task[Any]] = set()
        self._guests = 0
        self._stops = 0  # number of stops from all people
        self._ending = False
        self._round_runs = False

    # From the game to all pages

    async def run(self) -> None:
        while True:
            due_s = time.monotonic() + TICK_S  # late ticks are skipped
            await self._attempt("the game cannot be shown", self._tick())
            await asyncio.sleep(due_s - time.monotonic())

    async def _tick(self) -> None:
        try:
            update = await in_thread(self._poll_thread, self.audience.poll)
            if update is not None:
                self._round_runs = update.frame is not None and update.frame.state != "menu"
        finally:  # also while the game fails
            for person in self._control.expire(time.monotonic(), self._round_runs):
                self._log.add("expired", f"{person} did not come back: control and role are free")
        self.audience.send(update)

    def _people(self) -> dict[str, Any]:
        return {
            "viewers": len(self.audience.viewers),
            "operator": self._control.operator,
            "away": self._control.operator in self._control.away,
            "asking": self._control.asking,
            "roles": {role: self._control.roles.people.get(role) for role in ROLES},
        }

    async def end(self) -> None:
        self._ending = True
        for viewer in self.audience.viewers:
            viewer.outbox.end("the server ends")
        end_s = time.monotonic() + GOODBYE_S
        while self.audience.viewers and time.monotonic() < end_s:
            await asyncio.sleep(0.01)

    # A page comes and goes

    async def serve(self, socket: WebSocket) -> None:
        access = socket.scope["access"]
        if self._ending or not self.audience.has_room(access):
            words = "the limit of viewers is reached; try again later"
            await socket.send_denial_response(refusal_response(503, words, self._log))
            return
        viewer = self._connect(access, socket.query_params.get("again", ""))
        tasks: list[asyncio.Task[None]] = []
        try:
            await socket.accept()
            tasks = [self.spawn(self._send(socket, viewer)), self.spawn(self._listen(socket, viewer))]
            await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        except (WebSocketDisconnect, OSError):
            return
        finally:
            for task in tasks:
                task.cancel()
            self._disconnect(viewer)

    def _connect(self, access: Kind, key: str) -> Viewer:
        """Add the viewer of a new connection; the key of an earlier connection restores its person."""
        kept_s = time.monotonic() - roles.KEPT_S
        self._known = {own: one for own, one in self._known.items() if one.gone_s is None or one.gone_s > kept_s}
        before = self._known.pop(key, None)
        if before is None or before.access != access:
            self._guests += 1
            viewer = Viewer(f"guest-{self._guests}", access)
            self.audience.add(viewer, is_new=True)
        else:
            viewer = Viewer(before.name, access, before.turn)
            before.is_replaced = True
            if before.gone_s is None:  # the old connection died unnoticed
                before.outbox.end("your page has reconnected")
                self.audience.remove(before)
            self.audience.add(viewer, is_new=False)
            self.spawn(self._return(viewer, before))
        self._known[viewer.key] = viewer
        self._control.came(viewer.name)
        return viewer

    async def _return(self, viewer: Viewer, before: Viewer) -> None:
        """Give a person who returns the same role in the game, before the next message is handled."""
        async with viewer.turn:
            if before.leaving is not None:
                await asyncio.wait([before.leaving])
            role = self._control.roles.of(viewer.name)
            if role is not None:
                back = self.in_thread(self._game.handle, viewer.name, page_messages.Role(role=role))  # type: ignore[arg-type]
                if await self._attempt("a person came back", back):
                    self._control.roles.leave(viewer.name)

    def _disconnect(self, viewer: Viewer) -> None:
        self.audience.remove(viewer)
        viewer.outbox.end("gone")
        viewer.gone_s = time.monotonic()
        if not viewer.is_replaced:
            self._control.went(viewer.name, viewer.gone_s)
            leaving = in_thread(self._stop_threads, self._game.leave, viewer.name)
            viewer.leaving = self.spawn(self._attempt("a person left", leaving))

    async def _send(self, socket: WebSocket, viewer: Viewer) -> None:
        with contextlib.suppress(WebSocketDisconnect, RuntimeError, TimeoutError):
            while texts := await viewer.outbox.get():
                for text in texts:
                    async with asyncio.timeout(SLOW_S):
                        await socket.send_text(text)
            await socket.close(1001 if self._ending else 1008, viewer.outbox.why_ended)

    # From a page to the game

    async def _listen(self, socket: WebSocket, viewer: Viewer) -> None:
        with contextlib.suppress(WebSocketDisconnect, RuntimeError):
            while (event := await socket.receive())["type"] == "websocket.receive":
                self._receive(viewer, event.get("text"))

    def _receive(self, viewer: Viewer, text: str | None) -> None:
        """Check one message. A stop is handled immediately, before all other messages and at any message rate."""
        message, error = None, "bad message: must be text, not bytes"
        try:
            message = None if text is None else parse(text)
        except ValueError as invalid:
            error = str(invalid)[:MOST_WORDS]
        if isinstance(message, page_messages.Stop):
            self._stops += 1
            if not viewer.stops or (message.id and len(viewer.stops) < MOST_TEXTS):  # no id: no answer
                viewer.stops.append(message)
            if not viewer.is_stopping:
                viewer.is_stopping = True
                self.spawn(self._stop(viewer))
        elif not viewer.is_within_rate(time.monotonic()):
            return
        elif message is None:
            viewer.send({"kind": "refused", "words": error})
        elif isinstance(message, page_messages.Ping):
            viewer.answer(message)
        elif isinstance(message, page_messages.Watch):
            viewer.why, viewer.lidar = message.why, message.lidar
            viewer.answer(message)
        elif viewer.access == "viewer" and not isinstance(message, page_messages.FOR_ALL):
            viewer.answer(message, VIEW_ONLY)
        elif viewer.waiting >= MOST_TEXTS - 1:
            viewer.answer(message, "too many requests: the game still handles your earlier ones")
        else:
            viewer.waiting += 1
            self.spawn(self._take_turn(viewer, message, self._stops))

    async def _stop(self, viewer: Viewer) -> None:
        """Stop the game. Stops that arrive during the call are handled together by one more call."""
        while viewer.stops:
            stops, viewer.stops = viewer.stops, []
            refusal = await self._attempt("a stop", in_thread(self._stop_threads, self._game.stop, viewer.name))
            for message in stops:
                viewer.answer(message, refusal)
        viewer.is_stopping = False

    async def _take_turn(self, viewer: Viewer, message: Message, stops: int) -> None:
        """Handle a message when its turn comes, one at a time and in order; drop it if the page has disconnected."""
        async with viewer.turn:
            viewer.waiting -= 1
            if viewer.gone_s is not None:
                return
            what = f"a request from a page ({type(message).__name__.lower()})"
            if refusal := await self._attempt(what, self._answer(viewer, message, stops)):
                viewer.answer(message, refusal)
            if viewer.gone_s is not None and not viewer.is_replaced:  # the page disconnected meanwhile
                await self._attempt("a person left", self.in_thread(self._game.leave, viewer.name))

    async def _answer(self, viewer: Viewer, message: Message, stops: int) -> None:
        viewer.answer(message, data=await self._carry_out(viewer.name, message, stops))

    async def _carry_out(self, name: str, message: Message, stops: int) -> Any:
        """Handle a message of a person and return the answer's data; a refused message changes nothing.

        ``stops`` is the number of stops that had arrived before the message.
        """
        role, on_robot = self._control.roles.of(name), self._game.source == "ros"
        if not isinstance(message, (*page_messages.FOR_ALL, *_FREE)):
            self._control.take(name)
        match message:
            case page_messages.Role():
                return await self._change_role(name, message, role)
            case page_messages.Control(what=what):
                getattr(self._control, what)(name)
                if what != "give" or not on_robot or role != ROBOT:
                    return None
                self._control.roles.leave(name)
                message = page_messages.Role(role="none")
            case page_messages.Release():
                return await self._release(name, stops)
            case page_messages.Drive() if role != ROBOT:
                raise Refused("choose the robot's role in the tab Play first")
            case page_messages.Goal() if role is None:
                raise Refused("choose a role in the tab Play first")
            case page_messages.Goal() | page_messages.Drive() if on_robot and role == ROBOT:
                self._control.take(name)
        return await self.in_thread(self._game.handle, name, message)

    async def _release(self, name: str, stops: int) -> None:
        """Release the robot, unless a stop arrives meanwhile: a later stop wins, whichever reaches the game first."""
        if stops == self._stops:
            await self.in_thread(self._game.release, name)
            if stops == self._stops:
                return
            await self.in_thread(self._game.stop, name)
        raise Refused("stopped again meanwhile")

    async def _change_role(self, name: str, message: page_messages.Role, before: str | None) -> Any:
        roles = self._control.roles
        if message.role == ROBOT and self._game.source == "ros":
            self._control.take(name)
        if message.role == "none":
            roles.leave(name)
        else:
            roles.assume(name, message.role)
        try:
            return await self.in_thread(self._game.handle, name, message)
        except Exception:
            roles.leave(name)
            if before is not None:
                with contextlib.suppress(Refused):
                    roles.assume(name, before)
            raise

    async def _attempt(self, what: str, work: Awaitable[Any]) -> str:
        """Await ``work``, a call of the game; return the text of its failure, or an empty string after success."""
        try:
            await work
        except Refused as refused:
            return str(refused)[:MOST_WORDS] or "refused"
        except Exception as error:
            self._log.error(what, error)
            return "internal error"
        return ""

    def spawn(self, work: Coroutine[Any, Any, T]) -> asyncio.Task[T]:
        task = asyncio.create_task(work)
        self._tasks.add(task)  # a reference, or the task could be collected
        task.add_done_callback(self._tasks.discard)
        return task
