"""Check who may send a message to the game, and let the game handle it in a separate thread."""

import asyncio
import contextlib
import threading
from collections.abc import Callable
from concurrent.futures import Future
from functools import partial
from typing import Any, TypeVar

from pacman_env.web import page_messages
from pacman_env.web.game_interface import Game, Refused
from pacman_env.web.page_messages import Message
from pacman_env.web.roles import ROBOT, RoleControl

MOST_THREADS = 32  # most requests that the game handles at the same time
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


class RequestHandler:
    def __init__(self, game: Game):
        self.control = RoleControl()
        self.stops = 0  # number of stops from all people
        # The game is never called in the thread of the connections, because any call may take long.
        self.in_thread = partial(in_thread, asyncio.Semaphore(MOST_THREADS))
        self._game = game

    async def carry_out(self, name: str, message: Message, stops: int) -> Any:
        """Handle a message of a person and return the answer's data; a refused message changes nothing.

        ``stops`` is the number of stops that had arrived before the message.
        """
        role, on_robot = self.control.roles.of(name), self._game.source == "ros"
        if not isinstance(message, (*page_messages.FOR_ALL, *_FREE)):
            self.control.take(name)
        match message:
            case page_messages.Role():
                return await self._change_role(name, message, role)
            case page_messages.Control(what=what):
                getattr(self.control, what)(name)
                if what != "give" or not on_robot or role != ROBOT:
                    return None
                self.control.roles.leave(name)
                message = page_messages.Role(role="none")
            case page_messages.Release():
                return await self._release(name, stops)
            case page_messages.Drive() if role != ROBOT:
                raise Refused("choose the robot's role in the tab Play first")
            case page_messages.Goal() if role is None:
                raise Refused("choose a role in the tab Play first")
            case page_messages.Goal() | page_messages.Drive() if on_robot and role == ROBOT:
                self.control.take(name)
        return await self.in_thread(self._game.handle, name, message)

    async def _release(self, name: str, stops: int) -> None:
        """Release the robot, unless a stop arrives meanwhile: a later stop wins, whichever reaches the game first."""
        if stops == self.stops:
            await self.in_thread(self._game.release, name)
            if stops == self.stops:
                return
            await self.in_thread(self._game.stop, name)
        raise Refused("stopped again meanwhile")

    async def _change_role(self, name: str, message: page_messages.Role, before: str | None) -> Any:
        roles = self.control.roles
        if message.role == ROBOT and self._game.source == "ros":
            self.control.take(name)
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
