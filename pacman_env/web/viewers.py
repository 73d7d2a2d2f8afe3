"""Connected viewers: their queues, their rate limits, and the news for all of them."""

import asyncio
import secrets
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from pacman_env import __version__
from pacman_env.web.access import Kind
from pacman_env.web.frame import Frame
from pacman_env.web.game_interface import Game, Scene
from pacman_env.web.page_messages import Message, as_json
from pacman_env.web.vocabulary import vocabulary

MOST_TEXTS = 64  # queued texts per viewer
MOST_BYTES = 4 << 20  # most bytes of queued texts per viewer
MESSAGES_PER_S = 50.0  # per viewer; also the largest burst
PATIENCE = 250  # messages above the rate after which the connection is closed
MOST_PICTURES = 4  # pictures of the last scenes
MORE_OPERATORS = 10  # places for operators beyond the limit of viewers


class Outbox:
    """Queue of one connection: all texts in order, and only the newest frame."""

    def __init__(self) -> None:
        self.why_ended = ""
        self._texts: list[str] = []
        self._frame = ""
        self._wake = asyncio.Event()  # something waits, or the end has come

    def put_frame(self, frame: str) -> None:
        if not self.why_ended:
            self._frame = frame
            self._wake.set()

    def put_text(self, text: str) -> None:
        if self.why_ended:
            return
        self._texts.append(text)
        self._wake.set()
        if len(self._texts) > MOST_TEXTS or sum(map(len, self._texts)) > MOST_BYTES:
            self.end("your connection is too slow for the game")

    def end(self, words: str) -> None:
        """Replace all waiting texts and frames by a last message ``bye`` with these words."""
        if not self.why_ended:
            self._texts, self._frame = [as_json({"kind": "bye", "words": words})], ""
            self.why_ended = words
            self._wake.set()

    async def get(self) -> list[str]:
        """Wait for at least one text or frame and return the queue; empty after the end."""
        await self._wake.wait()
        waiting = [*self._texts, self._frame] if self._frame else self._texts
        self._texts, self._frame = [], ""
        if not self.why_ended:
            self._wake.clear()
        return waiting


@dataclass(eq=False)
class Viewer:
    """One connection of a page; a page that reconnects with its key keeps the name of the person."""

    name: str  # shown to other people
    access: Kind
    turn: asyncio.Lock = field(default_factory=asyncio.Lock)  # turn of the person: one message is handled at a time
    outbox: Outbox = field(default_factory=Outbox)
    key: str = field(default_factory=lambda: secrets.token_urlsafe(16))
    is_fresh: bool = True  # nothing has been sent yet
    why: bool = False  # the page shows the terms
    lidar: bool = False
    gone_s: float | None = None  # time when the page disconnected, s
    is_replaced: bool = False  # True: replaced by another connection of the same person
    waiting: int = 0  # messages that wait for their turn
    stops: list[Message] = field(default_factory=list)  # STOP messages to answer once the current stop is done
    is_stopping: bool = False
    leaving: asyncio.Task[str] | None = None
    _allowance: float = MESSAGES_PER_S  # messages; negative: above the rate
    _allowed_s: float = field(default_factory=time.monotonic)

    def is_within_rate(self, now: float) -> bool:
        left = min(MESSAGES_PER_S, self._allowance + (now - self._allowed_s) * MESSAGES_PER_S)
        self._allowance, self._allowed_s = left - 1.0, now
        if 0.0 <= left < 1.0:  # the first one above the rate
            self.send({"kind": "refused", "words": "too many messages: some are ignored"})
        if left < -PATIENCE:
            self.outbox.end("too many messages")
        return left >= 1.0

    def send(self, message: dict[str, Any]) -> None:
        self.outbox.put_text(as_json(message))

    def answer(self, message: Message, refusal: str = "", data: Any = None) -> None:
        if message.id:
            self.send({"kind": "answer", "id": message.id, "ok": not refusal, "words": refusal, "data": data})
        elif refusal:
            self.send({"kind": "refused", "words": refusal})


