"""The people who look: what waits for each of them, how much they may say, and what all of them are shown."""

from __future__ import annotations

import asyncio
import secrets
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from pacman_env.web.access import Kind
from pacman_env.web.frame import Frame
from pacman_env.web.game import Game, Scene
from pacman_env.web.messages import Message, as_json

MOST_TEXTS = 64  # that wait for one viewer
MOST_BYTES = 4 << 20  # of them
MESSAGES_PER_S = 50.0
PATIENCE = 250  # messages over the rate, until the connection is closed
MOST_PICTURES = 4  # of the last scenes


class Place:
    """What waits for one viewer: texts in their order, and the newest frame alone."""

    def __init__(self, most_texts: int = MOST_TEXTS, most_bytes: int = MOST_BYTES):
        self._most = most_texts, most_bytes
        self._texts: deque[str] = deque()
        self._bytes = 0
        self._frame: str | None = None
        self._wake = asyncio.Event()
        self.ended = asyncio.Event()
        self.why_ended = ""

    def put_frame(self, frame: str) -> None:
        """The newest frame; one that still waits is forgotten."""
        if not self.ended.is_set():
            self._frame = frame
            self._wake.set()

    def put_text(self, text: str) -> None:
        """One more text; where too many wait, the viewer is told so and nothing else any more."""
        if self.ended.is_set():
            return
        if len(self._texts) >= self._most[0] or self._bytes + len(text) > self._most[1]:
            self.end("too slow: your connection does not take what is said to it")
            return
        self._texts.append(text)
        self._bytes += len(text)
        self._wake.set()

    def end(self, words: str) -> None:
        """Say good bye; what waits is forgotten."""
        if not self.ended.is_set():
            self._texts = deque([as_json({"kind": "bye", "words": words})])
            self._frame = None
            self.why_ended = words
            self.ended.set()
            self._wake.set()

    async def take(self) -> list[str]:
        """What waits, at least one thing: the texts, then the frame. Empty: that was all for ever."""
        while not self._texts and self._frame is None:
            if self.ended.is_set():
                return []
            self._wake.clear()
            await self._wake.wait()
        things = [*self._texts]
        if self._frame is not None:
            things.append(self._frame)
        self._texts.clear()
        self._bytes, self._frame = 0, None
        return things


class Bucket:
    """How much one may say: ``rate`` messages a second, and as many at once."""

    def __init__(self, rate: float, now: float):
        self._rate = self._left = rate
        self._at = now

    def spend(self, now: float) -> bool:
        """Whether one more message is within the rate."""
        self._left = min(self._rate, self._left + (now - self._at) * self._rate)
        self._at = now
        if self._left < 1.0:
            return False
        self._left -= 1.0
        return True


@dataclass
class Viewer:
    """One who looks. His name stays when his page comes back with its key.

    Attributes:
        name: shown to the others.
        access: what his token is for.
        place: of his connection; None: his page is gone.
        bucket: of his messages.
        key: by which his page, and no other, comes back.
        over: messages over the rate, lately; ``told_s``: when he was told so.
        waiting: what he has said and has not been done yet.
        why, lidar: what his page shows.
        stops: that wait for the one before them, while ``is_stopping``.
        gone_s: when his page went away; ``is_back``: it has come back, and another of these stands for him.
        worker: does one after the other; ``leaving``: the game is being told that he went.
    """

    name: str
    access: Kind
    place: Place | None
    bucket: Bucket
    key: str = field(default_factory=lambda: secrets.token_urlsafe(16))
    over: int = 0
    told_s: float = -1.0
    waiting: asyncio.Queue[tuple[Message, int] | None] = field(default_factory=lambda: asyncio.Queue(MOST_TEXTS))
    why: bool = False
    lidar: bool = False
    gone_s: float = 0.0
    is_back: bool = False
    stops: list[Message] = field(default_factory=list)
    is_stopping: bool = False
    worker: asyncio.Task[None] | None = None
    leaving: asyncio.Future[None] | None = None

    def allow(self, now: float) -> bool:
        """Whether he may say one more thing; if not he is told so once a second, and at last sent away."""
        if self.bucket.spend(now):
            return True
        if now - self.told_s >= 1.0:
            if self.told_s >= 0.0 and now - self.told_s >= 2.0:
                self.over = 0  # he has kept to it for a while
            self.told_s = now
            self.say({"kind": "refused", "words": "too many messages: some are not heard"})
        self.over += 1
        if self.over >= PATIENCE and self.place is not None:
            self.place.end("too many messages")
        return False

    def say(self, message: dict[str, Any]) -> None:
        """Tell him something."""
        if self.place is not None:
            self.place.put_text(as_json(message))


