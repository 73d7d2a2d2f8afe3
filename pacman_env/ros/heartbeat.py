"""Heartbeats of a process's main thread, by which others notice within a second or two that it is frozen.

Beats are datagrams to Unix sockets: of ``ros up``, named in the environment, and of the game's watcher. A process that
hangs handles no signal. Therefore the kernel ends it some seconds later, even if no process listens any more.
"""

import contextlib
import os
import signal
import socket
import struct
import time
from dataclasses import dataclass
from pathlib import Path

LIMIT_S = 1  # longest silence of a thread that handles messages
LONG_S = 250  # longest silence during work of unknown length, such as compiling or the end of a node
HANGS_S = 8  # the kernel ends a process this long after the limit
ADDRESS = "PACMAN_ENV_HEARTBEATS"  # environment variable: address of the process that starts and watches this one
WAITING = "RD"  # states in which a thread waits for a processor or the disk
_PERIOD_S = 0.2
#: Longest time that counts as silence between two looks. After a longer gap the observer itself did not run.
_LONGEST_LOOK_S = 0.5
_CREDENTIALS = struct.Struct("3i")  # of the sender, by the kernel: process, user, group
LONGEST_SEND = struct.pack("ll", 0, 500_000)  # s and us, C's timeval


def watcher_address(namespace: str, domain: int) -> str:
    """Return the address of the watcher of a game on this machine."""
    return f"pacman_env-{os.getuid()}-{domain}{namespace}"


class Heart:
    """Sender of this process's heartbeats; without effect until there is an address. For the main thread only."""

    def __init__(self) -> None:
        self._addresses = [os.environ[ADDRESS]] if ADDRESS in os.environ else []
        self._socket: socket.socket | None = None
        self.limit_s, self._due_s = 0, 0.0  # of the last beat

    def send_to(self, address: str) -> None:
        self._addresses.append(address)

    def beat(self, limit_s: int = LIMIT_S) -> None:
        """Send a beat if due; it promises the next one within ``limit_s`` (at most 255); 0 is a farewell."""
        now_s = time.monotonic()
        if limit_s == self.limit_s and now_s < self._due_s:
            return
        # A full queue (10 beats) loses a repetition, but a new promise waits: nothing would repeat it.
        flags = socket.MSG_DONTWAIT if limit_s == self.limit_s else 0
        self.limit_s, self._due_s = limit_s, now_s + _PERIOD_S
        if not self._addresses:
            return
        signal.alarm(limit_s + HANGS_S if limit_s else 0)
        if self._socket is None:
            self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
            self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_SNDTIMEO, LONGEST_SEND)
        for address in self._addresses:
            with contextlib.suppress(OSError):  # no process listens there, or not fast enough
                self._socket.sendto(bytes([limit_s]), flags, f"\0{address}")


HEART = Heart()


@dataclass
class _Beat:
    limit_s: int
    look_s: float
    busy_s: float
    silent_s: float = 0.0


class Listener:
    """Receiver of the heartbeats of this user's processes at an address; raises OSError if the address is in use."""

    def __init__(self, address: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        self._socket.bind(f"\0{address}")
        self._socket.setblocking(False)
        self._beats: dict[int, _Beat] = {}

    def close(self) -> None:
        self._socket.close()

    def lost(self) -> dict[int, float]:
        """Return the processes that ended without a farewell or are frozen, once each, and how long they are silent, s.

        0 s for a process that has ended. Call this several times per second.
        """
        self._receive()
        lost = {}
        for pid in list(self._beats):
            silent_s = self._silent_s(pid)
            if silent_s or not is_running(pid):
                lost[pid] = silent_s
                del self._beats[pid]
        return lost

    def _receive(self) -> None:
        with contextlib.suppress(BlockingIOError):
            while True:
                beat, [(_, _, sender)], *_ = self._socket.recvmsg(1, socket.CMSG_SPACE(_CREDENTIALS.size))
                pid, user, _ = _CREDENTIALS.unpack(sender)
                if user != os.getuid() or not beat:
                    continue  # any user of this machine can send here
                limit_s = beat[0]
                if limit_s == 0:
                    self._beats.pop(pid, None)
                else:
                    self._beats[pid] = _Beat(limit_s, time.monotonic(), main_thread(pid)[1])

    def _silent_s(self, pid: int) -> float:
        """Return how long a process has been silent beyond its promise, s; 0 if it is in time.

        While its main thread waits for a processor, only its processor time counts as silence.
        """
        beat = self._beats[pid]
        state, busy_s = main_thread(pid)
        now_s = time.monotonic()
        passed_s = min(now_s - beat.look_s, _LONGEST_LOOK_S)
        if state in WAITING:
            passed_s = min(passed_s, busy_s - beat.busy_s)
        beat.look_s, beat.busy_s = now_s, busy_s
        beat.silent_s += passed_s
        return beat.silent_s if beat.silent_s > beat.limit_s else 0.0


def is_running(pid: int) -> bool:
    """Return True if a process exists and has not ended."""
    return main_thread(pid)[0] not in "ZX-"


def main_thread(pid: int) -> tuple[str, float]:
    """Return state and processor time, s, of a process's main thread; "-" and 0 if there is none."""
    with contextlib.suppress(OSError):
        words = Path(f"/proc/{pid}/task/{pid}/stat").read_text().rpartition(")")[2].split()
        return words[0], (int(words[11]) + int(words[12])) / os.sysconf("SC_CLK_TCK")
    return "-", 0.0
