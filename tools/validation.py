"""Compare the simulator with the ten real trials and measure the effect of each cause: ``python -m tools.validation``.

The reference is the original game; every other row changes a single cause in the same rounds. Other options compare
paths of the simulated Nav2 with recorded paths, or let it drive recorded goals, except those with a ghost nearby.
"""

import argparse
import csv
import json
import math
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.command_line.command import Parser, count, run_command
from pacman_env.command_line.game_options import add_game_option
from pacman_env.command_line.slam_maps import map_sources
from pacman_env.config import Config, located, make_config, parse_settings
from pacman_env.config.yaml_files import read_yaml
from pacman_env.episodes.rollout import episode_seeds, play
from pacman_env.episodes.statistics import paired_difference, wilson
from pacman_env.game.ends import COMPLETE
from pacman_env.levels.assets import map_assets
from pacman_env.sim.robot_simulation import SimulatedRobot, place
from pacman_env.world.maps.occupancy import load_map, shipped_maps
from pacman_env.world.navigation import navigator
from pacman_env.world.navigation.grid import DriveGrid, build_grid
from pacman_env.world.navigation.paths import AT_GOAL, NO_STEP, PathFields
from tools.common import table

_ORIGINAL = "clyde.spawn=anywhere clyde.spawn_distance_m=0 nav2.inflation_radius_m=0.22 nav2.inflation_scale=2"
_OUR_SPAWN = "clyde.spawn=connected clyde.spawn_distance_m=1.5"
_PREEMPT = "execution.on_abort=back_off execution.switch=preempt"
_AMCL = "localization.sigma_xy_m=0.135 localization.sigma_yaw_rad=0.07 localization.error_kept=0.97"
_TURNS = "mppi.turn_radps=1.9 mppi.turn_response=20 mppi.standing_turn_radps=1.9"
#: Cause, what differs, settings, policy if it is not clyde_aware; the first row is the reference.
VARIANTS: tuple[tuple[str, ...], ...] = (
    ("reference", "the original as it was", ""),
    ("selector", "milestone's form of the scorer", "", "clyde_aware:documented"),
    ("selector", "nearest pellet", "", "nearest"),
    ("selector", "random pellet", "", "random_pellet"),
    ("belief", "fresh pose from TF, with AMCL's error", "execution.pose_source=tf"),
    ("belief", "perfect localization", "localization.perfect=true"),
    ("belief", "AMCL's error as its own filter has it in this house", _AMCL),
    ("belief", "rules tested 20 times a second", "execution.check_period_s=0.05"),
    ("executor", "pre-empt instead of cancel-then-send, back-off", _PREEMPT),
    ("executor", "Nav2 plans at 2 Hz, takes goals at once", "nav2.planner_period_s=0.5 nav2.accept_delay_s=0"),
    ("navigator", "turns and starts as fast as the base", "nav2.controller=pure_pursuit"),
    ("navigator", "turns as fast as the base", _TURNS),
    ("navigator", "reaches its speed at once", "mppi.speed_response=20"),
    ("navigator", "drives as fast in turns", "mppi.standing_turn_radps=100"),
    ("navigator", "costmaps of config/nav2.yaml", "nav2.inflation_radius_m=0.35 nav2.inflation_scale=4"),
    ("navigator", "as until 0.19.0, with 0.256 m/s", "nav2.controller=pure_pursuit robot.speed_mps=0.256"),
    ("speed", "robot at 0.306 m/s", "robot.speed_mps=0.306"),
    ("speed", "robot at 0.20 m/s", "robot.speed_mps=0.20"),
    ("speed", "Clyde at 0.35 m/s", "clyde.speed_mps=0.35"),
    ("spawn", "Clyde connected to the robot's area", "clyde.spawn=connected"),
    ("spawn", "connected and at least 1.5 m away (our default)", _OUR_SPAWN),
    ("all of ours", "robust executor, default spawn", f"{_PREEMPT} execution.pose_source=tf {_OUR_SPAWN}"),
)
Points = NDArray[np.float64]  # (N, 2) m
_LIMIT_M = 0.5  # shorter paths are not compared by length; paths farther apart pass an obstacle on different sides
_COLUMNS = ("x", "y", "start_x", "start_y", "start_yaw", "start_v", "start_w", "sent_s", "canceled_s", "ended_s")
Goal = dict[str, float]  # the columns of a recorded goal; its end is NaN if it did not succeed
Driven = tuple[float, float]  # time, s, and path length, m, until a goal succeeded; NaN if it did not


def our_path(grid: DriveGrid, fields: PathFields, start: Points, goal: Points, tolerance_m: float) -> Points | None:
    """Return the path of the simulated Nav2 without ghosts, through the centres of cells; None if there is no path."""
    cell, end = int(grid.snap[grid.to_cell(*start)[::-1]]), goal
    last = int(grid.cells_under(goal[None])[0])
    if last < 0:
        last = grid.nearest_cell(float(goal[0]), float(goal[1]), tolerance_m)
        end = np.array(grid.to_world(*grid.cell[last]))
    next_step = fields.to(last)[1] if last >= 0 else None
    if next_step is None or next_step[cell] == NO_STEP:
        return None
    cells = [cell]
    while next_step[cell] != AT_GOAL:
        cell += int(next_step[cell])
        cells.append(cell)
    return np.concatenate([np.stack(grid.to_world(*grid.cell[cells].T), axis=1), end[None]])


