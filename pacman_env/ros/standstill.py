"""Notices that a process stood still for longer than the middleware of others waits: a laptop slept, say.

They have taken it for gone then. Fast DDS finds a participant again whose silence was too long, but not always its
readers and writers (its issues 155 and 457), if that participant has not missed the others: it is heard and hears
nobody, or the other way round. A node that is started anew is found by all.
"""

from __future__ import annotations

import math
import os
import threading
import time

LEASE = "PACMAN_ENV_LEASE_S"  # environment variable
DEFAULT_LEASE_S = 20.0  # Fast DDS's leaseDuration
STOOD_STILL = 75  # exit status: EX_TEMPFAIL of sysexits.h
_LOOKS = 8  # in the time of a lease
_CLOCK = getattr(time, "CLOCK_BOOTTIME", time.CLOCK_MONOTONIC)  # Linux's goes on while the machine sleeps


def lease_s() -> float:
    """After so much silence others take a node for gone, s: of the middleware's profile.

    Raises:
        ValueError: the environment variable is no number of seconds.
    """
    text = os.environ.get(LEASE, "")
    try:
        seconds = float(text) if text else DEFAULT_LEASE_S
    except ValueError:
        seconds = math.nan
    if not seconds > 0:
        raise ValueError(f"{LEASE}={text!r}: must be a number of seconds above 0")
    return seconds


class Standstill:
    """A thread that looks at the clock; whatever else the process computes, it goes on.

    Args:
        lease_s: the longest standstill that does no harm, s.
    """

    def __init__(self, lease_s: float) -> None:
        self._lease_s = lease_s
        self._end = threading.Event()
        self.longest_s = 0.0  # of all standstills
        threading.Thread(target=self._watch, daemon=True).start()

    def __bool__(self) -> bool:
        """Whether others have taken this process for gone."""
        return self.longest_s > self._lease_s

    def close(self) -> None:
        """Look no more."""
        self._end.set()

    def _watch(self) -> None:
        before_s = time.clock_gettime(_CLOCK)
        while not self._end.wait(self._lease_s / _LOOKS):
            now_s = time.clock_gettime(_CLOCK)
            self.longest_s = max(self.longest_s, now_s - before_s)
            before_s = now_s
