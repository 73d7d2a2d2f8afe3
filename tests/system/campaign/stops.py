"""How soon a simulated robot stands after a stop, while a part of the game is frozen, killed or fails.

``python -m tests.system.campaign.stops --domain-id 90 --out stops.md`` plays 14 games in real time, about 15 minutes.
Times are simulated seconds.
"""

import argparse
import contextlib
import json
import os
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from pacman_env.ros import topics
from pacman_env.ros.discovery import join
from pacman_env.ros.game_nodes import GAME, WATCHER, module_of
from pacman_env.ros.observer import ObserverNode
from tests.ros.supervisor.terminal import Terminal
from tests.system.campaign.faulty import FILE

POLICY = "policy"
SIGNALS = {"frozen": signal.SIGSTOP, "killed": signal.SIGKILL}
FAULTS = {**dict.fromkeys((GAME, WATCHER), tuple(SIGNALS)), POLICY: ("hangs", "sleeps", "raises")}
CTRL_C = "\x03"
#: Keys of two games: a node is frozen at most three times before the last key, which ends the game.
GAMES = ((" ", "r", "ros stop", CTRL_C), ("look", "q"))
LIMITS_S = {"ros stop": 1.5}
LIMIT_S = 0.5
COMMAND = [sys.executable, "-m", "pacman_env.cli.main", "ros"]
_SETTINGS = ("clyde.speed_mps=0.02", "show.start_s=0.5", "show.death_s=0.5")
_BETWEEN_S = 0.3  # from the fault to the key
_STANDS_S = 1.0  # shorter pauses do not count as standing
_PATIENCE_S = 180.0


class Row(NamedTuple):
    part: str
    fault: str
    key: str
    seconds: float  # until the wheels stand
    status: int  # exit status of the command that the key ends or starts
    said: str

    @property
    def ok(self) -> bool:
        return self.seconds <= LIMITS_S.get(self.key, LIMIT_S)

    def __str__(self) -> str:
        key = {" ": "space", CTRL_C: "Ctrl-C"}.get(self.key, self.key)
        cells = (self.part, self.fault, key, f"{self.seconds:.2f}{'' if self.ok else ' LATE'}", self.status, self.said)
        return " | ".join(map(str, cells))


class Wheels(ObserverNode):
    """Speeds of the wheels by the simulated time, received in a thread of its own, and the processes that started."""

    def __init__(self) -> None:
        super().__init__("pacman_wheels", "/robot_15")
        self.samples: list[tuple[float, float, float]] = []  # time, m/s and rad/s
        self.started: set[int] = set()  # processes of nodes
        topics.ODOMETRY.subscription(self, self._on_odometry)
        topics.CONFIGURATION.subscription(self, self._on_configuration)
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._spin_until_closed, daemon=True)
        self._thread.start()

    def _spin_until_closed(self) -> None:
        while not self._closing.is_set():
            self.spin(0.1)

    def close(self) -> None:
        self._closing.set()
        self._thread.join()
        super().close()

    def _on_odometry(self, message: Any) -> None:
        stamp, twist = message.header.stamp, message.twist.twist
        self.samples.append((stamp.sec + stamp.nanosec / 1e9, abs(twist.linear.x), abs(twist.angular.z)))

    def _on_configuration(self, message: Any) -> None:
        self.started.add(json.loads(message.data)["started"][2])

    @property
    def drives(self) -> bool:
        return len(self.samples) > 5 and all(v > 0.1 for _, v, _ in self.samples[-5:])

    def stands_after_s(self, start_s: float) -> float:
        """Return the time until the robot stands, s; infinite if it never does."""
        samples = [sample for sample in self.samples if sample[0] >= start_s] or [(start_s, 0.0, 0.0)]
        for at_s, *_ in samples:
            if all(v + w < 0.01 for later_s, v, w in samples if at_s <= later_s < at_s + _STANDS_S):
                return at_s - start_s
        return float("inf")


