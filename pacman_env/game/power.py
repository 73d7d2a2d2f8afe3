"""Power pellets: their choice, the time for which they frighten ghosts, and the score.

A ghost is present, frightened or away. A power pellet frightens all ghosts that are present. A frightened ghost flees
and does not kill; the robot catches it within the death radius. Then it is away, and starts again at its spawn place.
Two times per ghost are its whole state (:data:`HARMLESS_UNTIL`, :data:`AWAY_UNTIL`), in the unit of the caller's clock.
"""

import numpy as np
from numpy.typing import NDArray

from ..config import PowerConfig

#: Columns of ``Board.ghosts``: the times until which a ghost is frightened or away, and until which it is away.
HARMLESS_UNTIL, AWAY_UNTIL = 3, 4
#: Colours, 0 to 255, of a frightened ghost, of a blinking ghost, and of the eyes of a ghost that is away.
FRIGHTENED, BLINKING, EYES = (40, 60, 230), (235, 235, 255), (200, 200, 200)
_BLINK_S = 0.5  # 14 frames blue and 14 white at 60 Hz (arcade: 0.47 s)
_MOST_DOUBLINGS = 3  # 200, 400, 800, 1600 for the four ghosts of one energizer (arcade)


def choose_power_pellets(position: NDArray[np.float64], home: tuple[float, float], count: int) -> NDArray[np.bool_]:
    """Return a mask (P,) of the power pellets among pellets at ``position`` (P, 2), m.

    Each is the pellet with the largest straight distance to home and the pellets chosen before; the first in a tie.
    """
    chosen = np.zeros(len(position), dtype=np.bool_)
    nearest = np.hypot(position[:, 0] - home[0], position[:, 1] - home[1])
    for _ in range(min(count, len(position))):
        farthest = int(np.argmax(np.where(chosen, -1.0, nearest)))
        chosen[farthest] = True
        x, y = position[farthest]
        nearest = np.minimum(nearest, np.hypot(position[:, 0] - x, position[:, 1] - y))
    return chosen


def frightened_s(power: PowerConfig, round: int) -> float:
    """Return for how long, s, a power pellet frightens ghosts in a round, counted from 1."""
    return max(power.shortest_s, power.duration_s - (round - 1) * power.duration_step_s)


def frightened_colour(left_s: float, warning_s: float) -> tuple[int, int, int]:
    """Return the colour of a ghost that stays frightened for ``left_s``; it blinks in the last ``warning_s``."""
    return BLINKING if left_s < warning_s and left_s % _BLINK_S < _BLINK_S / 2 else FRIGHTENED


def is_away(ghost, now):  # type: ignore[no-untyped-def]
    """Return True if a ghost, a row of ``Board.ghosts``, has been caught and has not started again."""
    return now < ghost[AWAY_UNTIL]


def is_harmless(ghost, now):  # type: ignore[no-untyped-def]
    """Return True if a ghost, a row of ``Board.ghosts``, is frightened or away."""
    return now < ghost[HARMLESS_UNTIL]


def is_frightened(ghost, now):  # type: ignore[no-untyped-def]
    """Return True if a ghost, a row of ``Board.ghosts``, is frightened."""
    return is_harmless(ghost, now) and not is_away(ghost, now)


def frighten(ghosts, until, now):  # type: ignore[no-untyped-def]
    """Frighten the ghosts (G, 5) that are not away, up to the time ``until``, even if they are frightened already."""
    for k in range(len(ghosts)):
        if not is_away(ghosts[k], now):
            ghosts[k, HARMLESS_UNTIL] = until


def send_away(ghost, until):  # type: ignore[no-untyped-def]
    """Set a caught ghost, a row of ``Board.ghosts``, away until a time; it is not frightened when it starts again."""
    ghost[HARMLESS_UNTIL] = until
    ghost[AWAY_UNTIL] = until


def score_pellet(streak, is_power, power_points):  # type: ignore[no-untyped-def]
    """Return the points of a collected pellet, and the new streak: ghosts caught since the last power pellet."""
    return (power_points, 0) if is_power else (1, streak)


def score_ghost(streak, first_points):  # type: ignore[no-untyped-def]
    """Return the points of a caught ghost, doubled for each ghost of the streak before it, and the new streak."""
    return first_points * 2 ** min(streak, _MOST_DOUBLINGS), streak + 1
