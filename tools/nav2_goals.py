"""Record how a navigator drives the simulated base to goals: ``python -m tools.nav2_goals MAP --out FOLDER``.

With ``--nav2 COMMAND`` a real Nav2 drives, otherwise the simulated one; ``pacman-env ros up --help`` explains COMMAND.
The seed decides which kinds of goals follow each other, and draws each goal from where the robot is then. FOLDER gets
``goals.csv`` (one row per goal), ``samples.csv`` (pose and velocity, 10 Hz; Parquet at the end) and ``card.yaml``.
"""

import argparse
import csv
import hashlib
import math
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import astuple, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from action_msgs.msg import GoalStatus
from numpy.typing import NDArray
from rclpy.parameter import Parameter

from pacman_env.command_line.command import Parser, run_command, whole_number
from pacman_env.ros import topics
from pacman_env.ros.discovery import join
from pacman_env.ros.game_nodes import SIMULATOR, GameSetup, full_namespace
from pacman_env.ros.message_conversion import GHOST_OBSTACLE, Pose, Position, cloud_message, pose_of, seconds_of
from pacman_env.ros.observer import ObserverNode
from pacman_env.ros.pacman_game.ghost_trail import GhostTrail
from pacman_env.ros.process import StopSignals
from pacman_env.ros.selector.navigation_client import NavigationClient
from pacman_env.ros.supervisor import nav2
from pacman_env.world.maps.occupancy import load_map
from pacman_env.world.navigation.localization import compose
from tools.common import ROOT
from tools.nav2_trials import GHOST_MPS, Leg, Places, Route, Trial, draw_trials

SAMPLE_S = 0.1
GHOST_S = 0.2  # between two clouds, as in the game
GHOST_Z_M, GHOST_RADIUS_M = 0.25, 0.05
CAUGHT_M = 0.3  # a ghost that comes so near disappears, as the game would end
LIMIT_S = 60.0  # of one goal, then it is canceled
REST_S = 0.3
REST_MPS, REST_RADPS = 0.01, 0.02  # a slower robot stands
MOVES_MPS, MOVES_RADPS = 0.02, 0.05
READY_S = 90.0  # of wall time, until Nav2 accepts goals
STATUSES = {getattr(GoalStatus, f"STATUS_{name.upper()}"): name for name in ("succeeded", "canceled", "aborted")}


@dataclass
class SentGoal:
    """Facts of a goal when it is sent: times in s of the simulated clock, poses in m and rad."""

    number: int
    trial: int
    kind: str  # how it is meant to end: plain, preempted, canceled
    ghost: str  # of the trial: none, far, near, walking
    from_rest: bool
    x: float
    y: float
    yaw: float
    path_m: float  # of the game's planner
    bearing: float  # of the path's first 0.4 m, relative to the robot's heading, rad
    goal_clearance_m: float
    path_clearance_m: float  # the least along the path
    start_x: float
    start_y: float
    start_yaw: float
    start_v: float
    start_w: float
    sent_s: float


@dataclass
class Goal(SentGoal):
    """One row of ``goals.csv``: a goal and what came of it, nan or -1 for nothing."""

    accepted_s: float = math.nan
    moved_s: float = math.nan  # first motion, if sent at rest
    preempts: int = -1
    preempted_by: int = -1
    canceled_s: float = math.nan
    ended_s: float = math.nan
    status: str = ""
    error_code: int = -1
    driven_m: float = math.nan  # from sending to the end
    end_x: float = math.nan
    end_y: float = math.nan
    end_yaw: float = math.nan
    end_v: float = math.nan
    amcl_x: float = math.nan  # last amcl_pose at the end
    amcl_y: float = math.nan
    amcl_yaw: float = math.nan
    believed_x: float = math.nan  # last feedback of the navigator
    believed_y: float = math.nan
    stopped_s: float = math.nan  # standstill after the end or the cancel
    stop_m: float = math.nan  # driven from the end or the cancel to the standstill


