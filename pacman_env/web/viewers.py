"""The people who look: what waits for each of them, how much they may say, and what all of them are shown."""

from __future__ import annotations

import asyncio
import secrets
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from pacman_env.web.access import Kind
from pacman_env.web.game import Game, Scene
from pacman_env.web.messages import Message, as_json
from pacman_env.web.said import Said

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
        self._frame: bytes | None = None
        self._wake = asyncio.Event()
        self.ended = asyncio.Event()
        self.why_ended = ""

    def put_frame(self, frame: bytes) -> None:
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

    async def take(self) -> list[str | bytes]:
        """What waits, at least one thing: the texts, then the frame. Empty: that was all for ever."""
        while not self._texts and self._frame is None:
            if self.ended.is_set():
                return []
            self._wake.clear()
            await self._wake.wait()
        things: list[str | bytes] = [*self._texts]
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
        gone_s: when his page went away; ``is_back``: it has come back, and another of these stands for him.
        worker: does one after the other.
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
    worker: asyncio.Task[None] | None = None

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


class Audience:
    """All who look at a game; :meth:`show` is called 20 times a second.

    Args:
        game: what they look at.
        said: told what goes wrong.
        most: viewers at once; operators may be a few more, that no crowd keeps them out.
        people: what is said of who does what.
    """

    def __init__(self, game: Game, said: Said, most: int, people: Callable[[], dict[str, Any]]):
        self.here: list[Viewer] = []
        self.pictures: dict[int, bytes] = {}
        self._game = game
        self._said = said
        self._most = most
        self._people = people
        self._frame = b""
        self._number: int | None = None
        self._scene = ""
        self._revision: int | None = None
        self._news = 0
        self._told_people = ""
        self._watched = (False, False)

    def has_room(self, access: Kind) -> bool:
        """Whether one more may look."""
        return len(self.here) < self._most + (10 if access == "operator" else 0)

    def welcome(self, viewer: Viewer, hello: dict[str, Any]) -> None:
        """One more looks: what is there is said to him, and then what comes.

        Raises:
            Exception: the game cannot say what there is.
        """
        assert viewer.place is not None
        place = viewer.place
        if not self.here:
            self._news = max((item["number"] for item in self._game.news(0)), default=0)  # from now on
        place.put_text(as_json({"kind": "hello", **self._game.hello(), **hello}))
        if self.look_at_scene(self._game.scene()):
            self._tell(self._scene)
        place.put_text(self._scene)
        self.here.append(viewer)
        self._told_people = ""  # all hear of it, he too
        if self._frame:
            place.put_frame(self._frame)

    def farewell(self, viewer: Viewer) -> None:
        """One looks no more."""
        if viewer in self.here:
            self.here.remove(viewer)

    def show(self) -> None:
        """Look at the game, and tell all what is new."""
        if not self.here:
            self._watch(False, False)
            self._frame, self._number = b"", None
            return
        try:
            self._watch(any(v.why for v in self.here), any(v.lidar for v in self.here))
            self._show_game()
        except Exception as error:
            self._said.error("the game cannot be shown", error)
        people = as_json({"kind": "people", **self._people()})
        if people != self._told_people:
            self._told_people = people
            self._tell(people)

    def look_at_scene(self, scene: Scene) -> bool:
        """Whether this scene is another than the last; its picture is kept for those who ask for it."""
        if scene.revision == self._revision:
            return False
        facts = dict(scene.facts)
        if facts.get("map"):
            facts["map"] = {**facts["map"], "url": f"/map/{scene.revision}.png"}
        self._scene = as_json({**facts, "kind": "scene", "revision": scene.revision})
        self._revision = scene.revision
        self.pictures.pop(scene.revision, None)
        self.pictures[scene.revision] = scene.picture
        while len(self.pictures) > MOST_PICTURES:
            del self.pictures[next(iter(self.pictures))]
        return True

    def _show_game(self) -> None:
        frame = self._game.frame()
        if (frame is None or frame.revision != self._revision) and self.look_at_scene(self._game.scene()):
            self._tell(self._scene)
        items = self._game.news(self._news)
        if items:
            self._news = max(item["number"] for item in items)
            plain = [item for item in items if "why" not in item]
            full = as_json({"kind": "news", "items": items})
            others = full if len(plain) == len(items) else as_json({"kind": "news", "items": plain}) if plain else ""
            for viewer in self.here:
                text = full if viewer.why else others
                if text and viewer.place is not None:
                    viewer.place.put_text(text)
        if frame is not None and frame.number != self._number:
            self._number = frame.number
            self._frame = frame.encode()
            for viewer in self.here:
                if viewer.place is not None:
                    viewer.place.put_frame(self._frame)

    def _tell(self, text: str) -> None:
        for viewer in self.here:
            if viewer.place is not None:
                viewer.place.put_text(text)

    def _watch(self, why: bool, lidar: bool) -> None:
        if (why, lidar) != self._watched:
            self._game.watched(why=why, lidar=lidar)
            self._watched = (why, lidar)
