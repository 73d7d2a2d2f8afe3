"""Connected viewers: their outboxes and rate limits, and updates for all of them."""

import asyncio
import secrets
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from pacman_env.web.access import Kind
from pacman_env.web.frame import Frame
from pacman_env.web.game import Game, Scene
from pacman_env.web.messages import Message, as_json

MOST_TEXTS = 64  # waiting texts per viewer
MOST_BYTES = 4 << 20  # size of the waiting texts per viewer
MESSAGES_PER_S = 50.0
PATIENCE = 250  # messages over the rate before the connection is closed
MOST_PICTURES = 4  # maps of the last scenes
MORE_OPERATORS = 10  # beyond the limit of viewers, so that a crowd cannot lock operators out


class Outbox:
    """Queue of one connection: texts in order, and only the newest frame."""

    def __init__(self) -> None:
        self.ended = asyncio.Event()
        self.why_ended = ""
        self._texts: deque[str] = deque()
        self._bytes = 0
        self._frame: str | None = None
        self._wake = asyncio.Event()

    def put_frame(self, frame: str) -> None:
        if not self.ended.is_set():
            self._frame = frame
            self._wake.set()

    def put_text(self, text: str) -> None:
        if self.ended.is_set():
            return
        if len(self._texts) >= MOST_TEXTS or self._bytes + len(text) > MOST_BYTES:
            self.end("too slow: your connection does not receive what is sent to it")
            return
        self._texts.append(text)
        self._bytes += len(text)
        self._wake.set()

    def end(self, words: str) -> None:
        """Replace everything that waits by ``bye``, and send nothing afterwards."""
        if not self.ended.is_set():
            self._texts = deque([as_json({"kind": "bye", "words": words})])
            self._frame = None
            self.why_ended = words
            self.ended.set()
            self._wake.set()

    async def get(self) -> list[str]:
        """Wait for at least one text or frame and return everything that waits; empty after the end."""
        while not self._texts and self._frame is None:
            if self.ended.is_set():
                return []
            self._wake.clear()
            await self._wake.wait()
        waiting = [*self._texts, *([] if self._frame is None else [self._frame])]
        self._texts.clear()
        self._bytes, self._frame = 0, None
        return waiting


class RateLimit:
    """Token bucket that allows ``rate`` messages per second, and bursts of the same size."""

    def __init__(self, rate: float, now: float):
        self._rate = self._left = rate
        self._at = now

    def allows(self, now: float) -> bool:
        self._left = min(self._rate, self._left + (now - self._at) * self._rate)
        self._at = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


@dataclass(eq=False)
class Viewer:
    """A connection of a page; a page that comes back with its key keeps the person's name."""

    name: str  # shown to others
    access: Kind
    rate_limit: RateLimit
    outbox: Outbox = field(default_factory=Outbox)
    key: str = field(default_factory=lambda: secrets.token_urlsafe(16))
    is_fresh: bool = True  # nothing has been sent to it yet
    why: bool = False  # the page shows the terms
    lidar: bool = False
    gone_s: float | None = None  # time when the page was closed
    is_replaced: bool = False  # by a newer connection of the same person
    waiting: asyncio.Queue[tuple[Message, int] | None] = field(default_factory=lambda: asyncio.Queue(MOST_TEXTS))
    stops: list[Message] = field(default_factory=list)  # waiting for the present stop
    stopping: asyncio.Task[None] | None = None
    worker: asyncio.Task[None] | None = None  # processes ``waiting`` in order
    leaving: asyncio.Task[str] | None = None
    over: int = 0  # recent messages over the rate
    _warned_s: float = -1.0

    def is_within_rate(self, now: float) -> bool:
        if self.rate_limit.allows(now):
            return True
        if now - self._warned_s >= 1.0:
            if self._warned_s >= 0.0 and now - self._warned_s >= 2.0:
                self.over = 0  # it was within the rate for a while
            self._warned_s = now
            self.send({"kind": "refused", "words": "too many messages: some are ignored"})
        self.over += 1
        if self.over >= PATIENCE:
            self.outbox.end("too many messages")
        return False

    def send(self, message: dict[str, Any]) -> None:
        self.outbox.put_text(as_json(message))


