"""Record rounds of the game on the simulated base: ``python -m tools.nav2_rounds MAP --out FILE``.

With ``--nav2 COMMAND`` a real Nav2 drives, otherwise the simulated one; ``pacman-env ros up --help`` explains COMMAND.
FILE (CSV) gets one row per round, as soon as the round has ended. An existing file is continued.
"""

import argparse
import csv
import json
import math
import signal
import subprocess
import sys
import time
from collections import deque
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any

from rclpy.parameter import Parameter

from pacman_env import __version__
from pacman_env.command_line.command import run_command, whole_number
from pacman_env.ros import topics
from pacman_env.ros.discovery import join
from pacman_env.ros.game_nodes import NAMESPACE, full_namespace
from pacman_env.ros.message_conversion import pose_of, seconds_of
from pacman_env.ros.observer import ObserverNode
from pacman_env.ros.process import StopSignals
from pacman_env.world.maps.occupancy import map_name
from tools.nav2_goals import make_parser

BUMP = 1  # irobot_create_msgs/HazardDetection.BUMP
TRUE_POSES = 200  # newest true poses that AMCL poses are compared with; 50 arrive per second
LATE = b"missed its desired rate"  # in the log of Nav2
START_S = 300.0  # of wall time, until the first round begins
ROUND_S = 900.0  # of wall time, from the end of one round to the end of the next


@dataclass
class Round:
    """One row: times in s of the simulated clock, lengths in m."""

    version: str
    navigator: str
    map: str
    policy: str
    clyde_mps: float
    end: str = ""  # the state after ``running``: complete, dying, or menu after a reset
    result: str = ""
    collected: int = 0
    pellets: int = 0
    time_s: float = 0.0
    goals: int = 0  # sent to the navigator
    aborted: int = 0  # of them, without those that another goal replaced
    bumps: int = 0
    driven_m: float = 0.0
    amcl_rms_m: float = math.nan
    amcl_most_m: float = math.nan
    late_cycles: int = 0  # of Nav2's controller, which has 20 a second: more than a few mean a busy computer


class RoundRecorder(ObserverNode):
    """Node that listens to a game and keeps a row for each round."""

    def __init__(self, namespace: str, card: Round) -> None:
        super().__init__("nav2_rounds", namespace, parameter_overrides=[Parameter("use_sim_time", value=True)])
        self._card, self.ended = card, list[Round]()
        self._round: Round | None = None
        self._begun_s, self._sent, self._aborted = 0.0, 0, 0  # start of the round; goals of all rounds
        self._true: deque[tuple[float, float, float]] = deque(maxlen=TRUE_POSES)
        self._errors: list[float] = []
        self._bumped = False
        topics.GAME_STATE.subscription(self, self._on_state)
        topics.GAME_RESULT.subscription(self, self._on_result)
        topics.PELLETS_SPAWNED.subscription(self, self._on_spawned)
        topics.PELLETS_COLLECTED.subscription(self, self._on_collected)
        topics.DIAGNOSTICS.subscription(self, self._on_diagnostics)
        topics.SIMULATED_POSE.subscription(self, self._on_true_pose)
        topics.AMCL_POSE.subscription(self, self._on_amcl)
        topics.HAZARD_DETECTION.subscription(self, self._on_hazards)

    def _on_state(self, message: Any) -> None:
        now_s = self.get_clock().now().nanoseconds * 1e-9
        if message.data == "running" and self._round is None:
            self._round = replace(self._card, goals=-self._sent, aborted=-self._aborted)
            self._begun_s, self._errors = now_s, []
        elif message.data != "running" and self._round is not None:
            row, self._round = self._round, None
            row.end, row.time_s = message.data, round(now_s - self._begun_s, 2)
            if self._errors:
                row.amcl_rms_m = round(math.hypot(*self._errors) / math.sqrt(len(self._errors)), 4)
                row.amcl_most_m = round(max(self._errors), 4)
            row.goals += self._sent
            row.aborted += self._aborted
            row.driven_m = round(row.driven_m, 2)
            self.ended.append(row)

    def _latest(self) -> Round:
        """Return the round that is played, or has just ended: its last messages may come after its end."""
        return self._round or (self.ended[-1] if self.ended else replace(self._card))

    def _on_result(self, message: Any) -> None:
        self._latest().result = message.data

    def _on_spawned(self, message: Any) -> None:
        self._card.pellets = message.data or self._card.pellets

    def _on_collected(self, message: Any) -> None:
        row = self._latest()
        row.collected = max(row.collected, message.data)

    def _on_diagnostics(self, message: Any) -> None:
        facts = json.loads(message.data)
        self._sent, self._aborted = facts["goals_sent"], facts["goals_aborted"]

    def _on_true_pose(self, message: Any) -> None:
        x, y, _ = pose_of(message)
        if self._true and self._round is not None:
            self._round.driven_m += math.dist(self._true[-1][1:], (x, y))
        self._true.append((seconds_of(message.header.stamp), x, y))

    def _on_amcl(self, message: Any) -> None:
        amcl_s = seconds_of(message.header.stamp)
        at = [(x, y) for true_s, x, y in self._true if abs(true_s - amcl_s) < 0.05]
        if at and self._round is not None:
            self._errors.append(math.dist(at[-1], pose_of(message)[:2]))

    def _on_hazards(self, message: Any) -> None:
        bumped = any(hazard.type == BUMP for hazard in message.detections)
        if self._round is not None:
            self._round.bumps += bumped and not self._bumped
        self._bumped = bumped


