"""Heartbeat of a process's main thread, through a pipe to ``ros up``, which restarts a process that is frozen.

A process that hangs handles no signal. Therefore the kernel ends it some seconds later, even if ``ros up`` is gone."""

import contextlib
import os
import signal
import time
from pathlib import Path

LIMIT_S = 2  # longest silence of a thread that handles messages
LONG_S = 250  # longest silence during work of unknown length, such as compiling or the end of a node
HANGS_S = 8  # the kernel ends a process this long after the limit
_PERIOD_S = 0.2
#: Longest time that counts as silence between two looks. After a longer gap the observer itself did not run.
_LONGEST_LOOK_S = 0.5
_WAITING = "RD"  # states in which a thread waits for a processor or the disk


class Heart:
    """Sender of this process's heartbeat; without effect until ``pipe`` is set."""

    pipe: int | None = None
    _limit_s, _due_s = 0, 0.0

    def beat(self, limit_s: int = LIMIT_S) -> None:
        """Send a beat if due; it promises the next one within ``limit_s`` (at most 255). For the main thread only."""
        now_s = time.monotonic()
        if self.pipe is None or (limit_s == self._limit_s and now_s < self._due_s):
            return
        self._limit_s, self._due_s = limit_s, now_s + _PERIOD_S
        signal.alarm(limit_s + HANGS_S)
        with contextlib.suppress(OSError):  # ``ros up`` has ended, or has not read for a long time
            os.write(self.pipe, bytes([limit_s]))


HEART = Heart()


class Listener:
    """Receiver of the heartbeats of processes that inherit ``pipe``, one process after another."""

    def __init__(self) -> None:
        self._received, self.pipe = os.pipe()
        os.set_blocking(self._received, False)
        os.set_blocking(self.pipe, False)
        self._look_s, self._busy_s = time.monotonic(), 0.0
        self._limit_s, self.silent_s = 0, 0.0  # a limit of 0: no beat yet

    def __del__(self) -> None:
        os.close(self._received)
        os.close(self.pipe)

    def restart(self) -> None:
        """Discard the beats of the last process."""
        self._read()
        self._limit_s, self.silent_s = 0, 0.0

    def is_late(self, pid: int) -> bool:
        """Return True if process ``pid`` has not sent the promised beat in time; call this several times per second.

        While its main thread waits for a processor, only its processor time counts as silence.
        """
        state, busy_s = main_thread(pid)
        now_s = time.monotonic()
        passed_s = min(now_s - self._look_s, _LONGEST_LOOK_S)
        if state in _WAITING:
            passed_s = min(passed_s, busy_s - self._busy_s)
        self._look_s, self._busy_s = now_s, busy_s
        if beats := self._read():
            self._limit_s, self.silent_s = beats[-1], 0.0
        elif self._limit_s:
            self.silent_s += passed_s
        return self.silent_s > self._limit_s > 0

    def _read(self) -> bytes:
        with contextlib.suppress(BlockingIOError):
            return os.read(self._received, 4096)
        return b""


def main_thread(pid: int) -> tuple[str, float]:
    """Return state and processor time, s, of a process's main thread; "S" and 0 if unknown."""
    with contextlib.suppress(OSError):
        words = Path(f"/proc/{pid}/task/{pid}/stat").read_text().rpartition(")")[2].split()
        return words[0], (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")
    return "S", 0.0
