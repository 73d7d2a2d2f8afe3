"""``pacman-env ros up``: a whole game on one machine, from the first process to the last.

The nodes are processes of ``processes.py``; this is what goes on above them: what they need is compiled first, the
robot's pose comes before the game, one line says how the game stands or what is awaited, keys start and reset it, and
at the end the robot stands still and its lights are off before the rest is stopped.
"""

from __future__ import annotations

import dataclasses
import os
import subprocess
import sys
import time
from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path
from typing import TextIO

from platformdirs import user_log_path

from pacman_env.config import make_config, parse_settings
from pacman_env.policies.registry import make_policy
from pacman_env.ros.discovery import join, stay_on_this_machine
from pacman_env.ros.node import Stop
from pacman_env.ros.supervisor import warm_up
from pacman_env.ros.supervisor.game_lock import GameLock
from pacman_env.ros.supervisor.game_nodes import (
    FINAL,
    LOCK_STEP,
    REFEREE,
    SELECTOR,
    SPARE,
    STOP_ORDER,
    WAIT,
    GameSetup,
    ending,
    following,
    full_namespace,
)
from pacman_env.ros.supervisor.keyboard import Keyboard
from pacman_env.ros.supervisor.processes import Lost, ProcessGroup
from pacman_env.ros.supervisor.status_line import StatusLine, fitted
from pacman_env.ros.topics import RESET_GAME, START_GAME, Service
from pacman_env.sim.maps.assets import map_assets
from pacman_env.world.maps.occupancy import load_map

#: Exit statuses beside 0, stopped as asked, and 2, bad arguments.
NO_POSE, NODE_LOST, HAD_TO_KILL = 3, 4, 5
MEANINGS = {
    0: "stopped as asked",
    2: "bad arguments, or ROS is missing",
    NO_POSE: "the robot is not localized",
    NODE_LOST: "a node could not be kept alive",
    HAD_TO_KILL: "a node did not stop and was killed",
}
POLL_S = 0.1
LINE_S = 0.5  # between two updates of the line
DISCOVERY_S = 1.0  # of other games, before anything is started
GOING_S = 8.0  # a game that is just being stopped is waited for so long
NEXT_ROUND_S = 2.0  # in the menu, where round follows round
KEYS = {"s": START_GAME, "r": RESET_GAME}
_WEB = ("starlette", "uvicorn", "websockets")  # what the page's server needs
_BACKLOG = 20  # messages
_CLEAR = "\r\x1b[K"


class LineWriter:
    """One line that is written over and over on a terminal; elsewhere a line whenever something but time changes."""

    def __init__(self, out: TextIO) -> None:
        self._out = out
        self._terminal = out.isatty()
        self._last = ""
        self._due_s = 0.0

    def say(self, text: str) -> None:
        """A line that stays."""
        print(f"{_CLEAR if self._terminal else ''}{text}", file=self._out, flush=True)
        self._due_s = 0.0

    def show(self, line: Callable[[bool], str], at_once: bool = False) -> None:
        """The status; ``line(True)`` is with what only time changes, ``line(False)`` without."""
        if time.monotonic() < self._due_s and not at_once:
            return
        self._due_s = time.monotonic() + LINE_S
        if self._terminal:
            self._out.write(_CLEAR + line(True))
            self._out.flush()
        elif line(False) != self._last:
            self._last = line(False)
            print(line(True), file=self._out, flush=True)


class Waiting:
    """What is waited for, and since when, as a line."""

    def __init__(self) -> None:
        self._what = ""
        self._since_s = 0.0

    def line(self, what: str) -> Callable[[bool], str]:
        """That, and the seconds where they are wanted."""
        if what != self._what:
            self._what, self._since_s = what, time.monotonic()
        waited = f"{time.monotonic() - self._since_s:.0f} s"
        return lambda with_time: fitted([what, waited] if with_time else [what])


