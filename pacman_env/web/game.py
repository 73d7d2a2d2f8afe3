"""What the server requires of a game, simulated or of a robot's nodes: the interface, its scene and its news."""

import threading
from collections import deque
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

from pacman_env.web.frame import Frame
from pacman_env.web.messages import Message

MOST_NEWS = 100


class Refused(ValueError):
    """A request of a person is refused; its text is the reason, shown on the page."""


@dataclass(frozen=True)
class Scene:
    """What stays the same from frame to frame."""

    revision: int  # counts up from 1; a frame names the scene it belongs to
    facts: dict[str, Any] = field(default_factory=dict)  # as JSON (docs/web_protocol.md, "scene")
    picture: bytes = b""  # the map as a PNG, one pixel a cell, top row first; empty: no map yet


class News:
    """The last events of a game, numbered from 1; any thread may add and read."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._entries: deque[dict[str, Any]] = deque(maxlen=MOST_NEWS)
        self._number = 0

    def add(self, **entry: Any) -> None:
        """``event``, ``light``, ``sound``, ``state`` (a word), ``words`` (a line of the log), ``why`` or ``story``."""
        with self._lock:
            self._number += 1
            if "why" in entry:  # only the newest is of use, and they are long
                for old in [one for one in self._entries if "why" in one]:
                    self._entries.remove(old)
            self._entries.append({"number": self._number, **entry})

    def after(self, number: int) -> list[dict[str, Any]]:
        with self._lock:
            return [entry for entry in self._entries if entry["number"] > number]


class Game(Protocol):
    """Every method may be called from any thread, and only ``handle`` waits for the game's next tick."""

    source: Literal["simulator", "ros"]

    def close(self) -> None: ...  # a robot stands then
    def greet(
        self,
    ) -> None: ...  # a new person is the only one: what the last one chose for watching is as at the start
    def choices(self) -> dict[str, Any]: ...  # what a setup can name (docs/web_protocol.md, "choices")
    def scene(self) -> Scene: ...
    def frame(self) -> Frame | None: ...  # None: nothing is known yet
    def news(self, after: int) -> list[dict[str, Any]]: ...  # those after a number, at most 100, oldest first
    def watch(self, *, why: bool, lidar: bool) -> None: ...  # whether any page shows the terms and the lidar now
    def handle(self, person: str, message: Message) -> Any: ...  # ``data`` of the answer, or Refused: nothing changed
    def stop(self, person: str) -> None: ...  # the robot, at once, until ``release``; may be repeated
    def release(self, person: str) -> None: ...
    def leave(self, person: str) -> None: ...  # the person's role is free, and what was driven by hand stands
    def story(self, number: int) -> bytes | None: ...  # frames of a recorded round, as a JSON list; None: no such one

    def add_map(self, name: str, yaml: str, image: bytes) -> dict[str, Any]:
        """Let a map be chosen, or raise Refused; returns its name as ``map``, the checker's report as ``words``."""
