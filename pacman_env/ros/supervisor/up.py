"""``pacman-env ros up``: a whole game on one machine, from the first process to the last.

The nodes are processes of ``processes.py``; this is what goes on above them: the robot's pose comes before
the game, one line says how the game stands, and at the end the robot stands still and its lights are off before the
rest is stopped.
"""

from __future__ import annotations

import dataclasses
import os
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, TextIO

import rclpy
from platformdirs import user_log_path
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from pacman_env.config import make_config
from pacman_env.policies.registry import make_policy
from pacman_env.ros.supervisor.game_nodes import (
    GAME,
    QUIET,
    REFEREE,
    SELECTOR,
    SIMULATOR,
    STOP_ORDER,
    WAIT,
    Game,
    full_namespace,
)
from pacman_env.ros.supervisor.processes import Crew, Lost
from pacman_env.ros.supervisor.status_line import Watcher
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
LINE_S = 0.5  # how often the line is looked at
_CLEAR = "\r\x1b[K"


class Screen:
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


class Asked:
    """SIGINT and SIGTERM ask for the end, once; more of them change nothing, the end takes its time."""

    def __init__(self) -> None:
        self.yes = False

    def __enter__(self) -> Asked:
        self._before = {number: signal.signal(number, self._ask) for number in (signal.SIGINT, signal.SIGTERM)}
        return self

    def __exit__(self, *exception: object) -> None:
        for number, handler in self._before.items():
            signal.signal(number, handler)

    def _ask(self, number: int, frame: Any) -> None:
        self.yes = True


def up(
    game: Game, domain: int | None = None, logs: Path | None = None, start: bool = False, out: TextIO | None = None
) -> int:
    """Play until SIGINT or SIGTERM; to be called in the main thread.

    Args:
        game: what to start, and where.
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
    check(game, domain)
    screen = Screen(out or sys.stdout)
    logs = logs or user_log_path("pacman_env") / (game.namespace.strip("/").replace("/", "-") or "root")
    logs.mkdir(parents=True, exist_ok=True)
    game = remembered_in(logs / f"{REFEREE}.json", game)
    os.environ.update(environment(game, domain))
    context = rclpy.Context()
    rclpy.init(args=["--ros-args", *QUIET], context=context, signal_handler_options=SignalHandlerOptions.NO)
    watcher = Watcher(full_namespace(game.namespace), game.policy, game.sim, context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(watcher)
    crew = Crew(logs, dict(os.environ), screen.say)
    screen.say(f"game on {full_namespace(game.namespace)}, logs in {logs}")
    try:
        with Asked() as asked:
            return _play(game, crew, watcher, executor, screen, asked, start)
    finally:
        watcher.destroy_node()
        rclpy.shutdown(context=context)


def remembered_in(path: Path, game: Game) -> Game:
    """The same game, kept in that file while it is played; one that was kept before is not gone on with.

    Raises:
        OSError: what is there cannot be removed.
    """
    path.unlink(missing_ok=True)
    own = {"memory": str(path), **game.extra.get(REFEREE, {})}
    return dataclasses.replace(game, extra={**game.extra, REFEREE: own})


def check(game: Game, domain: int | None) -> None:
    """All that can be known to be wrong before anything is started.

    Raises:
        ValueError: a map, policy or number that cannot be played.
    """
    if domain is not None and not 0 <= domain <= 101:
        raise ValueError(f"domain id {domain}: must be 0 to 101")
    map_assets(load_map(game.map), make_config())  # also fills the cache that the nodes read
    make_policy(game.policy)


def environment(game: Game, domain: int | None) -> dict[str, str]:
    """What the processes of a game find in their environment beside that of the caller."""
    found = {"PYTHONUNBUFFERED": "1"}
    if domain is not None:
        found["ROS_DOMAIN_ID"] = str(domain)
    if game.sim:
        found["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"  # a simulated game must never drive a real robot
    return found


def _play(game: Game, crew: Crew, watcher: Watcher, executor: Any, screen: Screen, asked: Asked, start: bool) -> int:
    status = 0
    try:
        for name in (*((SIMULATOR,) if game.sim else ()), *GAME, WAIT):
            crew.start(name, game.arguments(name))
        while not asked.yes:
            executor.spin_once(timeout_sec=POLL_S)
            if WAIT in crew and (ended := crew.status(WAIT)) is not None:
                words = crew.last_words(WAIT)
                crew.dismiss(WAIT)
                if ended != 0:
                    screen.say(f"the robot is not localized: {words}")
                    status = NO_POSE
                    break
                crew.start(SELECTOR, game.arguments(SELECTOR))
            if start and SELECTOR in crew and watcher.start_game():
                start = False
            if SELECTOR in crew.tend():
                watcher.halt(executor.spin_once)  # nobody watches over its goal any more
            screen.show(watcher.line)
    except Lost as lost:
        screen.say(str(lost))
        status = NODE_LOST
    finally:
        screen.say("stopping: robot, lights, game")
        last_mover = next((name for name in STOP_ORDER[1::-1] if name in crew), None)
        killed = crew.stop(STOP_ORDER, lambda name: watcher.halt(executor.spin_once) if name == last_mover else None)
        if killed:
            screen.say(f"did not stop and had to be killed: {', '.join(killed)}")
    return status or (HAD_TO_KILL if killed else 0)
