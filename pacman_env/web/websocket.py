"""The websocket: one conversation for each page."""

from __future__ import annotations

import asyncio
import contextlib
from typing import Any

from starlette.websockets import WebSocket, WebSocketDisconnect

from pacman_env.web.access import refuse
from pacman_env.web.desk import Desk
from pacman_env.web.said import Said
from pacman_env.web.viewers import Viewer

GOODBYE_S = 0.5


class Conversations:
    """All that are open.

    Args:
        desk: hears what pages say.
        said: told what goes wrong.
    """

    def __init__(self, desk: Desk, said: Said):
        self._desk = desk
        self._said = said
        self._open: set[asyncio.Task[Any]] = set()
        self._ending = False
        self._arriving = 0

    async def end(self) -> None:
        """Say good bye to everybody, and let nobody in any more."""
        self._ending = True
        for viewer in list(self._desk.audience.here):
            if viewer.place is not None:
                viewer.place.end("the server ends")
        if self._open:
            await asyncio.wait(self._open, timeout=GOODBYE_S)

    async def serve(self, socket: WebSocket) -> None:
        """One page, from its connection to its end."""
        access = socket.scope["access"]
        if self._ending or not self._desk.audience.has_room(access, self._arriving):
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
        self._open.add(task)
        try:
            await self._converse(socket, viewer)
        finally:
            self._open.discard(task)
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
                    1001 if self._ending else 1008, place.why_ended.encode()[:100].decode(errors="ignore")
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