class Update(NamedTuple):
    viewers: tuple[Viewer, ...]
    choices: dict[str, Any]  # choices for viewers that connected since the last update
    scene: Scene
    news: list[dict[str, Any]]
    frame: Frame | None
    encoded: str  # the frame as JSON, or an empty string


class Audience:
    """All viewers of a game. :meth:`poll` asks the game, in any thread; :meth:`send` sends the news."""

    def __init__(self, game: Game, most: int, people: Callable[[], dict[str, Any]]):
        self.viewers: list[Viewer] = []
        self.pictures: dict[int, bytes] = {}  # pictures by revision of the scene
        self._game, self._most, self._people = game, most, people
        self._options_due = False  # True: reset the options at the next poll, because a person came to an unused page
        self._frame = ""
        self._scene: Scene | None = None
        self._scene_text = ""
        self._news: int | None = None  # number of the news sent last; None: send only future news
        self._people_text = ""
        self._watched = (False, False)
        self._run = secrets.token_hex(8)  # differs after a restart: its games, rounds and roles are new

    def has_room(self, access: Kind) -> bool:
        return len(self.viewers) < self._most + (MORE_OPERATORS if access == "operator" else 0)

    def add(self, viewer: Viewer, is_new: bool) -> None:
        self._options_due |= is_new and not self.viewers
        self.viewers.append(viewer)

    def remove(self, viewer: Viewer) -> None:
        self.viewers = [other for other in self.viewers if other is not viewer]

    def poll(self) -> Update | None:
        viewers = tuple(self.viewers)
        watched = any(v.why for v in viewers), any(v.lidar for v in viewers)
        if watched != self._watched:
            self._game.watch(why=watched[0], lidar=watched[1])
            self._watched = watched
        if not viewers:
            return None
        if self._options_due:
            self._game.reset_options()
            self._options_due = False
        choices = self._game.choices() if any(viewer.is_fresh for viewer in viewers) else {}
        frame, scene = self._game.frame(), self._scene
        if scene is None or frame is None or frame.revision != scene.revision:
            scene = self._game.scene()
        news = self._game.news(self._news or 0)
        return Update(viewers, choices, scene, news, frame, frame.encode() if frame is not None else "")

    def send(self, update: Update | None) -> None:
        """Send the news to all viewers, and the whole state to viewers that connected since the last update."""
        if update is None:
            self._news, self._scene = None, None
            return
        scene_changed = self._scene is None or update.scene.revision != self._scene.revision
        if scene_changed:
            self._change_scene(update.scene)
        news = [] if self._news is None else update.news
        self._news = max((item["number"] for item in update.news), default=self._news or 0)
        without_why = [item for item in news if "why" not in item]  # long: sent only to pages that show them
        people_before, self._people_text = self._people_text, as_json({"kind": "people", **self._people()})
        frame_before, self._frame = self._frame, update.encoded
        for viewer in update.viewers:
            if viewer.is_fresh:
                viewer.send(self._hello(viewer, update.choices))
            if viewer.is_fresh or scene_changed:
                viewer.outbox.put_text(self._scene_text)
            if items := news if viewer.why else without_why:
                viewer.send({"kind": "news", "items": items})
            if viewer.is_fresh or self._people_text != people_before:
                viewer.outbox.put_text(self._people_text)
            if self._frame and (viewer.is_fresh or self._frame != frame_before):
                viewer.outbox.put_frame(self._frame)
            viewer.is_fresh = False

    def _hello(self, viewer: Viewer, choices: dict[str, Any]) -> dict[str, Any]:
        facts = {"version": __version__, "source": self._game.source, "access": viewer.access, "choices": choices}
        person = {"you": viewer.name, "again": viewer.key, "run": self._run}
        return {"kind": "hello", **vocabulary(self._game.source), **facts, **person}

    def _change_scene(self, scene: Scene) -> None:
        facts = {**scene.facts, "kind": "scene", "revision": scene.revision}
        if facts.get("map"):
            facts["map"] = {**facts["map"], "url": f"map/{scene.revision}.png"}
        self._scene, self._scene_text = scene, as_json(facts)
        self.pictures = dict([*self.pictures.items(), (scene.revision, scene.picture)][-MOST_PICTURES:])
