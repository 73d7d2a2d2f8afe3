"""Compare the simulated Nav2 with recorded goals of another navigator: ``pacman-env validation --recorded-goals``.

A folder of recordings has ``goals.csv``, a row per goal, and ``card.yaml``, which names navigator and map
(``eval/nav2/README.md``). The simulated Nav2 drives the goals of each trial from the same place at the same speed, and
they are pre-empted and canceled after the same time. Trials with a ghost near the path are left out, because a
recorded ghost depends on the robot.
"""

import csv
import itertools
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pacman_env.config import Config, ConfigError, located
from pacman_env.config.yaml_files import read_yaml
from pacman_env.sim.core.robot import SimulatedRobot, place
from pacman_env.world.maps.occupancy import load_map
from pacman_env.world.navigation import navigator
from pacman_env.world.navigation.localization import Pose

_GHOSTS_FAR = ("none", "far")
_LIMIT_S = 90.0  # longest duration of a trial
REST_MPS, REST_RADPS = 0.01, 0.02  # a slower robot stands
AHEAD, BEHIND = math.pi / 4, 3 * math.pi / 4  # bearings of goals ahead and behind
_CLOSE = 0.15  # relative difference of travel times that counts as close


@dataclass
class DrivenGoal:
    """Result of a goal; NaN for what did not happen."""

    succeeded: bool = False
    ended_s: float = math.nan  # from sending to the result
    driven_m: float = math.nan  # from sending to the result
    stop_m: float = math.nan  # from the cancel to the standstill

    @property
    def speed_mps(self) -> float:
        return self.driven_m / self.ended_s


@dataclass
class RecordedGoal:
    trial: str
    goal: tuple[float, float]  # m
    start: Pose
    velocity: tuple[float, float]  # m/s, rad/s at the start
    sent_s: float
    canceled_s: float  # NaN: not canceled
    bearing: float  # direction of the path's beginning relative to the heading, rad
    preempts: bool  # it replaces a running goal
    driven: DrivenGoal


def read_goals(path: Path) -> list[list[RecordedGoal]]:
    """Read ``goals.csv`` and return the goals of each trial without a ghost near the path.

    Raises ValueError with the line of a damaged row, OSError if the file cannot be read.
    """
    rows: list[RecordedGoal] = []
    with path.open(newline="") as file:
        for line, row in enumerate(csv.DictReader(file), 2):
            with located(f"{path}, line {line}", ValueError, (ValueError, KeyError, TypeError)):
                if row["ghost"] in _GHOSTS_FAR:
                    rows.append(_recorded(row))
    return [list(goals) for _, goals in itertools.groupby(rows, key=lambda goal: goal.trial)]


def _recorded(row: dict[str, str]) -> RecordedGoal:
    def numbers(*names: str) -> Any:
        return tuple(float(row[name]) for name in names)

    sent_s, canceled_s, ended_s, driven_m, stop_m, bearing = numbers(
        *("sent_s", "canceled_s", "ended_s", "driven_m", "stop_m", "bearing")
    )
    driven = DrivenGoal(row["status"] == "succeeded", ended_s - sent_s, driven_m, stop_m)
    start, velocity = numbers("start_x", "start_y", "start_yaw"), numbers("start_v", "start_w")
    preempts = int(row["preempts"]) >= 0
    return RecordedGoal(row["trial"], numbers("x", "y"), start, velocity, sent_s, canceled_s, bearing, preempts, driven)


def drive(robot: SimulatedRobot, goals: Sequence[RecordedGoal]) -> list[DrivenGoal]:
    """Let the simulated Nav2 drive the goals of a trial; raises ValueError if the robot does not fit at the start."""
    first, last = goals[0], goals[-1]
    place(robot, first.start, first.velocity)
    began_s, results, slots = robot.time_s - first.sent_s, [DrivenGoal() for _ in goals], dict[int, int]()
    sent: list[tuple[float, float]] = []  # time and way driven until each goal was sent
    driven_m, canceled_m, at = 0.0, math.nan, robot.pose
    while (now_s := robot.time_s - began_s) < first.sent_s + _LIMIT_S:
        if len(sent) < len(goals) and now_s >= goals[len(sent)].sent_s - 1e-6:
            slots[robot.set_goal(*goals[len(sent)].goal)] = len(sent)
            sent.append((now_s, driven_m))
        if math.isnan(canceled_m) and now_s >= last.canceled_s:
            robot.cancel()
            canceled_m = driven_m
        status, slot = robot.step()
        driven_m += math.dist(at[:2], robot.pose[:2])
        at, (v, omega) = robot.pose, robot.velocity
        if status != navigator.NO_RESULT:
            number = slots[slot]
            sent_s, sent_m = sent[number]
            results[number] = DrivenGoal(
                status == navigator.SUCCEEDED, robot.time_s - began_s - sent_s, driven_m - sent_m
            )
            if number == len(goals) - 1:
                break
        if abs(v) < REST_MPS and abs(omega) < REST_RADPS and not math.isnan(canceled_m):
            results[-1].stop_m = driven_m - canceled_m
            break
    return results


