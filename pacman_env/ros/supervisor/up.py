"""``pacman-env ros up``: a whole game on one machine, from the first process to the last.

The nodes are processes of ``processes.py``; this is what goes on above them: the robot's pose comes before
the game, one line says how the game stands, and at the end the robot stands still and its lights are off before the
rest is stopped.
"""

from __future__ import annotations

import dataclasses
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import TextIO

from platformdirs import user_log_path

from pacman_env.config import make_config, parse_settings
from pacman_env.policies.registry import make_policy
from pacman_env.ros.node import Stop
from pacman_env.ros.supervisor.game_nodes import REFEREE, SELECTOR, STOP_ORDER, WAIT, GameSetup, full_namespace
from pacman_env.ros.supervisor.processes import Lost, ProcessGroup
from pacman_env.ros.supervisor.status_line import StatusLine
from pacman_env.sim.maps.assets import map_assets

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
LINE_S = 0.5  # how often the line is looked at
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

    def show(self, line: Callable[[bool], str]) -> None:
        """The status; ``line(True)`` is with what only time changes, ``line(False)`` without."""
        if time.monotonic() < self._due_s:
            return
        self._due_s = time.monotonic() + LINE_S
        if self._terminal:
            self._out.write(_CLEAR + line(True))
            self._out.flush()
        elif line(False) != self._last:
            self._last = line(False)
            print(line(True), file=self._out, flush=True)


def up(
    setup: GameSetup,
    domain: int | None = None,
    logs: Path | None = None,
    start: bool = False,
    out: TextIO | None = None,
) -> int:
    """Play until SIGINT or SIGTERM; to be called in the main thread.

    Args:
        setup: what to start, and where.
        domain: ROS_DOMAIN_ID; None: that of the environment.
        logs: folder for the nodes' output; None: the user's, by namespace.
        start: begin the first round as soon as the robot is localized.
        out: where to write, standard output by default.

    Returns:
        The exit status, one of :data:`MEANINGS`.

    Raises:
        ValueError: a map, policy or number that cannot be played.
        OSError: the folder for logs cannot be written to.
    """
    check(setup, domain)
    writer = LineWriter(out or sys.stdout)
    logs = logs or user_log_path("pacman_env") / (setup.namespace.strip("/").replace("/", "-") or "root")
    logs.mkdir(parents=True, exist_ok=True)
    state_file = logs / f"{REFEREE}.json"
    state_file.unlink(missing_ok=True)  # a game of an earlier command is not gone on with
    referee = {"state_file": str(state_file), **setup.extra.get(REFEREE, {})}
    setup = dataclasses.replace(setup, extra={**setup.extra, REFEREE: referee})
    os.environ.update(environment(setup, domain))
    status_line = StatusLine(setup)
    processes = ProcessGroup(setup.command, logs, dict(os.environ), writer.say)
    writer.say(f"game on {full_namespace(setup.namespace)}, logs in {logs}")
    try:
        with Stop() as stop:
            return _play(setup, processes, status_line, writer, stop, start)
    finally:
        status_line.close()


def check(setup: GameSetup, domain: int | None) -> None:
    """Refuse what can be known to be wrong before anything is started.

    Raises:
        ValueError: a map, policy or number that cannot be played.
    """
    if domain is not None and not 0 <= domain <= 101:
        raise ValueError(f"domain id {domain}: must be 0 to 101")
    config = make_config(setup.preset, setup.execution, **parse_settings(setup.settings))
    map_assets(setup.map, config)  # also fills the cache that the nodes read
    make_policy(setup.policy)


def environment(setup: GameSetup, domain: int | None) -> dict[str, str]:
    """What the processes of a game find in their environment beside that of the caller."""
    found = {"PYTHONUNBUFFERED": "1"}
    if domain is not None:
        found["ROS_DOMAIN_ID"] = str(domain)
    if setup.sim:
        found["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"  # a simulated game must never drive a real robot
    return found


def _play(
    setup: GameSetup, processes: ProcessGroup, status_line: StatusLine, writer: LineWriter, stop: Stop, start: bool
) -> int:
    status = 0
    try:
        for name in setup.first_nodes:
            processes.start(name)
        while not stop.asked:
            status_line.spin(POLL_S)
            if WAIT in processes and (ended := processes.status(WAIT)) is not None:
                words = processes.last_words(WAIT)
                processes.dismiss(WAIT)
                if ended != 0:
                    writer.say(f"the robot is not localized: {words}")
                    status = NO_POSE
                    break
                processes.start(SELECTOR)
            if start and SELECTOR in processes and status_line.start_game():
                start = False
            if SELECTOR in processes.tend():
                status_line.halt()  # no node watches over its goal any more
            writer.show(status_line.line)
    except Lost as lost:
        writer.say(str(lost))
        status = NODE_LOST
    finally:
        writer.say("stopping: robot, lights, game")
        last_mover = next((name for name in STOP_ORDER[1::-1] if name in processes), None)
        killed = processes.stop(STOP_ORDER, lambda name: status_line.halt() if name == last_mover else None)
        if killed:
            writer.say(f"did not stop and had to be killed: {', '.join(killed)}")
    return status or (HAD_TO_KILL if killed else 0)
