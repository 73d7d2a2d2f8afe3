"""Detect that a process stood still for longer than the middleware's lease, for example on a sleeping laptop.

Fast DDS discovers such a participant again, but not always its endpoints (its issues 155, 457), so it must restart."""

import math
import os
import threading
import time

LEASE = "PACMAN_ENV_LEASE_S"  # environment variable
DEFAULT_LEASE_S = 20.0  # Fast DDS's leaseDuration
STOOD_STILL = 75  # exit status: EX_TEMPFAIL of sysexits.h
_CHECKS = 8  # number of checks per lease
_CLOCK = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)  # CLOCK_BOOTTIME also counts sleep


def lease_s() -> float:
    """Return the time of silence, s, after which other nodes drop a node (the middleware profile's lease)."""
    text = os.environ.get(LEASE, "")
    try:
        seconds = float(text) if text else DEFAULT_LEASE_S
    except ValueError:
        seconds = math.nan
    if not seconds > 0:
        raise ValueError(f"{LEASE}={text!r}: must be a number of seconds above 0")
    return seconds


class Standstill:
    """Thread that measures how long the whole process stood still; standstills up to ``lease_s`` are harmless."""

    def __init__(self, lease_s: float) -> None:
        self._lease_s = lease_s
        self._end = threading.Event()
        self.longest_s = 0.0  # longest standstill so far
        threading.Thread(target=self._watch, daemon=True).start()

    def __bool__(self) -> bool:
        """Return True if this process stood still so long that other nodes regard it as gone."""
        return self.longest_s > self._lease_s

    def close(self) -> None:
        self._end.set()

    def _watch(self) -> None:
        last_s = time.clock_gettime(_CLOCK)
        while not self._end.wait(self._lease_s / _CHECKS):
            now_s = time.clock_gettime(_CLOCK)
            self.longest_s = max(self.longest_s, now_s - last_s)
            last_s = now_s
