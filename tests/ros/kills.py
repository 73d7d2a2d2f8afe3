"""Kill and freeze the processes of a simulated game, and check score, stop and recovery.

``python -m tests.ros.kills NUMBER [SEED [FOLDER]]``

A game plays on at four times real time. Every few seconds one of its processes is killed (SIGKILL) or frozen (SIGSTOP),
one in ten times while the robot is stopped. ``test_kills.py`` runs a few of them.
"""

import json
import os
import random
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from signal import SIGINT, SIGKILL, SIGSTOP
from typing import Any

import psutil
import rclpy

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import GAME, POLICY, SIMULATOR, WATCHER
from pacman_env.ros.observer import ObserverNode
from tests.waiting import PATIENCE_S

MARKS = {SIMULATOR: "sim_robot", WATCHER: "supervisor.watcher", GAME: "pacman_game.pacman_game"}
#: No round is lost; rounds are long.
SETTINGS = ("clyde.speed_mps=0.02", "execution.death_radius_m=0.001", "show.start_s=2")
MOVES_MPS = 0.02
STAYS_S = 4.0  # how long a stopped robot must stand, wall time; it is 16 s of the game
SOON_S, MOST = 65.0, 3  # a process is killed at most three times in this time: ``ros up`` gives up after five
SHORT = 4  # faults of the test; the last one is while the robot is stopped
FAULTS = {"kill": SIGKILL, "freeze": SIGSTOP}


class Game(ObserverNode):
    """A game of ``ros up``, and what it publishes."""

    def __init__(self, domain: int, folder: Path, seed: int) -> None:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        super().__init__("kills", "/robot_15")
        self.random = random.Random(seed)
        self.folder = folder
        self.values: dict[str, Any] = {}
        self.speed_mps, self.moved_s = 0.0, 0.0
        self.collected: set[str] = set()  # in this round, as reported
        self.unreported = 0  # pellets of this round that may lack a report: a game is killed after it has saved one
        self.total = 0  # in rounds before, in which every pellet was collected
        self.wrong: list[str] = []  # scores that were not right
        self.killed_s: dict[str, list[float]] = {}
        for topic in (topics.PELLETS_SPAWNED, topics.GAME_RESULT, topics.SCORE, topics.OPERATOR_STOP):
            topic.subscription(self, lambda message, name=topic.name: self._on_value(name, message.data))
        topics.GAME_STATUS.subscription(self, self._on_status)
        topics.ODOMETRY.subscription(self, self._on_odometry)
        self._stop = topics.OPERATOR_STOP.publisher(self)
        command = [sys.executable, "-m", "pacman_env.cli.main", "ros", "up", "--map", "house", "--sim", "--play-on"]
        command += ["--speed", "4", "--logs", str(folder), *(word for one in SETTINGS for word in ("--set", one))]
        with (folder / "up.log").open("wb") as log:
            self.up = subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=log, stderr=log)

    def _on_value(self, name: str, value: Any) -> None:
        if name == topics.GAME_RESULT.name and value not in ("", self.values.get(name)):
            self.total += self.values[topics.PELLETS_SPAWNED.name]
            if value != f"Complete - Score: {self.total}":
                self.wrong.append(f"{value!r} after {self.total} pellets")
            self.collected, self.unreported = set(), 0
        if name == topics.SCORE.name and not 0 <= value - self.total - len(self.collected) <= self.unreported:
            self.wrong.append(f"score {value} after {self.total} + {len(self.collected)} pellets")
        self.values[name] = value

    def _on_status(self, message: Any) -> None:
        if message.data.startswith("pellet_collected:"):
            self.collected.add(message.data)

    def _on_odometry(self, message: Any) -> None:
        twist = message.twist.twist
        self.speed_mps = abs(twist.linear.x) + abs(twist.angular.z)
        if self.speed_mps > MOVES_MPS:
            self.moved_s = time.monotonic()

    def processes(self) -> dict[str, psutil.Process]:
        """Return the running processes of the game by name."""
        found = {}
        for process in psutil.Process(self.up.pid).children(recursive=True):
            try:
                words, parent = " ".join(process.cmdline()), process.parent()
            except psutil.Error:
                continue
            name = next((name for name, mark in MARKS.items() if mark in words), None)
            if "policy_child" in words or (name == GAME and parent is not None and parent.pid != self.up.pid):
                name = POLICY
            if name is not None:
                found[name] = process
        return found

    def await_(self, what: str, condition: Callable[[], object], limit_s: float = PATIENCE_S) -> float:
        """Wait until the condition holds; return the time, s. Raises AssertionError if the game ends or hangs."""
        start_s = time.monotonic()
        while not condition():
            self.spin(0.05)
            assert self.up.poll() is None, f"ros up ended: {(self.folder / 'up.log').read_text()[-2000:]}"
            assert time.monotonic() - start_s < limit_s, f"{what}: not within {limit_s:g} s"
        return time.monotonic() - start_s

    def drives(self) -> None:
        self.await_("a driving robot", lambda: time.monotonic() - self.moved_s < 0.1)

    def request_stop(self, stopped: bool) -> None:
        content = {"stopped": stopped, "at": time.time_ns(), "who": "kills", "by": "/kills"}
        self._stop.publish(topics.OPERATOR_STOP.type(data=json.dumps(content)))

    def victim(self) -> str:
        def spared() -> list[str]:
            now = time.monotonic()
            for times in self.killed_s.values():
                times[:] = [when for when in times if now - when < SOON_S]
            return [name for name in self.processes() if len(self.killed_s.get(name, ())) < MOST]

        self.await_("a process that may be killed", spared)
        return self.random.choice(spared())

    def harm(self, stopped: bool) -> tuple[str, str, float]:
        """Kill or freeze a process; return its name, the fault, and the time until the robot moves again, s."""
        self.drives()
        if stopped:
            self.request_stop(True)
            self.await_("a standing robot", lambda: time.monotonic() - self.moved_s > 0.5)
        name, fault = self.victim(), self.random.choice(list(FAULTS))
        self.killed_s.setdefault(name, []).append(time.monotonic())
        self.unreported += name == GAME
        self.processes()[name].send_signal(FAULTS[fault])
        harmed_s = time.monotonic()
        if stopped:
            self.await_("time", lambda: time.monotonic() - harmed_s > STAYS_S)
            assert self.moved_s < harmed_s, f"a stopped robot moved after {fault} of {name}"
            self.await_("the processes", lambda: len(self.processes()) == len(MARKS) + 1)
            self.spin_until(lambda: False, 3.0)
            assert self.moved_s < harmed_s, f"a stopped robot moved after the restart of {name}"
            self.request_stop(False)
        # A robot that drives to its last goal meanwhile must be halted, or drive again after the restart.
        self.spin_until(lambda: time.monotonic() - self.moved_s > 0.3, 1.5)
        self.drives()
        return name, fault, time.monotonic() - harmed_s

    def end(self) -> int:
        self.up.send_signal(SIGINT)
        status = self.up.wait(60.0)
        self.close()
        return status