def up(
    setup: GameSetup,
    domain: int | None = None,
    logs: Path | None = None,
    start: bool = False,
    play_on: bool = False,
    out: TextIO | None = None,
) -> int:
    """Play until SIGINT, SIGTERM or the key q; to be called in the main thread.

    Args:
        setup: what to start, and where.
        domain: ROS_DOMAIN_ID; None: that of the environment.
        logs: folder for the nodes' output; None: the user's, by namespace.
        start: begin the first round as soon as everything is there.
        play_on: begin every round by itself; only with a simulated robot.
        out: where to write, standard output by default.

    Returns:
        The exit status, one of :data:`MEANINGS`.

    Raises:
        ValueError: a map, policy or number that cannot be played, or another game plays there.
        OSError: the folder for logs cannot be written to.
    """
    writer = LineWriter(out or sys.stdout)
    with Stop() as stop:
        number = join(domain, setup.sim)
        check(setup, play_on)
        os.environ.update(environment(setup, domain))
        lock = GameLock(setup.namespace, number, setup.sim)
        status_line = StatusLine(setup.namespace, setup.sim, setup.policy)
        try:
            _acquire(lock, writer, stop)
            _prepare(setup, writer, stop)
            _alone(status_line, setup, writer, stop)
            if stop.asked:
                writer.say("stopped before anything was started")
                return 0
            logs = logs or user_log_path("pacman_env") / (setup.namespace.strip("/").replace("/", "-") or "root")
            logs.mkdir(parents=True, exist_ok=True)
            state_file = logs / f"{REFEREE}.json"
            state_file.unlink(missing_ok=True)  # a game of an earlier command is not gone on with
            referee = {"state_file": str(state_file), **setup.extra.get(REFEREE, {})}
            setup = dataclasses.replace(setup, extra={**setup.extra, REFEREE: referee})
            processes = ProcessGroup(
                setup.command, logs, dict(os.environ), writer.say, spare=ending(SPARE), final=ending(FINAL)
            )
            with Keyboard() as keyboard:
                keys = "; keys: s start, r reset, space stop, g go on, q quit" if keyboard.there else ""
                writer.say(f"game on {full_namespace(setup.namespace)}{keys}")
                writer.say(f"logs in {logs}")
                if setup.web is not None:
                    writer.say(f"page: http://127.0.0.1:{setup.web}/ on this computer")
                play = _Play(setup, processes, status_line, writer, stop, keyboard, lock.stopping)
                return play.play(start or play_on, play_on)
        finally:
            status_line.close()
            lock.close()


def check(setup: GameSetup, play_on: bool = False) -> None:
    """Refuse what can be known to be wrong before anything is started.

    Raises:
        ValueError: a map, policy or number that cannot be played.
    """
    if setup.web is not None and (missing := [name for name in _WEB if find_spec(name) is None]):
        raise ValueError(f"--web needs {', '.join(missing)}: pip install 'pacman_env[web]'")
    if play_on and not setup.sim:
        raise ValueError("--play-on: only with --sim; beside a real robot somebody starts each round")
    make_config(setup.preset, setup.execution, **parse_settings(setup.settings))
    load_map(setup.map)
    make_policy(setup.policy)


def environment(setup: GameSetup, domain: int | None) -> dict[str, str]:
    """What the processes of a game find in their environment beside that of the caller."""
    found = {"PYTHONUNBUFFERED": "1"}
    if domain is not None:
        found["ROS_DOMAIN_ID"] = str(domain)
    if setup.sim:
        stay_on_this_machine(found)
    return found


def _prepare(setup: GameSetup, writer: LineWriter, stop: Stop) -> None:
    """Compile what has not been compiled on this machine yet, on all its cores, and prepare the map."""
    parts = warm_up.parts(setup)
    waiting = Waiting()
    running = {part: warm_up.start(part, setup) for part in parts}
    try:
        while running and not stop.asked:
            names = ", ".join(name for part in running for name in part.nodes)
            writer.show(waiting.line(f"compiling (once): {names}"))
            time.sleep(POLL_S)
            for part, process in list(running.items()):
                if (status := process.poll()) is None:
                    continue
                del running[part]
                words = process.stderr.read().strip() if process.stderr else ""
                if status == warm_up.BAD_SETUP:
                    raise ValueError(words)
                if status:  # the nodes compile for themselves, and say what is wrong
                    writer.say(f"{', '.join(part.nodes)}: compiling ended with status {status}")
    finally:
        for process in running.values():
            process.terminate()
            _reap(process)
    if not stop.asked:
        map_assets(setup.map, make_config(setup.preset, setup.execution, **parse_settings(setup.settings)))


def _reap(process: subprocess.Popen[str]) -> None:
    try:
        process.wait(2.0)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()


def _acquire(lock: GameLock, writer: LineWriter, stop: Stop) -> None:
    """Refuse to play beside a game of another ``ros up`` on this machine; one that is being stopped is waited for."""
    waiting = Waiting()
    while not stop.asked and (held := lock.acquire())[0]:
        who, stopping = held
        if not stopping:
            raise ValueError(who)
        writer.show(waiting.line("waiting for another game to end"))
        time.sleep(POLL_S)


def _alone(status_line: StatusLine, setup: GameSetup, writer: LineWriter, stop: Stop) -> None:
    """Refuse to play beside a game that is discovered, unless it ends.

    A game that is discovered later than this is refused by its nodes: of two that act, the later one ends.
    """
    waiting = Waiting()
    status_line.spin_until(lambda: stop.asked or status_line.others(setup.sim), DISCOVERY_S)
    end = time.monotonic() + GOING_S
    while not stop.asked and (who := status_line.others(setup.sim)):
        if time.monotonic() > end:
            raise ValueError(who)
        writer.show(waiting.line(f"waiting for another game in {status_line.get_namespace()} to end"))
        status_line.spin(POLL_S)
    status_line.nodes.clear()