class Recorder(ObserverNode):
    """Node that sends goals one after another and writes what the robot does."""

    def __init__(self, namespace: str, places: Places, folder: Path) -> None:
        super().__init__("nav2_goals", namespace, parameter_overrides=[Parameter("use_sim_time", value=True)])
        self._places, self.goals = places, dict[int, Goal]()
        self._goals_file = (folder / "goals.csv").open("w", newline="")
        self._samples_file = (folder / "samples.csv").open("w", newline="", buffering=1)
        self._goals_out, self._samples_out = csv.writer(self._goals_file), csv.writer(self._samples_file)
        self._goals_out.writerow(field.name for field in fields(Goal))
        self._samples_out.writerow(("time_s", "x", "y", "yaw", "v", "w", "goal", "ghost_x", "ghost_y"))
        self._origin: Pose | None = None
        self.pose: Pose | None = None
        self.amcl: Pose | None = None
        self._v = self._w = self._driven_m = self._odometry_s = self._sampled_s = self._moved_s = 0.0
        self._goal: Goal | None = None
        self._way: NDArray[np.float64] = np.zeros((0, 2))  # of the ghost; empty: no ghost
        self._walked_m, self._ghost_mps, self._trail = 0.0, 0.0, GhostTrail()
        self._ghost: Position | None = None
        self.client = NavigationClient(self, self._on_accepted, self._on_rejected, self._on_finished)
        topics.SIMULATED_ORIGIN.subscription(self, self._on_origin)
        topics.AMCL_POSE.subscription(self, self._on_amcl)
        topics.ODOMETRY.subscription(self, self._on_odometry)
        self._cloud, self._trail_out = topics.CLYDE_OBSTACLE.publisher(self), topics.CLYDE_TRAIL.publisher(self)
        self.create_timer(GHOST_S, self._show_ghost)

    def now_s(self) -> float:
        return float(self.get_clock().now().nanoseconds) * 1e-9

    def _on_origin(self, message: Any) -> None:
        self._origin = pose_of(message)

    def _on_amcl(self, message: Any) -> None:
        self.amcl = pose_of(message)

    def _on_odometry(self, message: Any) -> None:
        twist, last_s = message.twist.twist, self._odometry_s
        if self._origin is None:
            return
        self._odometry_s = now_s = seconds_of(message.header.stamp)
        self.pose = compose(self._origin, pose_of(message, "odom"))
        self._v, self._w = twist.linear.x, twist.angular.z
        self._driven_m += abs(self._v) * min(max(now_s - last_s, 0.0), 1.0)
        if abs(self._v) > REST_MPS or abs(self._w) > REST_RADPS:
            self._moved_s = now_s
        goal, moves = self._goal, abs(self._v) > MOVES_MPS or abs(self._w) > MOVES_RADPS
        if moves and goal and goal.from_rest and math.isnan(goal.moved_s) and now_s > goal.sent_s:
            goal.moved_s = now_s
        if now_s - self._sampled_s >= SAMPLE_S - 1e-3:
            self._sampled_s = now_s
            where = [f"{value:.3f}" for value in (now_s, *self.pose)]
            speeds = [f"{value:.4g}" for value in (self._v, self._w)]
            ghost = [f"{value:.2f}" for value in self._ghost or (math.nan, math.nan)]
            self._samples_out.writerow([*where, *speeds, goal.number if goal else -1, *ghost])

    def _show_ghost(self) -> None:
        ghost = None
        if len(self._way):
            along = np.append(0.0, np.cumsum(np.hypot(*np.diff(self._way, axis=0).T)))
            self._walked_m += self._ghost_mps * GHOST_S
            x, y = (float(np.interp(self._walked_m, along, values)) for values in self._way.T)
            ghost = x, y
        if ghost and self.pose is not None and math.dist(ghost, self.pose[:2]) < CAUGHT_M:
            self._way, ghost = self._way[:0], None
        self._ghost, stamp = ghost, self.get_clock().now().to_msg()
        points = GHOST_RADIUS_M * GHOST_OBSTACLE + ghost if ghost else GHOST_OBSTACLE[:0]
        self._cloud.publish(cloud_message(points, stamp, GHOST_Z_M))
        trail = self._trail.points([ghost] if ghost else [], self.now_s())
        self._trail_out.publish(cloud_message(trail, stamp, GHOST_Z_M))

    def _on_accepted(self, number: int) -> None:
        self.goals[number].accepted_s = self.now_s()

    def _on_rejected(self, number: int) -> None:
        self.goals[number].status, self.goals[number].ended_s = "rejected", self.now_s()

    def _on_finished(self, number: int, status: int, believed: Position | None) -> None:
        goal = self.goals[number]
        goal.status, goal.error_code, goal.ended_s = STATUSES[status], self.client.last_error, self.now_s()
        goal.driven_m = self._driven_m - goal.driven_m
        goal.end_x, goal.end_y, goal.end_yaw = self.pose or (math.nan,) * 3
        goal.amcl_x, goal.amcl_y, goal.amcl_yaw = self.amcl or (math.nan,) * 3
        goal.believed_x, goal.believed_y = believed or (math.nan,) * 2
        goal.end_v = self._v

    def wait_s(self, seconds: float) -> None:
        end_s = self.now_s() + seconds
        self.spin_until(lambda: self.now_s() >= end_s, 3 * seconds + 5)

    def _stands(self) -> bool:
        return self._odometry_s - self._moved_s >= REST_S

    def run_trial(self, number: int, trial: Trial) -> None:
        """Send the goals of a trial, each while the one before it runs, and write them when the last one has ended."""
        if trial.from_rest:
            self.wait_s(1.0)
            self.spin_until(self._stands, 10.0)
        sent: list[Goal] = []
        for leg in trial.legs:
            assert self.pose is not None
            route = self._places.route(self.pose, leg)
            if leg is trial.legs[0]:
                self._way, self._walked_m = self._places.ghost_way(trial.ghost, route), 0.0
                self._ghost_mps = GHOST_MPS if trial.ghost == "walking" else 0.0
                if len(self._way) and trial.from_rest:
                    self.wait_s(1.0)  # the costmaps see it
            goal = self._send(number, trial, leg, route, sent[-1] if sent else None)
            sent.append(goal)
            if self.spin_until(lambda: sent[-1].status, leg.lasts_s if leg.kind != "plain" else LIMIT_S):
                break
        last_m = self._driven_m
        if not goal.status:
            goal.canceled_s = self.now_s()
            self.client.cancel(goal.number)
        self.spin_until(lambda: all(one.status for one in sent) and (not trial.pauses or self._stands()), 20.0)
        if trial.pauses:
            goal.stopped_s, goal.stop_m = self._moved_s, self._driven_m - last_m
        self._goal, self._way = None, self._way[:0]
        self._goals_out.writerows([f"{v:.3f}" if isinstance(v, float) else v for v in astuple(one)] for one in sent)
        self._goals_file.flush()

    def _send(self, trial: int, drawn: Trial, leg: Leg, route: Route, before: Goal | None) -> Goal:
        assert self.pose is not None
        x, y = route.xy[-1].tolist()
        yaw = math.atan2(*(route.xy[-1] - route.xy[max(len(route.xy) - 5, 0)])[::-1])
        measures = route.length_m, route.bearing, route.goal_clearance_m, route.clearance_m
        start = (*self.pose, self._v, self._w, self.now_s())
        goal = Goal(len(self.goals), trial, leg.kind, drawn.ghost, self._stands(), x, y, yaw, *measures, *start)
        goal.driven_m = self._driven_m
        if before is not None and not before.status:
            goal.preempts, before.preempted_by = before.number, goal.number
        self.goals[goal.number] = self._goal = goal
        self.client.send(goal.number, (x, y, yaw))
        return goal

    def close(self) -> None:
        self._goals_file.close()
        self._samples_file.close()
        super().close()


