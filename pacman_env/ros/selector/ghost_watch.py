"""Check whether all ghosts were seen lately: a round must not continue if the ghosts' node is dead."""

import time

from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.ros.selector.reasons import SILENT_S

_WALL_S = 0.5  # shortest wall time that counts, because the game's clock may run fast on a busy machine


class GhostWatch:
    def __init__(self) -> None:
        self._seen_s: dict[int, tuple[float, float]] = {}  # by ghost: game time and wall time when it was last seen

    def see(self, number: int, now: float) -> None:
        self._seen_s[number] = now, time.monotonic()

    def lost(self, now: float) -> str:
        """Describe the ghost that was not seen for the longest time before ``now``, s; empty if no ghost is lost."""
        for number, (seen_s, wall_s) in sorted(self._seen_s.items(), key=lambda pair: pair[1]):
            if now - seen_s > SILENT_S and time.monotonic() - wall_s > _WALL_S:
                return f"{GHOST_NAMES[number]} was not seen for {now - seen_s:.0f} s; the robot holds"
        return ""
