"""The nodes of a game as processes: started in order, restarted when they die, stopped in three groups."""

import contextlib
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from ..heartbeat import Listener
from . import child

#: Longest end of a node on a busy machine; last messages and a hanging middleware take 7 s (``node.py``).
PATIENCE_S = 30.0
SLOW_START_S = 10.0  # largest pause before a restart; it doubles at each death
MANY = 5  # this many deaths ...
SOON_S = 60.0  # ... within this time: a restart does not help
BAD_START = 2  # exit status of a node that refuses its arguments (``node.py``)
AT_REST_S = 20.0  # a younger process may still be starting
_END_POLL_S = 0.01
RESTARTS = 3  # this many restarts of a process that does not respond ...
RESTARTS_S = 600.0  # ... within this time: another restart does not help
_LOG_END = 2000  # bytes at the end of a log in which a reason for a death is sought
#: A log line below the level of a warning, which is not the reason for an end.
_NO_REASON = re.compile(r"\[(DEBUG|INFO)\]")
#: A line of the log or of Python that may be the reason even if the process was killed.
_ERROR = re.compile(r"\[(ERROR|FATAL)\]|^(Fatal Python error|[\w.]*(Error|Exception|Interrupt)\b)")


class Lost(RuntimeError):
    """Raised for a node that cannot be kept alive: it refused to start, or died too often in a short time."""


@dataclass
class GroupMember:
    name: str
    process: subprocess.Popen[bytes] | None = None
    due_s: float | None = None  # time of the next start
    log_begins: int = 0  # size of the log at the last start, bytes
    deaths: list[float] = field(default_factory=list)
    started_s: float = 0.0
    restarts: list[float] = field(default_factory=list)  # times of restarts for lack of a response, s
    left_alone: bool = False  # True: no more restarts, because there were too many
    ended_by_us: bool = False  # True: killed for a restart, which was already reported
    heartbeat: Listener = field(default_factory=Listener)

    @property
    def is_frozen(self) -> bool:
        """True if the process runs but its heartbeat is late."""
        process = self.process
        return process is not None and process.poll() is None and self.heartbeat.is_late(process.pid)


