"""``pacman-env ros up``: a whole game on one machine: check, prepare, start, watch, stop.

The game waits for the robot's pose; at the end the robot stops first."""

import atexit
import contextlib
import gc
import os
import shlex
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from pathlib import Path
from typing import TextIO

from pacman_env.engine.cache_folder import check_kept, mark
from pacman_env.files import install_command, user_folder
from pacman_env.ros import game_nodes
from pacman_env.ros.discovery import domain_of, join
from pacman_env.ros.game_nodes import GAME, LISTENERS, NAV2, OURS, PAGE, SHADOW, SIMULATOR, WATCHER, GameSetup
from pacman_env.ros.memory import release_memory
from pacman_env.ros.process import StopSignals
from pacman_env.ros.supervisor import nav2
from pacman_env.ros.supervisor.console import Console, RoundRequests
from pacman_env.ros.supervisor.game_lock import GameLock
from pacman_env.ros.supervisor.processes import Lost, ProcessGroup
from pacman_env.ros.supervisor.status_line import StatusLine
from pacman_env.ros.supervisor.terminal import LineWriter, keyboard
from pacman_env.world.maps.occupancy import load_map

# Exit statuses: a process could not be kept alive; a process did not stop and was killed.
# The others are 0 (stopped on request) and 2 (bad arguments, or no ROS).
NODE_LOST, HAD_TO_KILL = 4, 5
POLL_S = 0.1
DISCOVERY_S = 1.0  # time to discover other games before the start
SIM_DISCOVERY_S = 0.4  # on this machine alone
GOING_S = 8.0  # longest wait for another game that is being stopped
STATE_FILE = f"{GAME}.json"
CLEAN = "fastdds shm clean removes their shared memory"
_WEB = ("starlette", "uvicorn", "websockets")  # modules that the page's server needs


@dataclass(frozen=True)
class UpOptions:
    """How ``ros up`` plays a game, in addition to the game's setup."""

    domain: int | None = None  # ROS domain; None: from the environment
    logs: Path | None = None  # folder for the nodes' output; None: in the user's log folder
    start: bool = False  # start the first round automatically
    play_on: bool = False  # start every round automatically
    rounds: int | None = None  # number of automatic rounds, after which the game ends

    @property
    def plays_on(self) -> bool:
        return self.play_on or self.rounds is not None


def up(setup: GameSetup, options: UpOptions = UpOptions(), out: TextIO | None = None) -> int:
    """Play until SIGINT, SIGTERM, the key q or the last round, and return the exit status. Call in the main thread."""
    atexit.register(gc.freeze)  # at its end the interpreter then skips all present objects
    writer = LineWriter(out or sys.stdout)
    with StopSignals() as stop, contextlib.ExitStack() as stack:
        domain = join(options.domain, setup.sim)
        check(setup, options.plays_on)
        lock = stack.enter_context(GameLock(setup.namespace, domain, setup.sim))
        policy = setup.policy if setup.selector == OURS else ""
        status_line = stack.enter_context(StatusLine(setup.namespace, setup.sim, policy))
        pressed = stack.enter_context(keyboard(sys.stdin))
        wait_for_other_games(status_line, lock, writer, stop)
        if stop.asked:
            writer.print("stopped before anything was started")
            return 0
        game = GameProcesses(setup, options, status_line, writer, stop, pressed)
        game.announce()
        try:
            game.start()
            release_memory()
            status = game.watch()
        except Lost as lost:
            if lost.refuses and not game.has_begun:
                raise ValueError(str(lost)) from None
            writer.print(str(lost))
            status = NODE_LOST
        finally:
            killed = game.stop()
        return status or (HAD_TO_KILL if killed else 0)


def log_folder(namespace: str) -> Path:
    """Return the folder of a game's logs and saved game: the domain in its name separates games of one namespace."""
    domain = domain_of(os.environ.get("ROS_DOMAIN_ID", ""))
    name = namespace.strip("/").replace("/", "-") or "root"
    return user_folder("log") / (f"{name}-{domain}" if domain else name)


def check(setup: GameSetup, plays_on: bool = False) -> None:
    """Raise ValueError for everything that is known to be wrong before the start."""
    if setup.web is not None and (missing := [name for name in _WEB if find_spec(name) is None]):
        raise ValueError(f"--web needs {', '.join(missing)}: {install_command('web')}")
    if plays_on and not setup.sim:
        raise ValueError("--play-on, --rounds: only with --sim; with a real robot a person starts each round")
    if setup.params_file and not Path(setup.params_file).is_file():
        raise ValueError(f"--params-file {setup.params_file}: no such file")
    if "NUMBA_DISABLE_JIT" in os.environ:  # only then, because the import takes 0.4 s
        from pacman_env.engine.jit import require_compiler

        require_compiler()
    load_map(setup.map)
    nav2.check(setup)


def wait_for_other_games(status_line: StatusLine, lock: GameLock, writer: LineWriter, stop: StopSignals) -> None:
    """Wait until no other game runs in the namespace; raise ValueError if one still runs after ``GOING_S``.

    If two games discover each other only later, the later one ends itself.
    """
    status_line.spin_until(
        lambda: stop.asked or status_line.others(), SIM_DISCOVERY_S if status_line.sim else DISCOVERY_S
    )
    deadline = time.monotonic() + GOING_S
    while not stop.asked and (reason := status_line.others() or lock.acquire()):
        if time.monotonic() > deadline:
            raise ValueError(reason)
        writer.wait(f"waiting for another game in {status_line.get_namespace()} to end")
        status_line.spin(POLL_S)
    status_line.game.processes.clear()