Pair = tuple[RecordedGoal, DrivenGoal]


def _directions(least: float, most: float) -> Callable[[RecordedGoal], bool]:
    return lambda goal: least <= abs(goal.bearing) < most


def _all(goal: RecordedGoal) -> bool:
    return True


#: Compared quantities: the goals that count, and the field of ``DrivenGoal``.
_MEASURES: dict[str, tuple[Callable[[RecordedGoal], bool], str]] = {
    "travel time, s": (_all, "ended_s"),
    "travel time, goals ahead, s": (_directions(0.0, AHEAD), "ended_s"),
    "travel time, goals beside, s": (_directions(AHEAD, BEHIND), "ended_s"),
    "travel time, goals behind, s": (_directions(BEHIND, math.inf), "ended_s"),
    "travel time, goals that pre-empt another, s": (lambda goal: goal.preempts, "ended_s"),
    "path length, m": (_all, "driven_m"),
    "mean speed, m/s": (_all, "speed_mps"),
    "way from a cancel to the standstill, m": (_all, "stop_m"),
}


def compare(folder: Path, config: Config, maps: Path | None = None) -> tuple[str, list[Pair]]:
    """Return the name of the map and the recorded and simulated goals of a folder.

    Maps that are not shipped are ``NAME/map.yaml`` in the folder ``maps``.
    """
    with located(folder / "card.yaml", ValueError, (KeyError, ConfigError)):
        card = read_yaml(folder / "card.yaml")
        own = (maps or folder) / card["map"] / "map.yaml"
        occupancy = load_map(str(own) if own.is_file() else card["map"])
    robot = SimulatedRobot(occupancy, config)
    trials = read_goals(folder / "goals.csv")
    pairs = [pair for goals in trials for pair in zip(goals, drive(robot, goals), strict=True)]
    return occupancy.name, pairs


def table(folders: Sequence[Path], config: Config, maps: Path | None = None) -> str:
    """Return a table of recorded and simulated quantities in each folder.

    It has their medians and 90 % ranges, the median of simulated minus recorded over the goals, and the distance of the
    two distributions.
    """
    names = "map", "quantity", "goals", "recorded", "simulated", "difference by goal", "KS distance"
    lines = [f"| {' | '.join(names)} |", "|" + "---|" * len(names)]
    for folder in folders:
        name, pairs = compare(folder, config, maps)
        lines += [f"| {name} | {line} |" for line in _rows(pairs)]
    return "\n".join(lines)


def _rows(pairs: Sequence[Pair]) -> Iterator[str]:
    both = [pair for pair in pairs if pair[0].driven.succeeded and pair[1].succeeded]
    for name, (counts, field) in _MEASURES.items():
        chosen = pairs if field == "stop_m" else both
        values = np.array([(getattr(goal.driven, field), getattr(d, field)) for goal, d in chosen if counts(goal)])
        values = values.reshape(-1, 2)
        values = values[np.isfinite(values).all(axis=1)]
        if len(values):
            low, middle, high = np.quantile(values, (0.05, 0.5, 0.95), axis=0)
            shown = [f"{m:.2f} [{a:.2f}, {b:.2f}]" for a, m, b in zip(low, middle, high, strict=True)]
            difference = f"{np.median(values[:, 1] - values[:, 0]):+.2f}"
            yield " | ".join([name, str(len(values)), *shown, difference, f"{_ks_distance(*values.T):.2f}"])
    ratios = np.array([driven.ended_s / goal.driven.ended_s for goal, driven in both])
    close = f"{np.mean(np.abs(ratios - 1.0) <= _CLOSE):.0%}" if both else ""
    yield f"goals within {_CLOSE:.0%} of the recorded time | {len(both)} | | {close} | |"


def _ks_distance(one: Any, other: Any) -> float:
    """Return the Kolmogorov-Smirnov distance of two samples: the greatest difference of their distributions."""
    at = np.concatenate([one, other])
    shares = [np.searchsorted(np.sort(sample), at, side="right") / len(sample) for sample in (one, other)]
    return float(np.abs(shares[0] - shares[1]).max())
