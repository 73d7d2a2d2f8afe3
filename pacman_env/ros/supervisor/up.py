"""``pacman-env ros up``: a whole game on one machine, from the first process to the last.

A node starts when what it needs is compiled; the game waits for the robot's pose; at the end the robot stops first."""

import atexit
import contextlib
import gc
import os
import shlex
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from importlib.util import find_spec
from pathlib import Path
from typing import Any, TextIO

from pacman_env.files import install_command, user_folder
from pacman_env.ros.discovery import join
from pacman_env.ros.node import Stop
from pacman_env.ros.selector.reasons import POLICY_FAILS, POSE_JUMPED, REMEDIES, troubles_of
from pacman_env.ros.supervisor import game_nodes, nav2
from pacman_env.ros.supervisor.checks.check import count
from pacman_env.ros.supervisor.game_lock import GameLock
from pacman_env.ros.supervisor.game_nodes import (
    COMPOSED,
    GAME,
    LOCK_STEP,
    MOVERS,
    NAV2,
    NAV2_BY_HAND,
    PROCESSES,
    REFEREE,
    SELECTOR,
    SIMULATOR,
    WAIT,
    GameSetup,
)
from pacman_env.ros.supervisor.preparation import Preparation
from pacman_env.ros.supervisor.processes import Lost, ProcessGroup
from pacman_env.ros.supervisor.status_line import ANSWER_S, StatusLine
from pacman_env.ros.supervisor.terminal import LineWriter, keyboard
from pacman_env.ros.topics import CONTINUE, RESET_GAME, START_GAME, Service
from pacman_env.world.maps.occupancy import load_map

# Exit statuses beside 0, stopped as asked, and 2, bad arguments or no ROS: the robot is not localized; a node could not
# be kept alive; a node did not stop and was killed.
NO_POSE, NODE_LOST, HAD_TO_KILL = 3, 4, 5
POLL_S = 0.1
DISCOVERY_S = 1.0  # of other games, before anything is started
GOING_S = 8.0  # a game that is just being stopped is waited for so long
NEXT_ROUND_S = 2.0  # in the menu, where round follows round
FAST_DDS = "rmw_fastrtps_cpp"
#: Troubles that the line has no room for, with what to do about them here; the words of others change every second.
REPORTED = {
    POSE_JUMPED: "set the robot's pose, or c to continue as it is",
    POLICY_FAILS: REMEDIES[POLICY_FAILS],
}
KEYS = {"s": START_GAME, "r": RESET_GAME, "c": CONTINUE}
_WEB = ("starlette", "uvicorn", "websockets")  # what the page's server needs
_BACKLOG = 20  # messages
CLEAN = "fastdds shm clean removes what they left in shared memory"


def up(
    setup: GameSetup,
    domain: int | None = None,
    logs: Path | None = None,
    start: bool = False,
    play_on: bool = False,
    out: TextIO | None = None,
    rounds: int | None = None,
) -> int:
    """Play until SIGINT, SIGTERM, the key q or the end of so many rounds, and return the exit status.

    In the main thread. ``rounds`` are begun by themselves, as all are with ``play_on``.
    """
    atexit.register(gc.freeze)  # the end of the interpreter would go through all objects, several times
    writer = LineWriter(out or sys.stdout)
    with Stop() as stop:
        number = join(domain, setup.sim)
        check(setup, play_on or rounds is not None)
        with (
            GameLock(setup.namespace, number, setup.sim) as lock,
            StatusLine(setup.namespace, setup.sim, setup.policy) as status_line,
            keyboard(sys.stdin) as pressed,
            contextlib.ExitStack() as beside,
        ):
            preparation = beside.enter_context(contextlib.closing(Preparation(setup, writer.print)))
            _alone(status_line, lock, writer, stop)
            preparation.check()
            if stop.asked:
                writer.print("stopped before anything was started")
                return 0
            logs = logs or user_folder("log") / (setup.namespace.strip("/").replace("/", "-") or "root")
            logs.mkdir(parents=True, exist_ok=True)
            extra = dict(setup.extra)
            for name in (REFEREE, SELECTOR):
                state_file = logs / f"{name}.json"
                state_file.unlink(missing_ok=True)  # a game of an earlier command is not continued
                extra[name] = {"state_file": str(state_file), **extra.get(name, {})}
            setup = replace(setup, extra=extra)
            environment = {**os.environ, "PYTHONUNBUFFERED": "1"}
            ends = game_nodes.SPARE, game_nodes.FINAL
            spare, final = ([name for name, process in PROCESSES.items() if process.end == kind] for kind in ends)
            foreign = nav2.command(setup, logs) if setup.nav2 else []
            command = lambda name: foreign if name == NAV2 else setup.command(name)  # noqa: E731
            processes = ProcessGroup(command, logs, environment, writer.print, spare, final, preparation.holds)
            writer.print(f"game on {game_nodes.full_namespace(setup.namespace)}")
            if pressed:
                writer.print("keys: s start, r reset, c continue, space stop, g release, q quit")
            writer.print(f"logs in {logs}")
            if setup.nav2 == NAV2_BY_HAND:
                writer.print(f"start Nav2: {shlex.join(foreign[1:])}", whole=True)
            if setup.web is not None:
                writer.print(f"page: http://127.0.0.1:{setup.web}/ on this computer")
            read_keys, starts = pressed or (lambda: ""), start or play_on or rounds is not None
            goes_on = play_on or rounds is not None
            play = _Play(setup, processes, status_line, writer, stop, read_keys, starts, goes_on)
            play.compiling = lambda: preparation.words
            return play.play(rounds)


