"""Detect that a process stood still for longer than the middleware's lease, for example on a sleeping laptop.

Fast DDS discovers such a participant again, but not always its endpoints (its issues 155, 457), so it must restart."""

import math
import os
import time

LEASE = "PACMAN_ENV_LEASE_S"  # environment variable
DEFAULT_LEASE_S = 20.0  # Fast DDS's leaseDuration
STOOD_STILL = 75  # exit status: EX_TEMPFAIL of sysexits.h
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


def idle_s() -> float:
    """Return a clock, s, that counts the machine's sleep but not the work of this process."""
    return time.clock_gettime(_CLOCK) - time.process_time()
