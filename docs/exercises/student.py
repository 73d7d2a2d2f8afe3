"""Ask a student's file, which runs in a child process (child.py) with a limit of time."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from child import Message, packed, receive
from numpy.typing import NDArray

from pacman_env import BasePolicy, Config, Situation

CHILD = Path(__file__).with_name("child.py")
START_S = 600.0  # until the child has compiled and imported the package
SEND_S = 60.0  # for a question, which fits into the buffers of the system
SHOWN_LINES, SHOWN_BYTES = 20, 4000  # of what the file prints


class Missed(Exception):
    """Raised if a task cannot be graded further."""


class Student:
    """A child process with the student's file; it may use ``limit_s`` of processor time, and wait as long.

    Both begin when the child is ready to import the file. On Linux it does not count as waiting if the machine is busy.
    """

    def __init__(self, path: Path, limit_s: float) -> None:
        self.processor_s = 0.0  # of the child at its last answer
        self._limit_s, self._left_s = limit_s, START_S
        self._printed = tempfile.TemporaryFile()  # noqa: SIM115
        self._channel, theirs = socket.socketpair()
        with theirs:
            self._process = subprocess.Popen(
                [sys.executable, CHILD, path, str(theirs.fileno()), str(limit_s)],
                pass_fds=[theirs.fileno()],
                stdin=subprocess.DEVNULL,
                stdout=self._printed,
                stderr=subprocess.STDOUT,
                start_new_session=True,  # so that its own children can be killed, too
            )

    def load(self) -> None:
        """Import the file, after the child has started; raises Missed if that fails."""
        self._receive()
        self._left_s = self._limit_s
        self.ask("load")

    def ask(self, question: str, *names: str, arrays: Sequence[NDArray[Any]] = (), **facts: Any) -> Message:
        """Return the answer of a method of ``child.Answers``; raises Missed if there is none."""
        return self._receive(packed({"question": question, "names": names, **facts}, arrays))

    def ask_about(self, question: str, situation: Situation, *names: str) -> Message:
        """Return the answer to a question about a situation."""
        return self.ask(question, *names, arrays=situation.arrays())

    def stop(self) -> str:
        """Kill the child and its children; return the last lines that they printed."""
        with contextlib.suppress(ProcessLookupError, PermissionError):  # macOS refuses to kill ended processes
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()
        self._channel.close()
        with self._printed:
            self._printed.seek(max(0, self._printed.seek(0, os.SEEK_END) - SHOWN_BYTES))
            lines = self._printed.read().decode(errors="replace").splitlines()
        return "\n".join(lines[-SHOWN_LINES:])

    def _receive(self, question: bytes = b"") -> Message:
        end_s = self._idle_s() + self._left_s
        try:
            self._channel.settimeout(SEND_S)
            self._channel.sendall(question)
            self._channel.settimeout(0.5)
            facts, arrays = receive(self._channel, lambda: self._idle_s() < end_s)
            self._left_s = end_s - self._idle_s()
            error, self.processor_s = facts.get("error"), self._clock(float(facts.get("processor_s", 0.0)))
        except TimeoutError:
            raise Missed(f"stopped: it has waited for {self._limit_s:g} s") from None
        except (OSError, EOFError):
            raise Missed(self._end()) from None
        except Exception as error:
            raise Missed(f"the file has sent an invalid answer: {type(error).__name__}") from error
        if error is not None:
            raise Missed(str(error))
        return facts, arrays

    def _idle_s(self) -> float:
        """Return a time in s that stands while the child's main thread runs, or waits for a processor (on Linux)."""
        now_s = time.monotonic()
        with contextlib.suppress(OSError, ValueError):
            ran_ns, queued_ns, _ = Path(f"/proc/{self._process.pid}/schedstat").read_text().split()
            now_s -= (int(ran_ns) + int(queued_ns)) / 1e9
        return now_s

    def _clock(self, told_s: float) -> float:
        """Return the child's processor time in s: measured on Linux, told by the child on other systems."""
        if sys.platform != "linux":
            return told_s
        return time.clock_gettime(~self._process.pid << 3 | 2)  # as clock_getcpuclockid(3) of the C library

    def _end(self) -> str:
        try:
            status = self._process.wait(5.0)
        except subprocess.TimeoutExpired:
            return "the file has closed the connection to the grader"
        if -status in (signal.SIGKILL, signal.SIGXCPU):
            return f"killed: it has used {self._limit_s:g} s of processor time, or too much memory"
        return f"the file has ended its process, with status {status}"


class RemotePolicy(BasePolicy):
    """The policy that the student's file has created last."""

    name = "student"

    def __init__(self, student: Student) -> None:
        self._student = student

    def scores(self, situation: Situation) -> NDArray[np.float64]:
        """Return the student's scores (N, C)."""
        return one(self._student.ask_about("scores", situation))

    def select(self, situation: Situation) -> NDArray[np.int64]:
        """Return the student's candidates (N,)."""
        return one(self._student.ask_about("select", situation))


class RemotePolicyWithState(RemotePolicy):
    """The same, if it has a ``reset`` of its own: it must see all games then."""

    def reset(self, games: NDArray[np.bool_], config: Config) -> None:
        """Reset the student's policy in these games (N,)."""
        super().reset(games, config)
        self._student.ask("reset", arrays=[games])


def one(message: Message) -> NDArray[Any]:
    """Return the only array of a message."""
    if len(message[1]) != 1:
        raise Missed(f"expected one array, got {len(message[1])}")
    return message[1][0]
