"""What the server asks of a game, be it the simulator's or the robot's: one small interface with two sides."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, Protocol

from pacman_env.web.frame import Frame
from pacman_env.web.messages import Message


class Refused(ValueError):
    """What a person asked for is not done; the words say why, and are shown to him."""


@dataclass(frozen=True)
class Scene:
    """What stays the same from frame to frame.

    Attributes:
        revision: 1 to 65535, another for each scene; a frame names the scene it belongs to.
        facts: for the page, as JSON (docs/web_protocol.md, "scene").
        picture: the map as a PNG, one pixel a cell, top row first; empty: no map yet.
    """

    revision: int
    facts: dict[str, Any] = field(default_factory=dict)
    picture: bytes = b""


class Game(Protocol):
    """A game that people look at. Every method may be called from any thread, and none waits for the game's next tick
    but ``handle``.
    """

    source: Literal["simulator", "ros"]

    def close(self) -> None:
        """End it; a robot stands then."""

    def hello(self) -> dict[str, Any]:
        """What does not change while it is there: what can be chosen, words, melodies."""

    def scene(self) -> Scene:
        """The scene now."""

    def frame(self) -> Frame | None:
        """How it stands now; None: nothing is known yet."""

    def news(self, after: int) -> list[dict[str, Any]]:
        """What has happened, numbered from 1: the entries after a number, at most the last 100, oldest first.

        Each has ``number``, and ``event`` or ``light`` or ``sound`` (a word) or ``words`` (a line of the log) or
        ``why`` (the terms of the candidates).
        """

    def watch(self, *, why: bool, lidar: bool) -> None:
        """Whether anybody looks at the terms and at the lidar now."""

    def handle(self, person: str, message: Message) -> Any:
        """Do what a person asks; returns what the answer has as ``data``, JSON values.

        Raises:
            Refused: it is not done, and nothing has changed.
        """

    def stop(self, person: str) -> None:
        """Stop the robot now, and let it stand until ``release``; at once, from any thread, again and again."""

    def release(self, person: str) -> None:
        """Let it go on.

        Raises:
            Refused: it cannot.
        """

    def leave(self, person: str) -> None:
        """A person is gone: the role is free, and what was driven by hand stands."""

    def add_map(self, name: str, yaml: str, image: bytes) -> dict[str, Any]:
        """A map of somebody's own, to be chosen from now on: its YAML file and its image.

        Returns:
            ``{"map": the name to choose it by, "words": what the map's checker says}``.

        Raises:
            Refused: it cannot be played on; the words say why.
        """

    def story(self, number: int) -> bytes | None:
        """The frames of a round that has ended, as a JSON list; None: there is no such round."""