def record(arguments: argparse.Namespace) -> None:
    join(None, this_machine=True)
    file: Path = arguments.out
    words = ["--map", arguments.map, "--policy", arguments.policy, "--sim", "--rounds", str(arguments.rounds)]
    words += ["--logs", str(file.with_suffix(".logs"))]
    words += ["--nav2", arguments.nav2] if arguments.nav2 else []
    for setting in ("clyde.speed_step_mps=0.0", f"clyde.speed_mps={arguments.clyde_speed}", *arguments.set):
        words += ["--set", setting]
    file.parent.mkdir(parents=True, exist_ok=True)
    navigator = arguments.navigator or ("Nav2" if arguments.nav2 else "simulated Nav2")
    card = Round(__version__, navigator, map_name(Path(arguments.map)), arguments.policy, arguments.clyde_speed)
    node = RoundRecorder(full_namespace(NAMESPACE), card)
    begins, nav2_log, late = not file.exists(), file.with_suffix(".logs") / "nav2.log", 0
    game = subprocess.Popen([sys.executable, "-m", "pacman_env.cli.main", "ros", "up", *words])
    try:
        with file.open("a", newline="") as out:
            rows = csv.DictWriter(out, [field.name for field in fields(Round)])
            if begins:
                rows.writeheader()
            until = time.monotonic() + START_S + ROUND_S
            while game.poll() is None and time.monotonic() < until:
                node.spin_until(lambda: node.ended or game.poll() is not None, 10.0)
                if node.ended:
                    node.spin_until(lambda: False, 2.0)  # its result comes a moment later
                    row, before = node.ended.pop(), late
                    late = nav2_log.read_bytes().count(LATE) if arguments.nav2 else 0
                    row.late_cycles = late - before
                    rows.writerow(asdict(row))
                    out.flush()
                    until = time.monotonic() + ROUND_S
    finally:
        game.send_signal(signal.SIGINT)
        game.wait(60)
        node.close()


if __name__ == "__main__":
    parser = make_parser("nav2_rounds", __doc__, "FILE")
    parser.add_argument("--policy", default="ppo")
    parser.add_argument("--clyde-speed", type=float, default=0.25, help="m/s (0.25)")
    parser.add_argument("--rounds", type=whole_number(1), default=20, help="(20)")
    with StopSignals(breaks_off=True):
        sys.exit(run_command(parser, None, record, "ros"))