class GameProcesses:
    """The processes of a game, with the person's requests at the terminal and what the processes report."""

    def __init__(
        self,
        setup: GameSetup,
        options: UpOptions,
        status_line: StatusLine,
        writer: LineWriter,
        stop: StopSignals,
        pressed: Callable[[], str] | None = None,
    ) -> None:
        self.status_line, self.writer, self.asked = status_line, writer, stop
        self.logs = options.logs or log_folder(setup.namespace)
        self.logs.mkdir(parents=True, exist_ok=True)
        extra = dict(setup.extra)
        extra[GAME] = {"state_file": str(self.logs / STATE_FILE), **extra.get(GAME, {})}
        self.setup = setup = replace(setup, extra=extra)
        self.foreign = nav2.command(setup, self.logs) if setup.nav2 else []
        command = lambda name: self.foreign if name == NAV2 else setup.command(name)  # noqa: E731
        environment = {"OPENBLAS_NUM_THREADS": "1", **os.environ, "PYTHONUNBUFFERED": "1"}
        self.processes = ProcessGroup(command, self.logs, environment, self._report, (PAGE, SHADOW))
        self.has_begun = False  # True once a round could have begun
        # This file exists if the code of a game with such a policy is compiled.
        self._compiled = mark(f"warm-robot-{Path(setup.policy).suffix or setup.policy}")
        self._events = 0
        self._shown: tuple[dict[str, str], int] | None = None  # processes and number of events last published
        self._event = ""
        starts = options.start or options.plays_on
        self.rounds = RoundRequests(status_line, writer, starts, options.plays_on, options.rounds)
        self.console = Console(status_line, self.rounds, writer, stop, pressed)

    def announce(self) -> None:
        """Delete the saved game of an earlier command, and print what a person can do."""
        (self.logs / STATE_FILE).unlink(missing_ok=True)
        self.writer.print(f"game on {game_nodes.full_namespace(self.setup.namespace)}")
        self.console.print_keys()
        self.writer.print(f"logs in {self.logs}")
        if self.setup.nav2 == game_nodes.NAV2_BY_HAND:
            self.writer.print(f"start Nav2: {shlex.join(self.foreign[1:])}", whole=True)
        if self.setup.web is not None:
            self.writer.print(f"page: http://127.0.0.1:{self.setup.web}/ on this computer")

    def start(self) -> None:
        for name in self.setup.processes:
            self.processes.start(name)

    def watch(self) -> int:
        """Keep the processes alive and show the game until its end is requested; return the exit status."""
        while not self.asked.asked:
            self.status_line.spin(POLL_S)
            awaited = self.awaited()
            if not awaited and not self.has_begun:
                self._begin()
            if self.rounds.are_over(can_begin=not awaited):
                break
            self.console.handle_keys()
            self.console.report_troubles()
            self.rounds.call_services()
            if GAME in self.processes.restart():
                self.status_line.halt()  # nothing supervises the robot's goal any more
            self._publish_processes()
            if awaited:
                compiling = self._compiled is not None and not self._compiled.exists()
                self.writer.wait(f"starting{', compiling (once)' if compiling else ''}: {awaited}")
            else:
                self.writer.show(self.status_line.line)
        return 0

    def _begin(self) -> None:
        self.has_begun = True
        if self._compiled is not None:
            with contextlib.suppress(OSError):
                check_kept()
                self._compiled.touch()

    def _report(self, text: str) -> None:
        """Print an event of a process, and publish it for the page."""
        self._events, self._event = self._events + 1, text
        self.writer.print(text)
        self._publish_processes()  # at once: the topic holds only one event, and two processes may end together

    def _publish_processes(self) -> None:
        shown = self.processes.states(), self._events
        if shown != self._shown:
            self._shown = shown
            self.status_line.publish_processes(shown[0], self._event, self._events)

    def stop(self) -> list[str]:
        """Stop the robot, then all processes; return the names of killed processes."""

        def waiting(names: Sequence[str]) -> None:
            self.writer.wait(f"stopping {', '.join(names)}", at_once=True)

        self.writer.print("stopping: robot, lights, game")
        self.status_line.prepare_halt()
        killed = self.processes.stop((GAME,), (SIMULATOR, WATCHER), self.status_line.halt, waiting)
        if killed:
            self.writer.print(f"did not stop and had to be killed: {', '.join(killed)}; {CLEAN}")
        self.writer.print("stopped")
        return killed

    def awaited(self) -> str:
        """Return the reason why a round cannot start yet; "" if it can."""
        status_line = self.status_line
        nodes = (SIMULATOR, GAME, *LISTENERS) if self.setup.sim else (GAME, *LISTENERS)
        if missing := [name for name in nodes if name not in status_line.game.nodes]:
            return f"waiting for {', '.join(missing)}"
        if not status_line.game.condition:
            return f"waiting for {GAME}"
        if status_line.ready or status_line.game.condition.get("pose") or status_line.state not in (None, "menu"):
            return ""
        if self.setup.nav2:
            return f"waiting for the pose, from AMCL (log of {NAV2})"
        robot = "simulated robot's pose" if self.setup.sim else "robot's pose (docs/robot/first_game.md, step 5)"
        return f"waiting for the {robot}"
