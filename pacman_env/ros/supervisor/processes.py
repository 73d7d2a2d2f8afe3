"""The processes of a game: started in order, restarted when they die or freeze, stopped in three groups."""

import contextlib
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

from ..heartbeat import ADDRESS, Listener
from . import child

#: Longest end of a node on a busy machine; last messages and a hanging middleware take 7 s (``process.py``).
PATIENCE_S = 30.0
SLOW_START_S = 10.0  # largest pause before a restart; it doubles at each death
MANY = 5  # this many deaths ...
SOON_S = 60.0  # ... within this time: a restart does not help
BAD_START = 2  # exit status of a node that refuses its arguments (``node.py``)
_END_POLL_S = 0.01
_LOG_END = 2000  # bytes at the end of a log in which a reason for a death is sought
#: A log line below the level of a warning, or of a traceback's marks, which is not the reason for an end.
_NO_REASON = re.compile(r"\[(DEBUG|INFO)\]")
#: A line of the log or of Python that may be the reason even if the process was killed.
_ERROR = re.compile(r"\[(ERROR|FATAL)\]|^(Fatal Python error|[\w.]*(Error|Exception|Interrupt)\b)")


class Lost(RuntimeError):
    """Raised for a process that cannot be kept alive: it ``refuses`` to start, or died too often in a short time."""

    def __init__(self, words: str, refuses: bool) -> None:
        super().__init__(words)
        self.refuses = refuses


@dataclass
class GroupMember:
    name: str
    process: subprocess.Popen[bytes] | None = None
    due_s: float | None = None  # time of the next start
    log_begins: int = 0  # size of the log at the last start, bytes
    deaths: list[float] = field(default_factory=list)
    words: str = ""  # why it does not run, or was started again

    @property
    def pid(self) -> int:
        return 0 if self.process is None else self.process.pid


@dataclass
class ProcessGroup:
    command: Callable[[str], Sequence[str]]  # called with a name: returns the module and its arguments
    logs: Path  # folder with one file for the output of each process
    environment: dict[str, str]
    report: Callable[[str], None]  # called with a line for each event
    spare: Collection[str] = ()  # dispensable processes: given up instead of raising Lost
    _members: dict[str, GroupMember] = field(default_factory=dict)

    def __post_init__(self) -> None:
        address = f"pacman_env-up-{os.getpid()}-{id(self)}"
        self._heartbeats = Listener(address)
        self.environment = {**self.environment, ADDRESS: address}

    def start(self, name: str) -> None:
        member = self._members[name] = GroupMember(name)
        self._launch(member, "wb")

    def __contains__(self, name: str) -> bool:
        return name in self._members

    def ids(self) -> dict[str, int]:
        return {member.name: member.pid for member in self._members.values() if member.process is not None}

    def states(self) -> dict[str, str]:
        """Return for each process why it does not run; "" if it runs."""
        return {member.name: "" if member.process is not None else member.words for member in self._members.values()}

    def reason_of_end(self, name: str) -> str:
        """Return the last log line since the start, which probably tells why the process ended, or the log's path."""
        return self._reason(name) or f"no output in {self._log(name)}"

    def _reason(self, name: str, what: re.Pattern[str] | None = None) -> str:
        """Return the last log line since the start if it matches ``what``; by default unless it is DEBUG or INFO."""
        path = self._log(name)
        with contextlib.suppress(OSError), path.open("rb") as log:
            log.seek(max(self._members[name].log_begins, path.stat().st_size - _LOG_END))
            lines = [line.rstrip() for line in log.read().decode(errors="replace").splitlines()]
            lines = [one for one in lines if one[:1].strip(" ^~") and not one.endswith(":")]  # no lines of a traceback
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
        many = len(member.deaths) >= MANY
        return f"died {MANY} times within {SOON_S:.0f} s, at last it {words}" if many else words, many

    def restart(self) -> list[str]:
        """Restart dead and frozen processes, and return their names; raises Lost if restarts do not help."""
        lost, now = self._heartbeats.lost(), time.monotonic()
        ended = []
        for member in self._members.values():
            process = member.process
            if process is not None and process.poll() is None and lost.get(member.pid):
                process.kill()  # a frozen process may be unable to end by itself
                process.wait()
                member.words = f"is frozen, no heartbeat for {lost[member.pid]:.0f} s"
            if process is not None and process.poll() is not None:
                ended.append(member.name)
                self._schedule_restart(member, process.returncode, now)
            if member.process is None and member.due_s is not None and now >= member.due_s:
                self._launch(member, "ab")
        return ended

    def _schedule_restart(self, member: GroupMember, status: int, now: float) -> None:
        """Report an end and schedule the restart, which is immediate after the first one."""
        name = member.name
        member.process = None
        member.deaths = [when for when in member.deaths if now - when < SOON_S] + [now]
        words, hopeless = self._end_of(member, status)
        member.words, frozen = words, member.words
        if hopeless and name not in self.spare:
            raise Lost(f"{name} {words}", status == BAD_START)
        if hopeless:
            member.due_s = None
            self.report(f"{name} {words}; it is given up, the other processes continue")
            return
        pause = min(SLOW_START_S, 2.0 ** (len(member.deaths) - 1)) if len(member.deaths) > 1 else 0.0
        member.due_s = now + pause
        self.report(f"{name} {frozen or words}; again {f'in {pause:.0f} s' if pause else 'at once'}")

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
            killed += end(running, PATIENCE_S, waiting, partial(self._frozen, running), halts)
            for name, process in running.items():
                if process.returncode == -signal.SIGALRM:
                    self.report(f"{name} did not leave the middleware, its log is {self._log(name)}")
            halts()  # again, because members of ``first`` may have sent another goal
        self._heartbeats.close()
        return killed

    def _frozen(self, processes: Mapping[str, subprocess.Popen[bytes]]) -> list[str]:
        lost = self._heartbeats.lost()  # 0 s: ended, though the kernel may still be ending its other threads
        return [name for name, process in processes.items() if lost.get(process.pid) and process.poll() is None]

    def _log(self, name: str) -> Path:
        return self.logs / f"{name}.log"

    def _launch(self, member: GroupMember, mode: str) -> None:
        with self._log(member.name).open(mode) as log:
            member.log_begins = log.tell()
            member.process = subprocess.Popen(
                [sys.executable, "-m", child.__name__, str(os.getpid()), *self.command(member.name)],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env=self.environment,
                start_new_session=True,  # Ctrl-C must only reach the command, which stops the nodes in order
            )
        member.due_s, member.words = None, ""


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