def play(domain: int, folder: Path, faults: int, seed: int = 0, shown: bool = False) -> dict[str, Any]:
    """Harm a game so many times; return the times until the robot moved again, and the wrong scores."""
    game = Game(domain, folder, seed)
    times: list[tuple[str, str, bool, float]] = []
    try:
        for number in range(faults):
            stopped = number % 10 == SHORT - 1
            name, fault, again_s = game.harm(stopped)
            times.append((name, fault, stopped, again_s))
            if shown:
                print(number, name, fault, "stopped" if stopped else "", f"{again_s:.1f} s", flush=True)
        game.await_("a pellet", lambda: game.total + len(game.collected))
    finally:
        status = game.end()
    return {"times": times, "wrong": game.wrong, "status": status, "score": game.total + len(game.collected)}


def main() -> int:
    folder = Path(sys.argv[3] if len(sys.argv) > 3 else "kills")
    folder.mkdir(parents=True, exist_ok=True)
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    result = play(63, folder, int(sys.argv[1]), seed, shown=True)
    for name in (*MARKS, POLICY):
        for fault in FAULTS:
            row = [one[3] for one in result["times"] if one[:3] == (name, fault, False)]
            if row:
                print(
                    f"{name:12} {fault:7} {len(row):3}  median {statistics.median(row):.1f} s, at most {max(row):.1f} s"
                )
    rest = [one[3] for one in result["times"] if not one[2]]
    print(f"all {len(rest)}: median {statistics.median(rest):.1f} s; wrong scores {result['wrong']}")
    print(f"score {result['score']}, status {result['status']}")
    return bool(result["wrong"])


if __name__ == "__main__":
    rclpy.logging.set_logger_level("kills", rclpy.logging.LoggingSeverity.ERROR)
    sys.exit(main())
