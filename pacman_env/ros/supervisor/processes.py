"""The nodes of a game as processes: started in order, started again when they die, stopped one after another.

Nothing here knows ROS, or which nodes there are (``game_nodes.py``); ``up.py`` is the command that uses both.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from . import child

PATIENCE_S = 12.0  # how long a node may take: its last messages, then a middleware that hangs (``node.py``)
SLOW_START_S = 10.0  # the pause between two starts of a dying node is doubled up to this
MANY = 5  # deaths ...
SOON_S = 60.0  # ... within this time: starting it again does not help
BAD_START = 2  # exit status of a node that refuses its arguments (``node.py``)
_LAST_WORDS = 2000  # bytes of a log that are searched for the reason of a death


class Lost(RuntimeError):
    """A node that cannot be kept alive: it refused to start, or died too often in too short a time."""


@dataclass
class Member:
    """One node's process."""

    name: str
    process: subprocess.Popen[bytes] | None = None
    due_s: float | None = None  # when it is started again
    deaths: list[float] = field(default_factory=list)


class ProcessGroup:
    """Processes by name, in the order in which they were started.

    Args:
        command: the module that runs a node and its arguments, by the node's name.
        logs: folder for one file per node, with all that it prints.
        environment: of the processes.
        say: called with one line about what happens.
        spare: names of those without which the others go on: they are given up instead of lost.
        final: names of those that are not started again when they end.
    """

    def __init__(
        self,
        command: Callable[[str], Sequence[str]],
        logs: Path,
        environment: dict[str, str],
        say: Callable[[str], None],
        spare: Collection[str] = (),
        final: Collection[str] = (),
    ) -> None:
        self._spare, self._final = spare, final
        self._command = command
        self._logs = logs
        self._environment = environment
        self._say = say
        self._members: dict[str, Member] = {}

    def start(self, name: str) -> None:
        """Start a node as a process of its own.

        Raises:
            OSError: its log file cannot be written, or there can be no more processes.
        """
        member = Member(name)
        self._members[name] = member
        self._launch(member, "wb")

    def __contains__(self, name: str) -> bool:
        return name in self._members

    def names(self) -> set[str]:
        """Of all processes."""
        return set(self._members)

    def status(self, name: str) -> int | None:
        """How it ended, None while it runs or waits to be started again."""
        process = self._members[name].process
        return None if process is None else process.poll()

    def ids(self) -> dict[str, int]:
        """The process ids, by name, of those that have been started and not found dead."""
        return {member.name: member.process.pid for member in self._members.values() if member.process is not None}

    def dismiss(self, name: str) -> None:
        """Forget a node whose work is done."""
        del self._members[name]

    def last_words(self, name: str) -> str:
        """The last line of its log, or where the log is."""
        path = self._log(name)
        with contextlib.suppress(OSError), path.open("rb") as log:
            log.seek(max(0, path.stat().st_size - _LAST_WORDS))
            lines = [line.strip() for line in log.read().decode(errors="replace").splitlines() if line.strip()]
            if lines:
                return f"{lines[-1]} ({path})"
        return f"no word in {path}"

    def tend(self) -> list[str]:
        """Start again what died and is due; the names of those found dead.

        Raises:
            Lost: that does not help.
        """
        dead, now = [], time.monotonic()
        for member in self._members.values():
            if member.process is None:
                if member.due_s is not None and now >= member.due_s:
                    self._launch(member, "ab")
            elif (status := member.process.poll()) is not None:
                dead.append(member.name)
                member.process = None
                member.deaths = [when for when in member.deaths if now - when < SOON_S] + [now]
                words = self.last_words(member.name)
                if status == BAD_START or len(member.deaths) >= MANY or member.name in self._final:
                    how = f"died {MANY} times within {SOON_S:.0f} s"
                    if status == BAD_START:
                        how = "does not start"
                    elif member.name in self._final:
                        how = f"ended with status {status}"
                    if member.name not in self._spare:
                        raise Lost(f"{member.name} {how}: {words}")
                    self._say(f"{member.name} {how}: {words}; it is given up, the rest goes on")
                    member.due_s = None
                    continue
                pause = min(SLOW_START_S, 2.0 ** (len(member.deaths) - 1))
                member.due_s = now + pause
                self._say(f"{member.name} ended with status {status}: {words}; again in {pause:.0f} s")
        return dead

    def stop(
        self,
        order: Sequence[str] = (),
        between: Callable[[str], None] = lambda name: None,
        before: Callable[[str, int], None] = lambda name, left: None,
    ) -> list[str]:
        """Stop all, those of ``order`` first, the others against the order of their start; the names of the killed.

        One after another: several participants that leave at once can deadlock inside the middleware.
        ``before`` is called with each and how many come after it, ``between`` after each.
        """
        names = [name for name in order if name in self._members]
        names += [name for name in reversed(self._members) if name not in names]
        killed = []
        for number, name in enumerate(names, 1):
            before(name, len(names) - number)
            process = self._members.pop(name).process
            if process is not None and process.poll() is None:
                process.terminate()
                try:
                    process.wait(PATIENCE_S)
                except subprocess.TimeoutExpired:
                    process.kill()
                    process.wait()
                    killed.append(name)
            between(name)
        return killed

    def _log(self, name: str) -> Path:
        return self._logs / f"{name}.log"

    def _launch(self, member: Member, mode: str) -> None:
        log: IO[bytes]
        with self._log(member.name).open(mode) as log:
            member.process = subprocess.Popen(
                [sys.executable, "-m", child.__name__, str(os.getpid()), *self._command(member.name)],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=self._environment,
                start_new_session=True,  # Ctrl-C is for the command, which stops the nodes in order
            )
        member.due_s = None
