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

from pacman_env.files import install_command, user_folder
from pacman_env.ros import game_nodes
from pacman_env.ros.discovery import join
from pacman_env.ros.game_nodes import MOVERS, NAV2, REFEREE, SELECTOR, SIMULATOR, WAIT, GameSetup
from pacman_env.ros.node import StopSignals
from pacman_env.ros.supervisor import nav2
from pacman_env.ros.supervisor.console import Console
from pacman_env.ros.supervisor.game_lock import GameLock
from pacman_env.ros.supervisor.preparation import Preparation
from pacman_env.ros.supervisor.processes import Lost, ProcessGroup
from pacman_env.ros.supervisor.rounds import RoundRequests
from pacman_env.ros.supervisor.status_line import StatusLine
from pacman_env.ros.supervisor.terminal import LineWriter, keyboard
from pacman_env.world.maps.occupancy import load_map

# Exit statuses: the robot is not localized; a node could not be kept alive; a node did not stop and was killed.
# The others are 0 (stopped on request) and 2 (bad arguments, or no ROS).
NO_POSE, NODE_LOST, HAD_TO_KILL = 3, 4, 5
POLL_S = 0.1
PREPARED_POLL_S = 0.02
DISCOVERY_S = 1.0  # time to discover other games before the start
GOING_S = 8.0  # longest wait for another game that is being stopped
FAST_DDS = "rmw_fastrtps_cpp"
CLEAN = "fastdds shm clean removes their shared memory"
_WEB = ("starlette", "uvicorn", "websockets")  # modules that the page's server needs
_BACKLOG = 20  # most messages handled at once


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
        preparation = stack.enter_context(contextlib.closing(Preparation(setup, writer.print)))
        lock = stack.enter_context(GameLock(setup.namespace, domain, setup.sim))
        status_line = stack.enter_context(StatusLine(setup.namespace, setup.sim, setup.policy))
        pressed = stack.enter_context(keyboard(sys.stdin))
        wait_for_other_games(status_line, lock, writer, stop)
        prepare(preparation, writer, stop)
        if stop.asked:
            writer.print("stopped before anything was started")
            return 0
        game = GameProcesses(setup, options, status_line, writer, stop, pressed)
        game.announce()
        try:
            game.start()
            status = game.watch()
        except Lost as lost:
            writer.print(str(lost))
            status = NODE_LOST
        finally:
            killed = game.stop()
        return status or (HAD_TO_KILL if killed else 0)


def check(setup: GameSetup, plays_on: bool = False) -> None:
    """Raise ValueError for everything that is known to be wrong before the start."""
    if setup.web is not None and (missing := [name for name in _WEB if find_spec(name) is None]):
        raise ValueError(f"--web needs {', '.join(missing)}: {install_command('web')}")
    if plays_on and not setup.sim:
        raise ValueError("--play-on, --rounds: only with --sim; with a real robot a person starts each round")
    if setup.lock_step and (other := os.environ.get("RMW_IMPLEMENTATION", FAST_DDS)) not in ("", FAST_DDS):
        raise ValueError(f"--lock-step: only with {FAST_DDS}, which delivers within publish; here {other} is set")
    if "NUMBA_DISABLE_JIT" in os.environ:  # only then, because the import takes 0.4 s
        from pacman_env.engine.jit import require_compiler

        require_compiler()
    load_map(setup.map)
    nav2.check(setup)


def wait_for_other_games(status_line: StatusLine, lock: GameLock, writer: LineWriter, stop: StopSignals) -> None:
    """Wait until no other game runs in the namespace; raise ValueError if one still runs after ``GOING_S``.

    If two games discover each other only later, the later one ends itself.
    """
    status_line.spin_until(lambda: stop.asked or status_line.others(), DISCOVERY_S)
    deadline = time.monotonic() + GOING_S
    while not stop.asked and (reason := status_line.others() or lock.acquire()):
        if time.monotonic() > deadline:
            raise ValueError(reason)
        writer.wait(f"waiting for another game in {status_line.get_namespace()} to end")
        status_line.spin(POLL_S)
    status_line.game.processes.clear()


