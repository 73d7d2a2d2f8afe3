"""Interface between the server and a game (simulated, or of a robot's nodes): game, scene and news."""

import threading
from collections import deque
from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

from pacman_env.web.frame import Frame
from pacman_env.web.page_messages import Message

MOST_NEWS = 100


IN_PROGRESS = "a round is in progress: press Reset to end it"


class Refused(ValueError):
    """Raised if a person's request is refused; the text is the reason, which the page shows."""


@dataclass(frozen=True)
class Scene:
    """Data of a game that change seldom, and are therefore not in every frame."""

    revision: int  # counts up from 1; frames refer to it
    facts: dict[str, Any] = field(default_factory=dict)  # JSON values (docs/dev/web_protocol.md, "scene")
    picture: bytes = b""  # map as PNG, one pixel per cell, top row first; empty: no map yet


class News:
    """The last events of a game, numbered from 1; thread-safe."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._entries: deque[dict[str, Any]] = deque(maxlen=MOST_NEWS)
        self._number = 0

    def add(self, **entry: Any) -> None:
        """Add an ``event``, ``light``, ``sound``, ``state``, log line (``words``), ``why`` or ``story``."""
        with self._lock:
            self._number += 1
            if "why" in entry:  # keep only the newest of these long entries
                for old in [one for one in self._entries if "why" in one]:
                    self._entries.remove(old)
            self._entries.append({"number": self._number, **entry})

    def after(self, number: int) -> list[dict[str, Any]]:
        with self._lock:
            return [entry for entry in self._entries if entry["number"] > number]


class Game(Protocol):
    """A game for the server. All methods are thread-safe, and only ``handle`` waits for the game's next tick."""

    source: Literal["simulator", "ros"]

    def close(self) -> None: ...  # the robot stops
    def reset_options(self) -> None: ...  # the first person arrives: reset the viewing options
    def choices(self) -> dict[str, Any]: ...  # values for a setup (docs/dev/web_protocol.md, "choices")
    def scene(self) -> Scene: ...
    def frame(self) -> Frame | None: ...  # None: nothing known yet
    def news(self, after: int) -> list[dict[str, Any]]: ...  # entries after a number, at most 100, oldest first
    def watch(self, *, why: bool, lidar: bool) -> None: ...  # whether any page shows terms, or the lidar
    def handle(self, person: str, message: Message) -> Any: ...  # ``data`` of the answer; Refused changes nothing
    def stop(self, person: str) -> None: ...  # stop the robot at once, until ``release``; may be repeated
    def release(self, person: str) -> None: ...
    def leave(self, person: str) -> None: ...  # free the person's role and stop a robot driven by hand
    def story(self, number: int) -> bytes | None: ...  # frames of a recorded round as JSON list; None: unknown

    def add_map(self, name: str, yaml: str, image: bytes) -> dict[str, Any]:
        """Make a map available; return its name (``map``) and the report of the check (``words``), or raise Refused."""