def apart_m(one: Points, other: Points) -> NDArray[np.float64]:
    """Return the distance to ``other`` of points along ``one``, at most 0.02 m apart."""
    along = np.append(0.0, np.hypot(*np.diff(one, axis=0).T).cumsum())
    at = np.linspace(0.0, along[-1], max(2, int(along[-1] / 0.02) + 2))
    points = np.stack([np.interp(at, along, one[:, k]) for k in (0, 1)], axis=1)
    off, line = points[:, None] - other[:-1], np.diff(other, axis=0)
    share = np.clip((off * line).sum(axis=2) / np.maximum((line**2).sum(axis=1), 1e-12), 0.0, 1.0)
    return np.asarray(np.hypot(*np.moveaxis(off - share[..., None] * line, 2, 0)).min(axis=1))


def compare_paths(file: Path) -> dict[str, dict[str, float]]:
    """Return counts, shares, ratios of lengths and distances for each map of a file of a planner's answers."""
    with located(file, ValueError, (KeyError, TypeError, json.JSONDecodeError)):
        data = json.loads(file.read_text())
        config, maps, result = make_config("robot_0_15", **data["settings"]), dict(data["maps"]), {}
    for name, answers in maps.items():
        grid = build_grid(load_map(name), config.robot, config.nav2, config.pellets)
        fields, tolerance_m, both, alone = grid.path_fields(), config.nav2.unreachable_tolerance_m, [], [0, 0]
        for answer in answers:
            ours = our_path(grid, fields, np.array(answer["start"]), np.array(answer["goal"]), tolerance_m)
            if ours is not None and answer["path"]:
                both.append((ours, np.array(answer["path"])))
            elif ours is not None or answer["path"]:
                alone[ours is None] += 1
        lengths = np.array([[np.hypot(*np.diff(path, axis=0).T).sum() for path in paths] for paths in both])
        apart = [np.concatenate([apart_m(ours, theirs), apart_m(theirs, ours)]) for ours, theirs in both]
        result[name] = {
            "pairs": len(answers),
            "only ours": alone[0],
            "only theirs": alone[1],
            "length, ours / theirs": float(np.median(np.divide(*lengths[lengths.min(axis=1) > _LIMIT_M].T))),
            "apart, m": float(np.mean([one.mean() for one in apart])),
            "another way, share": float(np.mean([one.max() > _LIMIT_M for one in apart])),
        }
    return result


def read_goals(file: Path) -> list[list[Goal]]:
    """Return the goals of each trial without a ghost near the path; raises ValueError with the line of a bad row."""
    trials: dict[str, list[Goal]] = {}
    with file.open(newline="") as lines:
        for line, row in enumerate(csv.DictReader(lines), 2):
            with located(f"{file}, line {line}", ValueError, (ValueError, KeyError, TypeError)):
                goal = {name: float(row[name]) for name in (*_COLUMNS, "driven_m", "preempts")}
                if row["status"] != "succeeded":
                    goal["ended_s"] = goal["driven_m"] = math.nan
                if row["ghost"] in ("none", "far"):
                    trials.setdefault(row["trial"], []).append(goal)
    return list(trials.values())


def drive(robot: SimulatedRobot, goals: Sequence[Goal]) -> list[Driven]:
    """Let the simulated Nav2 drive the goals of a trial; raises ValueError if the robot does not fit at the start."""
    first, canceled_s = goals[0], goals[-1]["canceled_s"]
    place(robot, (first["start_x"], first["start_y"], first["start_yaw"]), (first["start_v"], first["start_w"]))
    began_s, driven_m, at, canceled = robot.time_s - first["sent_s"], 0.0, robot.pose, False
    sent, slots = list[Driven](), dict[int, int]()  # when and after which way each goal was sent; its number by slot
    results = [(math.nan, math.nan)] * len(goals)
    while (now_s := robot.time_s - began_s) < first["sent_s"] + 90.0:
        if len(sent) < len(goals) and now_s >= goals[len(sent)]["sent_s"] - 1e-6:
            slots[robot.set_goal(goals[len(sent)]["x"], goals[len(sent)]["y"])] = len(sent)
            sent.append((now_s, driven_m))
        if not canceled and (canceled := now_s >= canceled_s):
            robot.cancel()
        status, slot = robot.step()
        driven_m += math.dist(at[:2], robot.pose[:2])
        at, (v, omega) = robot.pose, robot.velocity
        if status == navigator.SUCCEEDED:
            results[slots[slot]] = robot.time_s - began_s - sent[slots[slot]][0], driven_m - sent[slots[slot]][1]
        last = status != navigator.NO_RESULT and slots[slot] == len(goals) - 1
        if last or (canceled and abs(v) < 0.01 and abs(omega) < 0.02):
            break
    return results