@dataclass
class Game:
    terminal: Terminal
    wheels: Wheels
    words: list[str]  # that choose the game in other commands
    flag: Path  # the faulty policy's

    def wait_for(self, condition: Callable[[], Any], what: str) -> None:
        end_s = time.monotonic() + _PATIENCE_S
        while not condition():
            if time.monotonic() > end_s:
                raise RuntimeError(f"waited for {what}; the terminal showed {self.terminal.lines[-5:]}")
            time.sleep(0.02)

    def ask(self, *words: str) -> tuple[int, str]:
        command = [*COMMAND, *words, *self.words]
        done = subprocess.run(command, capture_output=True, text=True, timeout=_PATIENCE_S)
        return done.returncode, " ".join((done.stdout + done.stderr).split())

    def pid(self, node: str) -> int | None:
        """Return the process of a node that has started."""
        up = self.terminal.process.pid
        for child in Path(f"/proc/{up}/task/{up}/children").read_text().split():
            with contextlib.suppress(OSError):
                words = Path(f"/proc/{child}/cmdline").read_bytes().split(b"\0")
                started = node == WATCHER or int(child) in self.wheels.started
                if started and module_of(node).encode() in words:
                    return int(child)
        return None

    def drive(self, node: str) -> None:
        """Have the robot drive to a goal that is far away."""
        pressed_s = 0.0

        def is_ready(drives: bool) -> bool:
            nonlocal pressed_s
            if "".join(self.terminal.lines[-1:]).startswith("menu") and time.monotonic() > pressed_s + 5.0:
                pressed_s = time.monotonic()
                self.terminal.press("s")
            return self.wheels.drives == drives and self.pid(node) is not None

        for drives in (False, True):
            self.wait_for(partial(is_ready, drives), f"{node} in a robot that {'drives' if drives else 'stands'}")

    def cause(self, part: str, fault: str) -> None:
        if part != POLICY:
            os.kill(self.pid(part) or 0, SIGNALS[fault])
            return
        begun = self.flag.with_suffix(".begun")
        begun.unlink(missing_ok=True)
        self.flag.write_text(fault)
        self.wait_for(begun.exists, "the policy's fault")

    def play(self, part: str, fault: str, key: str) -> Row:
        """Cause a fault while the robot drives, press the key, and measure."""
        self.drive(GAME if part == POLICY else part)
        since = len(self.terminal.lines)
        self.cause(part, fault)
        time.sleep(_BETWEEN_S)
        start_s, status, said = self.wheels.samples[-1][0], 0, ""
        if key == "look":
            said = "; ".join("{}: {}".format(*self.ask(*words.split())) for words in ("status", "doctor --map house"))
        elif key == "ros stop":
            status, said = self.ask("stop")
        else:
            self.terminal.press(key)
        if key in ("q", CTRL_C):
            self.wait_for(lambda: self.terminal.process.poll() is not None, "its end")
            status = self.terminal.end()
        else:
            time.sleep(2 * _STANDS_S)
            self.terminal.press("g")
        seconds = 0.0 if key == "look" else self.wheels.stands_after_s(start_s)
        self.flag.unlink(missing_ok=True)
        words = ("again", "killed", "frozen", "policy '", "does not respond")
        lines = dict.fromkeys(line for line in self.terminal.lines[since:] if any(word in line for word in words))
        return Row(part, fault, key, seconds, status, "; ".join([said, *lines]))


@contextlib.contextmanager
def started(domain: int) -> Iterator[Game]:
    join(domain, this_machine=True)
    with tempfile.TemporaryDirectory() as folder, Wheels() as wheels:
        paths = filter(None, [str(Path.cwd()), os.environ.get("PYTHONPATH")])
        os.environ |= {FILE: f"{folder}/fault", "PYTHONPATH": os.pathsep.join(paths)}
        words = ["--sim", "--domain-id", str(domain)]
        policy = ["--map", "house", "--policy", "tests.system.campaign.faulty:Faulty", "--start", "--logs", folder]
        settings = [word for setting in _SETTINGS for word in ("--set", setting)]
        terminal = Terminal([*COMMAND, "up", *policy, *settings, *words])
        try:
            yield Game(terminal, wheels, words, Path(folder) / "fault")
        finally:
            if terminal.process.poll() is None:
                terminal.process.send_signal(signal.SIGINT)
                terminal.process.wait(_PATIENCE_S)


def rows(domain: int, part: str, fault: str, keys: Sequence[str]) -> Iterator[Row]:
    """Play one game and yield a row for each key."""
    with started(domain) as game:
        for key in keys:
            yield game.play(part, fault, key)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--domain-id", type=int, default=90)
    parser.add_argument("--parts", nargs="+", choices=tuple(FAULTS), default=tuple(FAULTS))
    parser.add_argument("--out", type=argparse.FileType("w"), default=sys.stdout)
    options = parser.parse_args()
    print("part | fault | key | s until it stands | exit | what is said\n---|---|---|---|---|---", file=options.out)
    games = [(part, fault, keys) for part in options.parts for fault in FAULTS[part] for keys in GAMES]
    late = 0
    for game in games:
        for row in rows(options.domain_id, *game):
            late += not row.ok
            print(row, file=options.out, flush=True)
    return int(late > 0)


if __name__ == "__main__":
    sys.exit(main())