class Update(NamedTuple):
    scene: Scene
    news: list[dict[str, Any]]
    frame: Frame | None
    encoded: str  # the frame; empty: unchanged


class Audience:
    """All viewers of a game: :meth:`poll` queries the game, in any thread, and :meth:`send` sends the changes."""

    def __init__(self, game: Game, most: int, people: Callable[[], dict[str, Any]]):
        self.viewers: list[Viewer] = []
        self.pictures: dict[int, bytes] = {}  # by the scene's revision
        self._game, self._most, self._people = game, most, people
        self._number: int | None = None
        self._frame = ""
        self._scene: Scene | None = None
        self._scene_text = ""
        self._news: int | None = None  # last sent number; None: only send later news
        self._people_text = ""
        self._watched = (False, False)

    def has_room(self, access: Kind, arriving: int = 0) -> bool:
        return len(self.viewers) + arriving < self._most + (MORE_OPERATORS if access == "operator" else 0)

    def remove(self, viewer: Viewer) -> None:
        if viewer in self.viewers:
            self.viewers.remove(viewer)

    def poll(self) -> Update | None:
        viewers = tuple(self.viewers)
        why, lidar = any(v.why for v in viewers), any(v.lidar for v in viewers)
        if (why, lidar) != self._watched:
            self._game.watch(why=why, lidar=lidar)
            self._watched = (why, lidar)
        if not viewers:
            return None
        frame, scene = self._game.frame(), self._scene
        if scene is None or frame is None or frame.revision != scene.revision:
            scene = self._game.scene()
        news = self._game.news(self._news or 0)
        encoded = frame.encode() if frame is not None and frame.number != self._number else ""
        return Update(scene, news, frame, encoded)

    def send(self, update: Update | None) -> None:
        """Send changes to all viewers, and everything to viewers that are new since the last update."""
        if update is None:
            self._news, self._number, self._frame, self._scene = None, None, "", None
            return
        scene_changed = self._scene is None or update.scene.revision != self._scene.revision
        if scene_changed:
            self._change_scene(update.scene)
        news = [] if self._news is None else update.news
        self._news = max((item["number"] for item in update.news), default=self._news or 0)
        without_why = [item for item in news if "why" not in item]  # only pages that show the long terms get them
        news_texts = {
            why: as_json({"kind": "news", "items": items}) if items else ""
            for why, items in ((True, news), (False, without_why))
        }
        previous, self._people_text = self._people_text, as_json({"kind": "people", **self._people()})
        if update.encoded and update.frame is not None:
            self._number, self._frame = update.frame.number, update.encoded
        for viewer in self.viewers:
            if viewer.is_fresh or scene_changed:
                viewer.outbox.put_text(self._scene_text)
            if news_texts[viewer.why]:
                viewer.outbox.put_text(news_texts[viewer.why])
            if viewer.is_fresh or self._people_text != previous:
                viewer.outbox.put_text(self._people_text)
            if self._frame and (viewer.is_fresh or update.encoded):
                viewer.outbox.put_frame(self._frame)
            viewer.is_fresh = False

    def _change_scene(self, scene: Scene) -> None:
        facts = dict(scene.facts)
        if facts.get("map"):
            facts["map"] = {**facts["map"], "url": f"map/{scene.revision}.png"}
        self._scene_text = as_json({**facts, "kind": "scene", "revision": scene.revision})
        self._scene = scene
        self.pictures.pop(scene.revision, None)
        self.pictures[scene.revision] = scene.picture
        while len(self.pictures) > MOST_PICTURES:
            del self.pictures[next(iter(self.pictures))]