def record(arguments: argparse.Namespace) -> None:
    from pyarrow import csv as arrow  # now, because its absence would be noticed after the recording
    from pyarrow import parquet

    join(None, this_machine=True)
    folder: Path = arguments.out
    folder.mkdir(parents=True, exist_ok=True)
    setup = GameSetup(map=arguments.map, sim=True, nav2=arguments.nav2, settings=tuple(arguments.set))
    occupancy, config = load_map(setup.map), setup.config()
    trials = draw_trials(np.random.default_rng(arguments.seed), arguments.trials)
    places = Places(occupancy, config, np.random.default_rng([arguments.seed, 1]))
    card: dict[str, Any] = {
        "navigator": arguments.navigator or ("Nav2" if setup.nav2 else "simulated Nav2"),
        "map": occupancy.name,
        "map_hash": occupancy.hash[:12],
        "config": {name: hashlib.sha256((ROOT / "config" / name).read_bytes()).hexdigest()[:12] for name in nav2.FILES},
        "game_config": config.hash,
        "seed": arguments.seed,
        "date": time.strftime("%Y-%m-%d"),
        "command": f"python -m tools.nav2_goals {occupancy.name} --seed {arguments.seed} --trials {arguments.trials}",
    }
    logs = Path(tempfile.mkdtemp(prefix="nav2-goals-"))
    print(f"logs: {logs}", flush=True)
    commands = {SIMULATOR: setup.command(SIMULATOR)} | ({"nav2": nav2.command(setup, logs)} if setup.nav2 else {})
    children: list[subprocess.Popen[bytes]] = []
    for name, words in commands.items():
        log = (logs / f"{name}.log").open("w")
        children.append(subprocess.Popen([sys.executable, "-m", *words], stdout=log, stderr=subprocess.STDOUT))
    node = Recorder(full_namespace(setup.namespace), places, folder)
    start, end = time.monotonic(), time.monotonic() + 60 * arguments.minutes
    try:
        if not node.spin_until(lambda: node.client.ready and node.amcl and node.pose, READY_S):
            raise ValueError("no navigator, or no pose: see the logs")
        node.wait_s(3.0)
        for number, trial in enumerate(trials):
            if time.monotonic() > end or any(child.poll() is not None for child in children):
                break
            node.run_trial(number, trial)
    finally:
        for child in reversed(children):
            child.send_signal(signal.SIGTERM)
            child.wait(20)
        node.close()
        parquet.write_table(arrow.read_csv(folder / "samples.csv"), folder / "samples.parquet", compression="zstd")
        (folder / "samples.csv").unlink()
        goals = node.goals.values()
        card["minutes"] = round((time.monotonic() - start) / 60, 1)
        if (nav2_log := logs / "nav2.log").is_file():
            card["controller_cycles_late"] = nav2_log.read_bytes().count(b"Control loop missed")
        card["active_s"] = round(sum(goal.ended_s - goal.sent_s for goal in goals if goal.ended_s > 0))
        card["goals"] = dict(Counter(f"{goal.kind} {goal.status or 'lost'}" for goal in goals))
        (folder / "card.yaml").write_text(yaml.safe_dump(card, sort_keys=False))


def make_parser(module: str, description: str | None, out: str) -> Parser:
    """Return a parser of the options that recordings of a navigator share; ``out`` is what they write."""
    parser = Parser(prog=f"python -m tools.{module}", description=description)
    parser.add_argument("map")
    parser.add_argument("--out", type=Path, required=True, metavar=out)
    parser.add_argument("--nav2", default="", metavar="COMMAND", help="a real Nav2; else the simulated one drives")
    parser.add_argument("--navigator", default="", metavar="TEXT", help="its name and version, for what is written")
    parser.add_argument("--set", action="append", default=[], metavar="NAME=VALUE", help="of the configuration")
    return parser


if __name__ == "__main__":
    parser = make_parser("nav2_goals", __doc__, "FOLDER")
    parser.add_argument("--trials", type=whole_number(1), default=100, help="a trial has one to three goals (100)")
    parser.add_argument("--minutes", type=float, default=30.0, help="begin no trial after this time (30)")
    parser.add_argument("--seed", type=whole_number(0), default=0)
    with StopSignals(breaks_off=True):
        sys.exit(run_command(parser, None, record, "ros"))
