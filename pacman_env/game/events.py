"""Algorithm 6: what the robot shows, plays and does at an event. How a light, a sound or a motion goes is not here."""

from __future__ import annotations

from dataclasses import dataclass

from .dances import Motion
from .lights import GHOST_COLOURS


@dataclass(frozen=True)
class Feedback:
    """The answer to an event; None: nothing of that kind."""

    light: str | None = None
    sound: str | None = None
    motion: Motion | None = None


#: By event word (Milestone 3, Algorithm 6). ``<ghost> killed`` is the robot's death, ``<ghost> caught`` the ghost's.
FEEDBACK: dict[str, Feedback] = {
    "start": Feedback("start", "start"),
    "start theatrical": Feedback("start", "pacman_theme", "spin"),
    "pellet": Feedback("pellet", "pellet"),
    "power pellet": Feedback("power pellet", "power pellet"),
    "death": Feedback("game over", "death", "shake"),
    "game over": Feedback("game over", "death", "shake"),
    "win": Feedback("win", "win"),
    "reset": Feedback("off", None, "stop"),
    **{f"{ghost} caught": Feedback(f"{ghost} caught", "ghost") for ghost in GHOST_COLOURS},
    **{f"{ghost} killed": Feedback(f"{ghost} killed", "death", "shake") for ghost in GHOST_COLOURS},
}