def recorded_goals(folder: Path, config: Config) -> tuple[str, list[tuple[Goal, Driven]]]:
    """Return the map's name and goals with what was simulated; the map is shipped or fetched."""
    name = read_yaml(folder / "card.yaml")["map"]
    occupancy = load_map(map_sources([name if name in shipped_maps() else f"slam:{name}"])[0])
    robot, trials = SimulatedRobot(occupancy, config), read_goals(folder / "goals.csv")
    return occupancy.name, [pair for goals in trials for pair in zip(goals, drive(robot, goals), strict=True)]


def goal_rows(pairs: Sequence[tuple[Goal, Driven]]) -> list[list[str]]:
    """Return medians with 90 % ranges, the median difference by goal, and the distance of the distributions."""
    driven = np.array([(goal["ended_s"] - goal["sent_s"], *d[:1], goal["driven_m"], *d[1:]) for goal, d in pairs])
    done, preempts = np.isfinite(driven).all(axis=1), np.array([goal["preempts"] >= 0 for goal, _ in pairs])
    rows = []
    for name, both in (
        ("travel time, s", driven[done, :2]),
        ("travel time, goals that pre-empt another, s", driven[done & preempts, :2]),
        ("path length, m", driven[done, 2:]),
    ):
        low, middle, high = np.quantile(both, (0.05, 0.5, 0.95), axis=0)
        shown = [f"{m:.2f} [{a:.2f}, {b:.2f}]" for a, m, b in zip(low, middle, high, strict=True)]
        shares = [np.searchsorted(np.sort(side), both.ravel(), side="right") / len(both) for side in both.T]
        difference, distance = np.median(both[:, 1] - both[:, 0]), np.abs(shares[0] - shares[1]).max()
        rows.append([name, str(len(both)), *shown, f"{difference:+.2f}", f"{distance:.2f}"])
    close = np.mean(np.abs(driven[done, 1] / driven[done, 0] - 1.0) <= 0.15)
    return [*rows, ["goals within 15% of the recorded time", str(done.sum()), "", f"{close:.0%}", "", ""]]


def causes(source: str, episodes: int, workers: int) -> str:
    """Return the table of all variants, below a row of the ten real trials."""
    apply: Any = map if workers == 1 else ProcessPoolExecutor(workers, get_context("spawn")).map
    played = list(apply(partial(_play, source, episode_seeds(0, episodes)), VARIANTS))
    lines = [["real robot", "ten trials", _share(3, 10), _share(6, 10), "", ""]]
    for (cause, name, *_), records in zip(VARIANTS, played, strict=True):
        won, reference = (one["end"] == COMPLETE for one in (records, played[0]))
        shares = [_share(which.sum(), episodes) for which in (won, records["collected"] >= records["spawned"] - 1)]
        difference, (low, high) = paired_difference(won, reference)
        shown = "" if records is played[0] else f"{100 * difference:+.1f} [{100 * low:+.1f}, {100 * high:+.1f}]"
        lines.append([cause, name, *shares, f"{records['collected'].mean():.2f}", shown])
    return table(("cause", "what differs", "complete, %", "all but one, %", "pellets", "difference, points"), lines)


def _play(source: str, seeds: NDArray[np.uint64], variant: tuple[str, ...]) -> Any:
    _, _, settings, policy = (*variant, "clyde_aware")[:4]
    config = make_config("robot", "as_built", **parse_settings([*_ORIGINAL.split(), *settings.split()]))
    return play(map_assets(source, config), config, policy, seeds)[0]


def _share(number: int, rounds: int) -> str:
    return "{:.1f} [{:.1f}, {:.1f}]".format(*(100 * share for share in (number / rounds, *wilson(int(number), rounds))))


def main(argv: Sequence[str] | None = None) -> int:
    parser = Parser(prog="python -m tools.validation", description=__doc__)
    add = parser.add_argument
    add_game_option(parser, "--map", help="name or YAML file; the trials used slam:pacmanbot_house")
    add("--episodes", type=count(), default=1000, help="number of rounds per row (%(default)s)")
    add("--workers", type=count(), default=1, help="processes (%(default)s)")
    add("--planner-answers", type=Path, help="only compare paths with the paths in this file")
    add("--recorded-goals", type=Path, nargs="+", metavar="FOLDER", help="only compare driving with these recordings")
    add("--set", action="append", default=[], metavar="NAME=VALUE", help="setting of --recorded-goals")
    return run_command(parser, argv, _report)


def _report(options: argparse.Namespace) -> None:
    if options.planner_answers:
        found = compare_paths(options.planner_answers)
        lines = [[name, *(f"{value:.3g}" for value in figures.values())] for name, figures in found.items()]
        text = table(("map", *next(iter(found.values()))), lines)
    elif options.recorded_goals:
        config = make_config(**parse_settings(options.set))
        compared = [recorded_goals(folder, config) for folder in options.recorded_goals]
        heads = "map", "quantity", "goals", "recorded", "simulated", "difference by goal", "KS distance"
        text = table(heads, [[name, *row] for name, pairs in compared for row in goal_rows(pairs)])
    else:
        text = causes(options.map, options.episodes, options.workers)
    print(text, end="")


if __name__ == "__main__":
    sys.exit(main())
