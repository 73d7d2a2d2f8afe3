"""Algorithm 6: what the robot shows, plays and does at an event, and its motions as functions of time.

How a light and a sound go is in ``lights.py`` and ``sounds.py``. A motion turns on the spot, for a few seconds at most.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from ..config import ShowConfig
from .lights import GHOST_COLOURS

Motion = Literal["spin", "shake", "stop"]

#: Before a shake the robot comes to a stand, which takes 0.34 s from 0.306 m/s: while its wheels go to and fro at their
#: greatest acceleration they do not brake, and it would roll on for as long as it shakes, 0.3 m.
STAND_S = 0.5
_EDGE_S = 1e-9  # times at which the side changes are hit by sums of periods


@dataclass(frozen=True)
class Feedback:
    """The answer to an event, by the words of each kind."""

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


def angular_velocity(motion: Motion, elapsed_s: float, show: ShowConfig) -> float | None:
    """rad/s so long after the beginning; None once the motion is over, or if the clock was set back before it.

    The spin lasts as long as the start show, the shake as long as the death show. The shake begins with a stand of
    ``STAND_S``, then begins and ends with half a swing, so that it goes as far to the left as to the right.
    """
    if motion == "spin":
        return show.spin_radps if 0 <= elapsed_s < show.start_s else None
    if motion == "stop" or not 0 <= elapsed_s < show.death_s:
        return None
    if elapsed_s + _EDGE_S < STAND_S:
        return 0.0
    swings = math.floor((elapsed_s - STAND_S + _EDGE_S) / show.swing_s + 0.5)
    return show.spin_radps if swings % 2 == 0 else -show.spin_radps