@dataclass(frozen=True)
class Seen:
    """How a game stood at one look."""

    scene: Scene
    news: list[dict[str, Any]]
    frame: Frame | None
    encoded: str


class Audience:
    """All who look at a game. :meth:`look` asks the game, in any thread; :meth:`show` tells what is new.

    Args:
        game: what they look at.
        most: viewers at once; operators may be a few more, that no crowd keeps them out.
        people: what is said of who does what.
    """

    def __init__(self, game: Game, most: int, people: Callable[[], dict[str, Any]]):
        self.here: list[Viewer] = []
        self.pictures: dict[int, bytes] = {}
        self._fresh: list[Viewer] = []  # who has not been shown anything yet
        self._game = game
        self._most = most
        self._people = people
        self._number: int | None = None
        self._frame = ""
        self._scene: Scene | None = None
        self._scene_text = ""
        self._news: int | None = None  # the last that was told; None: from now on
        self._people_text = ""
        self._watched = (False, False)

    def has_room(self, access: Kind, arriving: int = 0) -> bool:
        """Whether one more may look, beside those who are about to."""
        return len(self.here) + arriving < self._most + (10 if access == "operator" else 0)

    def welcome(self, viewer: Viewer) -> None:
        """One more looks: at the next look he is shown all there is, and then what is new."""
        self.here.append(viewer)
        self._fresh.append(viewer)

    def farewell(self, viewer: Viewer) -> None:
        """One looks no more."""
        for some in (self.here, self._fresh):
            if viewer in some:
                some.remove(viewer)

    def wanted(self) -> tuple[bool, bool] | None:
        """Whether anybody looks at the terms, and at the lidar; None: nobody is here."""
        return (any(v.why for v in self.here), any(v.lidar for v in self.here)) if self.here else None

    def look(self, wanted: tuple[bool, bool] | None) -> Seen | None:
        """Ask the game; None: nobody wants to know."""
        why, lidar = wanted or (False, False)
        if (why, lidar) != self._watched:
            self._game.watch(why=why, lidar=lidar)
            self._watched = (why, lidar)
        if wanted is None:
            return None
        frame = self._game.frame()
        scene = self._scene
        if scene is None or frame is None or frame.revision != scene.revision:
            scene = self._game.scene()
        news = self._game.news(self._news or 0)
        encoded = frame.encode() if frame is not None and frame.number != self._number else ""
        return Seen(scene, news, frame, encoded)

    def show(self, seen: Seen | None) -> None:
        """Tell all what is new, and those who have just come all there is."""
        if seen is None:
            self._news, self._number, self._frame, self._scene = None, None, "", None
            return
        if self._scene is None or seen.scene.revision != self._scene.revision:
            self._change_scene(seen.scene)
            self._tell(self._scene_text, [v for v in self.here if v not in self._fresh])
        self._tell(self._scene_text, self._fresh)
        if self._news is not None:
            self._tell_news(seen.news)
        self._news = max((item["number"] for item in seen.news), default=self._news or 0)
        people = as_json({"kind": "people", **self._people()})
        self._tell(people, self._fresh if people == self._people_text else self.here)
        self._people_text = people
        if seen.encoded and seen.frame is not None:
            self._number, self._frame = seen.frame.number, seen.encoded
        if self._frame:
            for viewer in self.here if seen.encoded else self._fresh:
                if viewer.place is not None:
                    viewer.place.put_frame(self._frame)
        self._fresh = []

    def _change_scene(self, scene: Scene) -> None:
        facts = dict(scene.facts)
        if facts.get("map"):
            facts["map"] = {**facts["map"], "url": f"/map/{scene.revision}.png"}
        self._scene_text = as_json({**facts, "kind": "scene", "revision": scene.revision})
        self._scene = scene
        self.pictures.pop(scene.revision, None)
        self.pictures[scene.revision] = scene.picture
        while len(self.pictures) > MOST_PICTURES:
            del self.pictures[next(iter(self.pictures))]

    def _tell_news(self, items: list[dict[str, Any]]) -> None:
        """The terms only to those who look at them: they are long."""
        plain = [item for item in items if "why" not in item]
        for some, looks in ((items, True), (plain, False)):
            if some:
                text = as_json({"kind": "news", "items": some})
                self._tell(text, [v for v in self.here if v.why == looks])

    @staticmethod
    def _tell(text: str, viewers: list[Viewer]) -> None:
        for viewer in viewers:
            if viewer.place is not None:
                viewer.place.put_text(text)
