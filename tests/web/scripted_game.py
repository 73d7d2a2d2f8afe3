"""A game for the server's tests: it does nothing by itself, and remembers what it was asked."""

import threading
import time
from collections.abc import Callable
from typing import Any, Literal

from pacman_env.web import page_messages
from pacman_env.web.frame import Frame
from pacman_env.web.game_interface import Refused, Scene
from pacman_env.web.page_messages import Message

PICTURE = b"\x89PNG\r\n\x1a\n picture"


class ScriptedGame:
    """Frames count up with every look; ``on_handle`` answers, or refuses."""

    def __init__(
        self,
        on_handle: Callable[[str, Message], Any] | None = None,
        source: Literal["simulator", "ros"] = "simulator",
        moves: bool = True,
    ):
        self.source: Literal["simulator", "ros"] = source
        self.handled: list[tuple[str, Message]] = []  # in the order in which they came in
        self.calls: list[tuple[Any, ...]] = []  # name and arguments of all else
        self.polled_at: list[float] = []  # when a frame was asked for
        self.number = self.revision = 1
        self.state = "running"
        self.entries: list[dict[str, Any]] = []
        self.maps: dict[str, tuple[str, bytes]] = {}
        self.stories: dict[int, bytes] = {}
        self.fails: set[str] = set()  # names of calls
        self._on_handle, self._moves = on_handle, moves
        self._lock = threading.Lock()

    def _called(self, name: str, *arguments: Any, kept: bool = True) -> None:
        with self._lock:
            if kept:
                self.calls.append((name, *arguments))
        if name in self.fails:
            raise RuntimeError(f"{name} is broken")

    def close(self) -> None:
        self._called("close")

    def reset_options(self) -> None:
        self._called("reset_options")

    def choices(self) -> dict[str, Any]:
        self._called("choices", kept=False)
        return {"maps": ["house"]}

    def scene(self) -> Scene:
        return Scene(self.revision, {"map": {"name": "house"}, "home": [0.0, 0.0, float("nan")]}, PICTURE)

    def frame(self) -> Frame | None:
        self._called("frame", kept=False)
        self.polled_at.append(time.monotonic())
        self.number += self._moves
        return Frame(self.state, self.revision, self.number, time_s=self.number / 20)

    def news(self, after: int) -> list[dict[str, Any]]:
        return [entry for entry in self.entries if entry["number"] > after][-100:]

    def happens(self, **what: Any) -> None:
        self.entries.append({"number": len(self.entries) + 1, **what})

    def watch(self, *, why: bool, lidar: bool) -> None:
        self._called("watch", why, lidar)

    def handle(self, person: str, message: Message) -> Any:
        with self._lock:
            self.handled.append((person, message))
        self._called("handle", kept=False)
        if self._on_handle is not None:
            return self._on_handle(person, message)
        if isinstance(message, page_messages.PlaceClyde):
            raise Refused("not in the menu")
        return None

    def stop(self, person: str) -> None:
        self._called("stop", person)

    def release(self, person: str) -> None:
        self._called("release", person)

    def leave(self, person: str) -> None:
        self._called("leave", person)

    def add_map(self, name: str, yaml: str, image: bytes) -> dict[str, Any]:
        self._called("add_map", name, len(image))
        if "refuse" in yaml:
            raise Refused("nowhere to drive")
        self.maps[name] = yaml, image
        return {"map": name, "words": "12 pellets"}

    def story(self, number: int) -> bytes | None:
        return self.stories.get(number)