def prepare(preparation: Preparation, writer: LineWriter, stop: StopSignals) -> None:
    """Wait until the setup is checked, code is compiled and the map is prepared; ValueError for a bad setup."""
    preparation.check()
    while not stop.asked and not preparation.done():
        if preparation.words:
            writer.wait(preparation.words)
        time.sleep(PREPARED_POLL_S)


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
        self.logs = options.logs or user_folder("log") / (setup.namespace.strip("/").replace("/", "-") or "root")
        self.logs.mkdir(parents=True, exist_ok=True)
        extra = dict(setup.extra)
        for name in (REFEREE, SELECTOR):
            extra[name] = {"state_file": str(self.logs / f"{name}.json"), **extra.get(name, {})}
        self.setup = setup = replace(setup, extra=extra)
        self.foreign = nav2.command(setup, self.logs) if setup.nav2 else []
        spare = [one.name for one in game_nodes.PROCESSES.values() if one.end == game_nodes.SPARE]
        final = [one.name for one in game_nodes.PROCESSES.values() if one.end == game_nodes.FINAL]
        command = lambda name: self.foreign if name == NAV2 else setup.command(name)  # noqa: E731
        environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
        self.processes = ProcessGroup(command, self.logs, environment, writer.print, spare, final)
        starts = options.start or options.plays_on
        self.rounds = RoundRequests(status_line, writer, starts, options.plays_on, options.rounds)
        self.console = Console(status_line, self.rounds, writer, stop, pressed)

    def announce(self) -> None:
        """Delete the saved game of an earlier command, and print what a person can do."""
        for name in (REFEREE, SELECTOR):
            (self.logs / f"{name}.json").unlink(missing_ok=True)
        self.writer.print(f"game on {game_nodes.full_namespace(self.setup.namespace)}")
        self.console.print_keys()
        self.writer.print(f"logs in {self.logs}")
        if self.setup.nav2 == game_nodes.NAV2_BY_HAND:
            self.writer.print(f"start Nav2: {shlex.join(self.foreign[1:])}", whole=True)
        if self.setup.web is not None:
            self.writer.print(f"page: http://127.0.0.1:{self.setup.web}/ on this computer")

    def start(self) -> None:
        """Start the processes that need no pose."""
        localized = self.setup.sim and not self.setup.nav2  # a simulated robot knows its pose from the start
        for name in self.setup.first_processes:
            self.processes.start(SELECTOR if name == WAIT and localized else name)

    def watch(self) -> int:
        """Keep the processes alive and show the game until its end is requested; return the exit status."""
        while not self.asked.asked:
            self._receive()
            if not self._is_localized():
                return NO_POSE
            awaited = self.awaited()
            if self.rounds.are_over(can_begin=not awaited):
                break
            self.console.handle_keys()
            self.console.report_troubles()
            self.rounds.call_services()
            self._restart_unresponsive()
            frozen = self.processes.restart_frozen()
            if SELECTOR in (*frozen, *self.processes.restart_dead()):
                self.status_line.halt()  # no node supervises the robot's goal any more
            if awaited:
                self.writer.wait(f"starting: {awaited}")
            else:
                self.writer.show(self.status_line.line)
        return 0

    def stop(self) -> list[str]:
        """Stop the robot, then all processes; return the names of killed processes."""

        def waiting(names: Sequence[str]) -> None:
            self.writer.wait(f"stopping {', '.join(names)}", at_once=True)

        self.writer.print("stopping: robot, lights, game")
        self.status_line.prepare_halt()
        killed = self.processes.stop(MOVERS, (SIMULATOR,), self.status_line.halt, waiting)
        if killed:
            self.writer.print(f"did not stop and had to be killed: {', '.join(killed)}; {CLEAN}")
        self.writer.print("stopped")
        return killed

    def awaited(self) -> str:
        """Return the reason why a round cannot start yet; "" if it can."""
        status_line, processes = self.status_line, self.processes
        missing = [name for name in self.setup.first_nodes if name != WAIT and name not in status_line.game.nodes]
        if missing:
            return f"waiting for {', '.join(missing)}"
        if SELECTOR not in processes and game_nodes.LOCK_STEP not in processes:
            if self.setup.nav2:
                return f"waiting for the pose, from AMCL (log of {NAV2})"
            robot = "simulated robot's pose" if self.setup.sim else "robot's pose (docs/robot/first_game.md, step 5)"
            return f"waiting for the {robot}"
        return "" if status_line.condition else f"waiting for {SELECTOR}"

    def _receive(self) -> None:
        self.status_line.spin(POLL_S)
        for _ in range(_BACKLOG if self.setup.lock_step else 0):  # its time runs fast, so messages pile up
            self.status_line.spin(0.0)

    def _is_localized(self) -> bool:
        """Start the processes that need a pose once the robot has one; return False if it will get none."""
        if WAIT not in self.processes or (status := self.processes.status(WAIT)) is None:
            return True
        words = self.processes.reason_of_end(WAIT)
        self.processes.remove(WAIT)
        if status != 0:
            self.writer.print(f"the robot is not localized: {words}")
            return False
        for name in game_nodes.following(WAIT):
            self.processes.start(name)
        return True

    def _restart_unresponsive(self) -> None:
        """Restart nodes that do not respond to the referee: they are frozen or receive nothing."""
        for node, reason in self.status_line.game.unresponsive.items():
            composed = node in game_nodes.GAME and game_nodes.COMPOSED in self.processes
            process = game_nodes.COMPOSED if composed else node
            if process in self.processes:
                self.processes.restart(process, reason)
