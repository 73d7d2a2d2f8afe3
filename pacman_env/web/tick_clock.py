"""Real time and the ticks of a simulated game: when the next is due, how much of the last one is shown."""

from __future__ import annotations

import time


class TickClock:
    """Ticks at ``speed`` times real time, held while the game is paused or stopped."""

    def __init__(self, speed: float) -> None:
        self.speed = speed
        self.tick_s = 0.5  # simulated
        self.paused = self.stopped = False
        self._began_s = time.monotonic()  # the last tick
        self._held_s: float | None = None  # since when

    @property
    def is_held(self) -> bool:
        return self.paused or self.stopped

    @property
    def period_s(self) -> float:
        return self.tick_s / self.speed

    @property
    def due_s(self) -> float:
        return self._began_s + self.period_s

    def share(self, real_s: float) -> float:
        """How much of the last tick is over, 0 to 1."""
        at_s = real_s if self._held_s is None else self._held_s
        return min(max((at_s - self._began_s) / self.period_s, 0.0), 1.0)

    def begin(self, due_s: float) -> None:
        """A tick begins: a late one is not made up for, and of one that is held nothing is shown yet."""
        self._began_s = max(due_s, time.monotonic() - self.period_s, self._held_s or 0.0)

    def restart(self) -> None:
        self._began_s = time.monotonic()

    def set_speed(self, times: float) -> None:
        """Another speed, from the present share of the tick on."""
        now = time.monotonic()
        share = self.share(now)
        self.speed = times
        self._began_s = (self._held_s or now) - share * self.period_s

    def hold(self, *, paused: bool | None = None, stopped: bool | None = None) -> None:
        self.paused = self.paused if paused is None else paused
        self.stopped = self.stopped if stopped is None else stopped
        now = time.monotonic()
        if self.is_held:
            self._held_s = now if self._held_s is None else self._held_s
        elif self._held_s is not None:
            self._began_s += now - self._held_s
            self._held_s = None