def check(setup: GameSetup, play_on: bool = False) -> None:
    """Refuse what can be known to be wrong before anything is started."""
    if setup.web is not None and (missing := [name for name in _WEB if find_spec(name) is None]):
        raise ValueError(f"--web needs {', '.join(missing)}: {install_command('web')}")
    if play_on and not setup.sim:
        raise ValueError("--play-on, --rounds: only with --sim; with a real robot a person starts each round")
    if setup.lock_step and (other := os.environ.get("RMW_IMPLEMENTATION", FAST_DDS)) not in ("", FAST_DDS):
        raise ValueError(f"--lock-step: only with {FAST_DDS}, which delivers within publish; here {other} is set")
    load_map(setup.map)
    nav2.check(setup)


def _alone(status_line: StatusLine, lock: GameLock, writer: LineWriter, stop: Stop) -> None:
    """Refuse to play beside another game, unless it ends soon; one that is discovered later ends by itself."""
    status_line.spin_until(lambda: stop.asked or status_line.others(), DISCOVERY_S)
    deadline = time.monotonic() + GOING_S
    while not stop.asked and (reason := status_line.others() or lock.acquire()):
        if time.monotonic() > deadline:
            raise ValueError(reason)
        writer.wait(f"waiting for another game in {status_line.get_namespace()} to end")
        status_line.spin(POLL_S)
    status_line.nodes.clear()


