"""The robot's motions of Algorithm 6, as functions of time: it turns on the spot, for a few seconds at most."""

from __future__ import annotations

import math
from typing import Literal

from ..config import ShowConfig

Motion = Literal["spin", "shake", "stop"]

#: Before a shake the robot comes to a stand, which takes 0.34 s from 0.306 m/s: while its wheels go to and fro at their
#: greatest acceleration they do not brake, and it would roll on for as long as it shakes, 0.3 m.
STAND_S = 0.5
_EDGE_S = 1e-9  # times at which the side changes are hit by sums of periods


def angular_velocity(motion: Motion, elapsed_s: float, show: ShowConfig) -> float | None:
    """rad/s so long after the beginning; None: the motion is over. The spin lasts as long as the start show, the shake
    as long as the death show.

    A time before the beginning is over, too: the clock was set back. The shake begins with a stand of ``STAND_S``, then
    begins and ends with half a swing, so that it goes as far to the left as to the right.
    """
    if motion == "spin":
        return show.spin_radps if 0 <= elapsed_s < show.start_s else None
    if motion == "shake":
        if not 0 <= elapsed_s < show.death_s:
            return None
        swings = math.floor((elapsed_s - STAND_S + _EDGE_S) / show.swing_s + 0.5)
        turn = show.spin_radps if swings % 2 == 0 else -show.spin_radps
        return turn if elapsed_s + _EDGE_S >= STAND_S else 0.0
    return None