@dataclass
class ProcessGroup:
    command: Callable[[str], Sequence[str]]  # called with a name: returns the module and its arguments
    logs: Path  # folder with one file for the output of each process
    environment: dict[str, str]
    report: Callable[[str], None]  # called with a line for each event
    spare: Collection[str] = ()  # dispensable processes: given up instead of raising Lost
    final: Collection[str] = ()  # processes that are not restarted when they end
    _members: dict[str, GroupMember] = field(default_factory=dict)

    def start(self, name: str) -> None:
        member = self._members[name] = GroupMember(name)
        self._launch(member, "wb")

    def __contains__(self, name: str) -> bool:
        return name in self._members

    def status(self, name: str) -> int | None:
        """Return the exit status; None while the process runs or waits for its restart."""
        process = self._members[name].process
        return None if process is None else process.poll()

    def ids(self) -> dict[str, int]:
        return {member.name: member.process.pid for member in self._members.values() if member.process is not None}

    def remove(self, name: str) -> None:
        del self._members[name]

    def reason_of_end(self, name: str) -> str:
        """Return the last log line since the start, which probably tells why the process ended, or the log's path."""
        return self._reason(name) or f"no output in {self._log(name)}"

    def _reason(self, name: str, what: re.Pattern[str] | None = None) -> str:
        """Return the last log line since the start if it matches ``what``; by default unless it is DEBUG or INFO."""
        path = self._log(name)
        with contextlib.suppress(OSError), path.open("rb") as log:
            log.seek(max(self._members[name].log_begins, path.stat().st_size - _LOG_END))
            lines = [line.rstrip() for line in log.read().decode(errors="replace").splitlines()]
            lines = [line for line in lines if line[:1].strip() and not line.endswith(":")]  # no lines of a traceback
            if lines and (what.search(lines[-1]) if what else not _NO_REASON.search(lines[-1])):
                return f"{lines[-1]} ({path})"
        return ""

    def _end_of(self, member: GroupMember, status: int) -> tuple[str, bool]:
        """Describe an end with the reason from the log; return the text, and True if a restart is useless."""
        name = member.name
        if status == BAD_START:
            return f"does not start: {self.reason_of_end(name)}", True
        if status < 0:
            signals = {one.value: one.name for one in signal.Signals}
            words, reason = f"was killed ({signals.get(-status, f'signal {-status}')})", self._reason(name, _ERROR)
        else:
            words, reason = f"ended with status {status}", self._reason(name)
        words += f": {reason}" if reason else f", its log is {self._log(name)}"
        if name in self.final:
            return words, True
        many = len(member.deaths) >= MANY
        return f"died {MANY} times within {SOON_S:.0f} s, at last it {words}" if many else words, many

    def restart_frozen(self) -> list[str]:
        """Restart the processes whose heartbeat is late, and return their names."""
        frozen = [member for member in self._members.values() if member.is_frozen]
        for member in frozen:
            self.restart(member.name, f"it is frozen, no heartbeat for {member.heartbeat.silent_s:.0f} s", frozen=True)
            member.heartbeat.silent_s = 0.0
        return [member.name for member in frozen]

    def restart(self, name: str, reason: str, frozen: bool = False) -> None:
        """Kill a process that does not respond, at most ``RESTARTS`` times; ``restart_dead`` restarts it."""
        member, now = self._members[name], time.monotonic()
        starts = not frozen and now - member.started_s < AT_REST_S
        if member.process is None or member.process.poll() is not None or starts:
            return
        member.restarts = [when for when in member.restarts if now - when < RESTARTS_S]
        if len(member.restarts) < RESTARTS:
            member.restarts.append(now)
            member.left_alone = False
            self.report(f"{name} is started again: {reason}")
            member.ended_by_us = True
            member.process.kill()  # a frozen process may be unable to end by itself
            member.process.wait()
        elif not member.left_alone:
            member.left_alone = True
            self.report(f"{name}: {RESTARTS} restarts did not help: {reason}")

    def restart_dead(self) -> list[str]:
        """Restart dead processes that are due, and return the newly dead ones; raises Lost if restarts do not help."""
        dead, now = [], time.monotonic()
        for member in self._members.values():
            name = member.name
            if member.process is not None and (status := member.process.poll()) is not None:
                dead.append(name)
                member.process = None
                self._schedule_restart(member, status, now)
            if member.process is None and member.due_s is not None and now >= member.due_s:
                self._launch(member, "ab")
        return dead

    def _schedule_restart(self, member: GroupMember, status: int, now: float) -> None:
        """Report a death and schedule the restart, which is immediate after the first death."""
        name = member.name
        member.deaths = [when for when in member.deaths if now - when < SOON_S] + [now]
        words, hopeless = self._end_of(member, status)
        if hopeless and name not in self.spare:
            raise Lost(f"{name} {words}")
        if hopeless:
            member.due_s = None
            self.report(f"{name} {words}; it is given up, the other nodes continue")
        else:
            many = len(member.deaths) > 1
            pause = min(SLOW_START_S, 2.0 ** (len(member.deaths) - 1)) if many else 0.0
            member.due_s = now + pause
            if not member.ended_by_us:
                self.report(f"{name} {words}; again {f'in {pause:.0f} s' if many else 'at once'}")
        member.ended_by_us = False

    def stop(
        self,
        first: Collection[str] = (),
        last: Collection[str] = (),
        halt: Callable[[], object] = lambda: None,
        waiting: Callable[[Sequence[str]], object] = lambda names: None,
    ) -> list[str]:
        """Stop the members of ``first`` together, call ``halt``, stop all others together, then ``last``.

        ``halt`` is also called before the wait for ``first``, because a frozen member does not stop the robot. Calls
        ``waiting`` with the names of members that still run. Returns the names of killed members.
        """
        killed = []
        others = [name for name in self._members if name not in (*first, *last)]
        for names in (first, others, last):
            members = [self._members.pop(name) for name in names if name in self._members]
            running = {one.name: one.process for one in members if one.process and one.process.poll() is None}
            halts = halt if members and names is first else lambda: None
            late = lambda names=members: [member.name for member in names if member.is_frozen]  # noqa: E731
            killed += end(running, PATIENCE_S, waiting, late, halts)
            for name, process in running.items():
                if process.returncode == -signal.SIGALRM:
                    self.report(f"{name} did not leave the middleware, its log is {self._log(name)}")
            halts()  # again, because members of ``first`` may have sent another goal
        return killed

    def _log(self, name: str) -> Path:
        return self.logs / f"{name}.log"

    def _launch(self, member: GroupMember, mode: str) -> None:
        with self._log(member.name).open(mode) as log:
            member.log_begins = log.tell()
            member.heartbeat.restart()
            pipe, words = member.heartbeat.pipe, self.command(member.name)
            member.process = subprocess.Popen(
                [sys.executable, "-m", child.__name__, str(os.getpid()), str(pipe), *words],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=self.environment,
                pass_fds=(pipe,),
                start_new_session=True,  # Ctrl-C must only reach the command, which stops the nodes in order
            )
        member.due_s, member.started_s = None, time.monotonic()


def end(
    processes: Mapping[str, subprocess.Popen[Any]],
    patience_s: float,
    waiting: Callable[[Sequence[str]], object] = lambda names: None,
    frozen: Callable[[], list[str]] = list,
    meanwhile: Callable[[], object] = lambda: None,
) -> list[str]:
    """Terminate processes together, and return the names of the processes that had to be killed.

    A process is killed if ``frozen()`` lists its name, or if it still runs after ``patience_s``. ``waiting`` is called
    with all names, and with the names of the running processes whenever a process has ended. ``meanwhile`` is called
    once, after the first call of ``waiting``.
    """
    deadline = time.monotonic() + patience_s
    for process in processes.values():
        process.terminate()
    previous = list(processes)
    if previous:
        waiting(previous)
    meanwhile()
    killed: list[str] = []
    while running := [name for name, process in processes.items() if process.poll() is None]:
        if running != previous:
            waiting(running)
        previous = running
        late = running if time.monotonic() > deadline else frozen()
        for name in late:
            processes[name].kill()
            processes[name].wait()
        killed += late
        time.sleep(_END_POLL_S)
    return killed
