"""What is done with what people say: who may, in which order, and what each is answered."""

from __future__ import annotations

import asyncio
import contextlib
import time
from collections.abc import Callable
from typing import Any

from pacman_env import __version__
from pacman_env.web import messages
from pacman_env.web.access import Kind
from pacman_env.web.control import KEPT_S, Control
from pacman_env.web.game import Game, Refused
from pacman_env.web.messages import Message, as_json, parse
from pacman_env.web.roles import ROBOT, ROLES
from pacman_env.web.said import Said
from pacman_env.web.viewers import MESSAGES_PER_S, MOST_TEXTS, Audience, Bucket, Place, Viewer
from pacman_env.web.workers import Workers

WORKERS = 32  # more people than these do not ask at once
MOST_REMEMBERED = 1000
MOST_WORDS = 500
#: What anybody of the operators may say; all else that is not for all needs control.
_FREE = (messages.Control, messages.Role, messages.Goal, messages.Drive)


class Desk:
    """Hears what people say, and has the game do it.

    Args:
        game: does it.
        said: told what goes wrong.
        most: viewers at once.
        rate: messages a second of one viewer.
        clock: s.
    """

    def __init__(
        self,
        game: Game,
        said: Said,
        most: int = 100,
        rate: float = MESSAGES_PER_S,
        clock: Callable[[], float] = time.monotonic,
    ):
        self.control = Control()
        self.audience = Audience(game, most, self.people)
        self._game = game
        self._said = said
        self._rate = rate
        self._clock = clock
        # The game is never asked in the thread of the connections: it may take its time with anything.
        self._pool = Workers(WORKERS, "web")
        self._looks = Workers(1, "web-look")
        self._hurry = Workers(4, "web-stop")  # with nothing but stops and leaving in front of a stop
        self._known: dict[str, Viewer] = {}  # by the key of his page
        self._guests = 0
        self._stops = 0

    def close(self) -> None:
        """No more is done."""
        for pool in (self._pool, self._looks, self._hurry):
            pool.shutdown()

    def people(self) -> dict[str, Any]:
        """Who is here and who does what, for the pages."""
        control = self.control
        roles = {role: control.roles.person(role) for role in ROLES}
        return {
            "viewers": len(self.audience.here),
            "operator": control.operator,
            "asking": control.asking,
            "roles": roles,
        }

    # coming and going

    async def arrive(self, access: Kind, key: str) -> Viewer:
        """A page has connected; with the key that it was given it is the same person's again.

        Raises:
            Exception: the game cannot say what there is.
        """
        hello = await asyncio.get_running_loop().run_in_executor(self._looks, self._game.hello)
        viewer = self._known.pop(key, None)
        if viewer is None or viewer.access != access:
            self._guests += 1
            viewer = Viewer(f"guest-{self._guests}", access, None, Bucket(self._rate, self._clock()))
        elif viewer.place is not None:  # the old connection is dead, and nobody has noticed
            viewer.place.end("your page is connected anew")
            self.audience.farewell(viewer)
        fresh = Viewer(viewer.name, access, Place(), viewer.bucket)  # and a fresh key: the old one was used
        fresh.worker = asyncio.get_running_loop().create_task(self._work(fresh, viewer))
        viewer.place, viewer.is_back = None, True
        self._forget_the_gone()
        self._known[fresh.key] = fresh
        self.control.came(fresh.name)
        facts = {"version": __version__, "source": self._game.source, "access": access}
        fresh.say({"kind": "hello", **hello, **facts, "you": fresh.name, "again": fresh.key})
        self.audience.welcome(fresh)
        return fresh

    def depart(self, viewer: Viewer) -> None:
        """His page is gone; what he drives stands at once, what he has is kept for a while."""
        self.audience.farewell(viewer)
        while not viewer.waiting.empty():
            viewer.waiting.get_nowait()
        viewer.waiting.put_nowait(None)
        if viewer.place is None:  # he is back already, on another connection
            return
        viewer.place.end("gone")
        viewer.place = None
        viewer.gone_s = self._clock()
        self.control.went(viewer.name, viewer.gone_s)
        viewer.leaving = asyncio.get_running_loop().run_in_executor(self._hurry, self._left, viewer)

    async def tick(self) -> None:
        """Show the game, and see whose time is up; 20 times a second."""
        for person in self.control.expire(self._clock()):
            self._said("expired", f"{person} did not come back: control and role are free")
            self._forget(person)
        wanted = self.audience.wanted()
        try:
            seen = await asyncio.get_running_loop().run_in_executor(self._looks, self.audience.look, wanted)
            self.audience.show(seen)
        except Exception as error:
            self._said.error("the game cannot be shown", error)

    def _forget(self, person: str) -> None:
        for key in [key for key, viewer in self._known.items() if viewer.name == person]:
            del self._known[key]

    def _forget_the_gone(self) -> None:
        late_s = self._clock() - KEPT_S
        gone = [viewer for viewer in self._known.values() if viewer.place is None]
        gone = [v for v in gone if v.gone_s < late_s or len(self._known) > MOST_REMEMBERED]
        for viewer in gone:
            if not self.control.is_gone(viewer.name):
                self._known.pop(viewer.key, None)

    def _left(self, viewer: Viewer) -> None:
        try:
            self._game.leave(viewer.name)
        except Exception as error:
            self._said.error("a person left", error)

    # hearing

    def hear(self, viewer: Viewer, text: str | bytes) -> None:
        """One message. A stop is done here and now, before all else and at any rate."""
        hurry = isinstance(text, str) and len(text) < 200 and '"stop"' in text
        if not hurry and not viewer.allow(self._clock()):
            return
        try:
            if isinstance(text, bytes):
                raise ValueError("bad message: text is understood, bytes are not")
            message = parse(text)
        except ValueError as error:
            if not hurry or viewer.allow(self._clock()):
                viewer.say({"kind": "refused", "words": str(error)[:MOST_WORDS]})
            return
        if isinstance(message, messages.Stop):
            self._stop(viewer, message)
        elif hurry and not viewer.allow(self._clock()):
            return
        elif isinstance(message, messages.Ping):
            self._answer(viewer, message, "")
        elif isinstance(message, messages.Watch):
            viewer.why, viewer.lidar = message.why, message.lidar
            self._answer(viewer, message, "")
        elif viewer.access == "viewer" and not isinstance(message, messages.FOR_ALL):
            self._answer(viewer, message, "your link is view only; STOP still works")
        elif viewer.waiting.qsize() >= MOST_TEXTS - 1:  # one place is for the end
            self._answer(viewer, message, "too much at once: the game has not done yet what you asked for")
        else:
            viewer.waiting.put_nowait((message, self._stops))

    def _stop(self, viewer: Viewer, message: Message) -> None:
        """At once; while his last one is being done, the next waits, one for all that he says until then."""
        self._stops += 1
        if not viewer.stops or (message.id and len(viewer.stops) < MOST_TEXTS):  # without an id none is answered
            viewer.stops.append(message)
        if not viewer.is_stopping:
            self._stop_now(viewer)

    def _stop_now(self, viewer: Viewer) -> None:
        told, viewer.stops, viewer.is_stopping = viewer.stops, [], True

        def done(stopping: asyncio.Future[None]) -> None:
            if stopping.cancelled():
                return
            error = stopping.exception()
            if error is not None:
                self._said.error("a stop", error)
            for message in told:
                self._answer(viewer, message, "internal error" if error else "")
            viewer.is_stopping = False
            if viewer.stops:
                self._stop_now(viewer)

        loop = asyncio.get_running_loop()
        loop.run_in_executor(self._hurry, self._game.stop, viewer.name).add_done_callback(done)

    @staticmethod
    def _answer(viewer: Viewer, message: Message, words: str) -> None:
        """Empty words: done."""
        if message.id:
            viewer.say({"kind": "answer", "id": message.id, "ok": not words, "words": words, "data": None})
        elif words:
            viewer.say({"kind": "refused", "words": words})

    # doing

    async def _work(self, viewer: Viewer, before: Viewer) -> None:
        """Do what one person says, one after the other, until his page is gone; after what he said ``before``."""
        pending = [one for one in (before.worker, before.leaving) if one is not None]
        if pending:
            await asyncio.wait(pending)
            await self._resume_role(viewer)
        while (item := await viewer.waiting.get()) is not None:
            message, stops = item
            words = ""
            try:
                await self._do(viewer, message, stops)
            except Refused as refused:
                words = str(refused) or "refused"
            except Exception as error:
                self._said.error(f"what a page asked for ({type(message).__name__.lower()})", error)
                words = "internal error"
            if words:
                self._answer(viewer, message, words[:MOST_WORDS])
            if viewer.place is None and not viewer.is_back:  # he went while it was done
                await self.in_thread(self._left, viewer)

    async def _resume_role(self, viewer: Viewer) -> None:
        """He is back: the game has the person in the role again."""
        role = self.control.roles.of(viewer.name)
        if role is not None:
            try:
                await self.in_thread(self._game.handle, viewer.name, messages.Role(role=role))  # type: ignore[arg-type]
            except Exception:
                self.control.roles.leave(viewer.name)

    async def _do(self, viewer: Viewer, message: Message, stops: int) -> None:
        """Do it and answer.

        Raises:
            Refused: it is not done.
        """
        name, control = viewer.name, self.control
        if not isinstance(message, (*messages.FOR_ALL, *_FREE)):
            control.take(name)
        if isinstance(message, messages.Control):
            await self._change_control(name, message)
            self._answer(viewer, message, "")
        elif isinstance(message, messages.Release):
            await self._release(name, stops)
            self._answer(viewer, message, "")
        elif isinstance(message, messages.Role):
            await self._change_role(viewer, message)
        else:
            if isinstance(message, messages.Goal | messages.Drive):
                self._check_role(name, isinstance(message, messages.Drive))
            await self._tell(viewer, message)

    async def _tell(self, viewer: Viewer, message: Message) -> None:
        """Have the game do it; the answer, which may be long, is written in the thread too."""

        def tell() -> str:
            data = self._game.handle(viewer.name, message)
            if not message.id:
                return ""
            return as_json({"kind": "answer", "id": message.id, "ok": True, "words": "", "data": data})

        text = await self.in_thread(tell)
        if text and viewer.place is not None:
            viewer.place.put_text(text)

    async def _release(self, name: str, stops: int) -> None:
        """A stop that came after the release was said is stronger, whichever gets to the game first."""
        if stops != self._stops:
            raise Refused("stopped again meanwhile")
        await self.in_thread(self._game.release, name)
        if stops != self._stops:
            await self.in_thread(self._game.stop, name)
            raise Refused("stopped again meanwhile")

    async def _change_control(self, name: str, message: messages.Control) -> None:
        if message.what == "take":
            self.control.take(name)
        elif message.what == "ask":
            self.control.ask(name)
        else:
            self.control.give(name)
            if self._game.source == "ros" and self.control.roles.of(name) == ROBOT:
                self.control.roles.leave(name)
                await self.in_thread(self._game.handle, name, messages.Role(role="none"))

    async def _change_role(self, viewer: Viewer, message: messages.Role) -> None:
        name, before = viewer.name, self.control.roles.of(viewer.name)
        if message.role == ROBOT and self._game.source == "ros":
            self.control.take(name)
        if message.role == "none":
            self.control.roles.leave(name)
        else:
            self.control.roles.assume(name, message.role)
        try:
            await self._tell(viewer, message)
        except Exception:
            self.control.roles.leave(name)
            if before is not None:
                with contextlib.suppress(Refused):
                    self.control.roles.assume(name, before)
            raise

    def _check_role(self, name: str, driving: bool) -> None:
        role = self.control.roles.of(name)
        if role is None or (driving and role != ROBOT):
            raise Refused("take the robot's role first" if driving else "take a role first")
        if role == ROBOT and self._game.source == "ros":
            self.control.take(name)

    async def in_thread(self, work: Callable[..., Any], *arguments: Any) -> Any:
        """What ``work`` returns; meanwhile all else goes on."""
        return await asyncio.get_running_loop().run_in_executor(self._pool, work, *arguments)