class _Play:
    """The game, from the first node's start to the last one's end."""

    def __init__(
        self,
        setup: GameSetup,
        processes: ProcessGroup,
        status_line: StatusLine,
        writer: LineWriter,
        stop: Stop,
        keyboard: Keyboard,
        stopping: Callable[[], None],
    ) -> None:
        self._stopping = stopping  # called when the end begins
        self._setup, self._processes, self._status_line = setup, processes, status_line
        self._writer, self._stop, self._keyboard = writer, stop, keyboard
        self._waiting = Waiting()
        self._asked: list[tuple[Service, object]] = []  # services that are to answer
        self._wanted: list[Service] = []  # to be called as soon as they are there
        self._menu_s: float | None = None  # since when the game is in the menu, wall time

    def play(self, start: bool, play_on: bool) -> int:
        """The exit status."""
        status, processes = 0, self._processes
        killed: list[str] = []
        try:
            for name in self._setup.first_processes:
                processes.start(name)
            while not self._stop.asked:
                self._status_line.spin(POLL_S)
                for _ in range(_BACKLOG if self._setup.lock_step else 0):  # of seconds that last milliseconds
                    self._status_line.spin(0.0)
                if WAIT in processes and (ended := processes.status(WAIT)) is not None:
                    words = processes.last_words(WAIT)
                    processes.dismiss(WAIT)
                    if ended != 0:
                        self._writer.say(f"the robot is not localized: {words}")
                        status = NO_POSE
                        break
                    for name in following(WAIT):
                        processes.start(name)
                awaited = self._awaited()
                if start and not awaited and self._in_menu():
                    self._wanted.append(START_GAME)
                    start = play_on
                self._keys()
                self._ask()
                if SELECTOR in processes.tend():
                    self._status_line.halt()  # no node watches over its goal any more
                self._writer.show(self._waiting.line(f"starting: {awaited}") if awaited else self._status_line.line)
        except Lost as lost:
            self._writer.say(str(lost))
            status = NODE_LOST
        finally:
            killed = self._stop_all()
        return status or (HAD_TO_KILL if killed else 0)

    def _awaited(self) -> str:
        """What is yet to come before a round can be played; empty: nothing."""
        status_line, processes = self._status_line, self._processes
        missing = [name for name in self._setup.first_nodes if name != WAIT and name not in status_line.nodes]
        if missing:
            return f"waiting for {', '.join(missing)}"
        if not {SELECTOR, LOCK_STEP} & processes.names():
            return "waiting for the robot's pose (docs/robot.md, step 5)"
        if not status_line.condition:
            return f"waiting for {SELECTOR}"
        return ""

    def _in_menu(self) -> bool:
        """Whether the game has been in the menu for a moment, with everything there for a round."""
        if self._status_line.state != "menu" or not self._status_line.ready or self._wanted or self._asked:
            self._menu_s = None
            return False
        now = time.monotonic()
        self._menu_s = now if self._menu_s is None else self._menu_s
        return now - self._menu_s >= (NEXT_ROUND_S if self._status_line.result else 0.0)

    def _keys(self) -> None:
        for key in self._keyboard.pressed():
            if key == "q":
                self._stop.asked = True
            elif key in KEYS:
                self._wanted.append(KEYS[key])
            elif key == " ":
                self._status_line.operator.say(True, "ros up")
                self._status_line.halt()
                self._writer.say("stopped: the robot stands until g")
            elif key == "g" and self._status_line.operator.stopped:
                self._status_line.operator.say(False, "ros up")
                self._writer.say("released")

    def _ask(self) -> None:
        """Call what was asked for, and say what was refused."""
        for service in list(self._wanted):
            answer = self._status_line.call(service)
            if answer is not None:
                self._wanted.remove(service)
                self._asked.append((service, answer))
        for service, answer in list(self._asked):
            if answer.done():  # type: ignore[attr-defined]
                self._asked.remove((service, answer))
                result = answer.result()  # type: ignore[attr-defined]
                if not result.success:
                    self._writer.say(f"{service.name}: {result.message}")

    def _stop_all(self) -> list[str]:
        """The names of those that had to be killed."""
        self._stopping()
        processes = self._processes
        last_mover = next((name for name in STOP_ORDER[1::-1] if name in processes), None)
        waiting = Waiting()

        def before(name: str, left: int) -> None:
            more = f", then {left} more" if left else ""
            self._writer.show(waiting.line(f"stopping {name}{more}"), at_once=True)

        self._writer.say("stopping: robot, lights, game")
        killed = processes.stop(
            STOP_ORDER, lambda name: self._status_line.halt() if name == last_mover else None, before
        )
        if killed:
            self._writer.say(f"did not stop and had to be killed: {', '.join(killed)}")
        self._writer.say("stopped")
        return killed