@dataclass
class _Play:
    setup: GameSetup
    processes: ProcessGroup
    status_line: StatusLine
    writer: LineWriter
    stop: Stop
    pressed: Callable[[], str]
    starts: bool  # the next round by itself
    play_on: bool  # and every later one
    answers: list[tuple[Service, Any, float]] = field(default_factory=list)  # of services, and when they were called
    wanted: list[Service] = field(default_factory=list)  # to be called as soon as they are there
    compiling: Callable[[], str] = lambda: ""  # what is compiled now
    menu_s: float | None = None  # since when the game is in the menu, wall time
    reported: dict[str, str] = field(default_factory=dict)  # troubles, by kind

    def play(self, rounds: int | None = None) -> int:
        played, running = 0, False
        status, processes, status_line = 0, self.processes, self.status_line
        killed: list[str] = []
        try:
            for name in self.setup.first_processes:
                # A simulated robot knows from the start where it is.
                processes.start(SELECTOR if name == WAIT and self.setup.knows_its_pose else name)
            while not self.stop.asked:
                status_line.spin(POLL_S)
                for _ in range(_BACKLOG if self.setup.lock_step else 0):  # of seconds that last milliseconds
                    status_line.spin(0.0)
                if WAIT in processes and (ended := processes.status(WAIT)) is not None:
                    words = processes.last_words(WAIT)
                    processes.dismiss(WAIT)
                    if ended != 0:
                        self.writer.print(f"the robot is not localized: {words}")
                        status = NO_POSE
                        break
                    for name in game_nodes.following(WAIT):
                        processes.start(name)
                awaited = self._awaited()
                running = running or status_line.state == "running"
                if self.starts and not awaited and self._in_menu():
                    played, running = played + running, False
                    if played == rounds:
                        self.writer.print(f"{count(played, 'round')} played: {status_line.result}")
                        break
                    self.wanted.append(START_GAME)
                self._handle_keys()
                self._report_troubles()
                self._call_services()
                self._restart_unresponsive()
                if SELECTOR in processes.tend():
                    self.status_line.halt()  # no node watches over its goal any more
                if awaited:
                    self.writer.wait(self.compiling() or f"starting: {awaited}")
                else:
                    self.writer.show(self.status_line.line)
        except Lost as lost:
            self.writer.print(str(lost))
            status = NODE_LOST
        finally:
            killed = self._stop_all()
        return status or (HAD_TO_KILL if killed else 0)

    def _awaited(self) -> str:
        """What must come before a round can be played; empty if nothing."""
        status_line, processes = self.status_line, self.processes
        missing = [name for name in self.setup.first_nodes if name != WAIT and name not in status_line.nodes]
        if missing:
            return f"waiting for {', '.join(missing)}"
        if SELECTOR not in processes and LOCK_STEP not in processes:
            robot = "the simulated robot's pose" if self.setup.sim else "the robot's pose (docs/robot.md, step 5)"
            return f"waiting for {f'the pose, from AMCL (log of {NAV2})' if self.setup.nav2 else robot}"
        return "" if status_line.condition else f"waiting for {SELECTOR}"

    def _in_menu(self) -> bool:
        """Whether the game has been in the menu for a moment, with everything there for a round."""
        if self.status_line.state != "menu" or not self.status_line.ready or self.wanted or self.answers:
            self.menu_s = None
            return False
        now = time.monotonic()
        self.menu_s = now if self.menu_s is None else self.menu_s
        return now - self.menu_s >= (NEXT_ROUND_S if self.status_line.result else 0.0)

    def _handle_keys(self) -> None:
        operator = self.status_line.operator
        for key in self.pressed():
            if key == "q":
                self.stop.asked = True
            elif key in KEYS:
                self.wanted.append(KEYS[key])
            elif key == " ":
                operator.request(True, "ros up")
                self.status_line.halt()
                self.writer.print("stopped: the robot stands until g")
            elif key == "g" and operator.stopped:
                operator.request(False, "ros up")
                self.writer.print("released")

    def _report_troubles(self) -> None:
        """Print what a person has to do something about, once, as page and doctor show it."""
        troubles = troubles_of(self.status_line.condition)
        before, self.reported = self.reported, {kind: troubles[kind] for kind in REPORTED if kind in troubles}
        for kind, words in self.reported.items():
            if words != before.get(kind):
                self.writer.print(f"{words}: {REPORTED[kind]}")

    def _call_services(self) -> None:
        for service in list(self.wanted):
            answer = self.status_line.call(service)
            if answer is not None:
                self.wanted.remove(service)
                self.answers.append((service, answer, time.monotonic()))
        for call in list(self.answers):
            service, answer, called_s = call
            if not answer.done():
                if time.monotonic() - called_s > ANSWER_S:
                    self.answers.remove(call)
                    self.wanted.append(service)
                continue
            self.answers.remove(call)
            if answer.result().success:
                self.starts = self.play_on or (self.starts and service is not START_GAME)
            elif service is START_GAME and self.starts:  # asked again, if it has not begun by an answer that was lost
                self.starts = self.play_on or self.status_line.state == "menu"
            elif service is START_GAME and self._is_refused_too_soon():
                self.wanted.append(service)
            else:
                self.writer.print(f"{service.name}: {answer.result().message}")

    def _is_refused_too_soon(self) -> bool:
        """Whether a start is refused although a round can begin: by a referee that has just been started again.

        It does not know yet of the goal selector that is there. A reset that was asked for later stands.
        """
        asked = [*self.wanted, *(service for service, *_ in self.answers)]
        return self.status_line.state == "menu" and self.status_line.has_selector and RESET_GAME not in asked

    def _restart_unresponsive(self) -> None:
        """Of nodes that do not do what the referee asks them to: frozen ones, or those that receive nothing."""
        for node, reason in self.status_line.unresponsive.reasons.items():
            process = COMPOSED if node in GAME and COMPOSED in self.processes else node
            if process in self.processes:
                self.processes.restart(process, reason)

    def _stop_all(self) -> list[str]:
        def waiting(names: Sequence[str]) -> None:
            self.writer.wait(f"stopping {', '.join(names)}", at_once=True)

        self.writer.print("stopping: robot, lights, game")
        self.status_line.prepare_halt()
        killed = self.processes.stop(MOVERS, (SIMULATOR,), self.status_line.halt, waiting)
        if killed:
            self.writer.print(f"did not stop and had to be killed: {', '.join(killed)}; {CLEAN}")
        self.writer.print("stopped")
        return killed
