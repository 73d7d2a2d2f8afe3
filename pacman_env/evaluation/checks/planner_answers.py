"""Compare simulated paths with recorded paths of another planner: ``pacman-env validation --planner-answers``.

A file of answers is JSON. ``planner`` is the planner's name, ``settings`` are the fields of our configuration for its
costmap, by dotted name, and ``maps`` contains a list of answers for each map: ``start``, ``goal`` and ``path`` (null:
no path), all as (x, y) in m.
"""

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config, make_config
from pacman_env.world.maps.occupancy import load_map
from pacman_env.world.navigation.grid import DriveGrid, build_grid
from pacman_env.world.navigation.paths import AT_GOAL, NO_STEP, PathFields

Points = NDArray[np.float64]  # (N, 2) m
_STEP_M = 0.02  # distance of the points at which paths are compared
_SHORT_M = 0.5  # lengths below this are not compared
_ANOTHER_WAY_M = 0.5  # paths farther apart pass an obstacle on different sides


def our_path(grid: DriveGrid, fields: PathFields, start: Points, goal: Points, tolerance_m: float) -> Points | None:
    """Return the path of the simulated Nav2 without ghosts, through the centres of cells; None if there is no path."""
    column, row = grid.to_cell(*start)
    cell, end = int(grid.snap[row, column]), goal
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


def length_m(path: Points) -> float:
    return float(np.hypot(*np.diff(path, axis=0).T).sum())


def resampled(path: Points, step_m: float = _STEP_M) -> Points:
    """Return points along the path at most ``step_m`` apart, both ends included."""
    along = np.append(0.0, np.hypot(*np.diff(path, axis=0).T).cumsum())
    at = np.linspace(0.0, along[-1], max(2, math.ceil(along[-1] / step_m) + 1))
    return np.stack([np.interp(at, along, path[:, k]) for k in (0, 1)], axis=1)


def distances_m(points: Points, path: Points) -> NDArray[np.float64]:
    """Return the distance (N,) of each point to the polyline."""
    first, along = path[:-1], np.diff(path, axis=0)
    off = points[:, None] - first
    share = np.clip((off * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-12), 0.0, 1.0)
    return np.asarray(np.hypot(*np.moveaxis(off - share[..., None] * along, 2, 0)).min(axis=1))


def clearances_m(grid: DriveGrid, path: Points) -> NDArray[np.float64]:
    """Return the distances (N,) to the nearest solid cell along a path, interpolated between the centres of cells."""
    points, a = resampled(path), grid.affine
    rows, columns = grid.shape
    u = np.clip(a[0] * points[:, 0] + a[1] * points[:, 1] + a[2] - 0.5, 0.0, columns - 1.001)
    v = np.clip(a[3] * points[:, 0] + a[4] * points[:, 1] + a[5] - 0.5, 0.0, rows - 1.001)
    left, low = u.astype(int), v.astype(int)
    du, dv, c = u - left, v - low, grid.clearance.astype(np.float64)
    lower = c[low, left] * (1 - du) + c[low, left + 1] * du
    upper = c[low + 1, left] * (1 - du) + c[low + 1, left + 1] * du
    return np.asarray(lower * (1 - dv) + upper * dv)


@dataclass(frozen=True)
class Pair:
    """Paths of the simulated Nav2 and of the other planner; None: no path."""

    ours: Points | None
    theirs: Points | None

    def apart_m(self) -> NDArray[np.float64]:
        """Return the distances between the paths, from each path to the other."""
        assert self.ours is not None
        assert self.theirs is not None
        distances = distances_m(resampled(self.ours), self.theirs), distances_m(resampled(self.theirs), self.ours)
        return np.concatenate(distances)


def pairs_of(grid: DriveGrid, answers: list[dict[str, Any]], tolerance_m: float) -> list[Pair]:
    fields, pairs = grid.path_fields(), []
    for answer in answers:
        ours = our_path(grid, fields, np.array(answer["start"]), np.array(answer["goal"]), tolerance_m)
        pairs.append(Pair(ours, np.array(answer["path"]) if answer["path"] else None))
    return pairs


def figures(grid: DriveGrid, pairs: list[Pair]) -> dict[str, float]:
    """Return counts, shares, ratios and distances (m) over all pairs on one map."""
    both = [(p, p.ours, p.theirs) for p in pairs if p.ours is not None and p.theirs is not None]
    lengths = np.array([(length_m(ours), length_m(theirs)) for _, ours, theirs in both])
    ratio = np.divide(*lengths[lengths.min(axis=1) > _SHORT_M].T)
    apart = [pair.apart_m() for pair, _, _ in both]
    least = np.array([[clearances_m(grid, path).min() for path in paths] for _, *paths in both])
    ends = [float(np.hypot(*(ours[-1] - theirs[-1]))) for _, ours, theirs in both]
    return {
        "pairs": len(pairs),
        "only_ours": sum(p.ours is not None and p.theirs is None for p in pairs),
        "only_theirs": sum(p.ours is None and p.theirs is not None for p in pairs),
        "length_ratio": float(np.median(ratio)),
        "length_ratio_5": float(np.percentile(ratio, 5)),
        "length_ratio_95": float(np.percentile(ratio, 95)),
        "apart_m": float(np.mean([distances.mean() for distances in apart])),
        "apart_95_m": float(np.percentile(np.concatenate(apart), 95)),
        "another_way": float(np.mean([distances.max() > _ANOTHER_WAY_M for distances in apart])),
        "clearance_m": float(least[:, 0].mean()),
        "clearance_theirs_m": float(least[:, 1].mean()),
        "ends_apart_m": max(ends),
    }


def read_answers(path: Path) -> tuple[str, Config, dict[str, list[dict[str, Any]]]]:
    """Return the planner's name, the configuration, and the answers for each map; raises ValueError for a bad file."""
    try:
        data = json.loads(path.read_text())
        return str(data["planner"]), make_config("robot_0_15", **data["settings"]), dict(data["maps"])
    except (KeyError, TypeError, json.JSONDecodeError) as error:
        raise ValueError(f"{path}: not a file of a planner's answers: {error!r}") from error


def compare(path: Path) -> dict[str, dict[str, float]]:
    """Return :func:`figures` for each map of a file of answers."""
    _, config, maps = read_answers(path)
    result = {}
    for name, answers in maps.items():
        grid = build_grid(load_map(name), config.robot, config.nav2, config.pellets)
        result[name] = figures(grid, pairs_of(grid, answers, config.nav2.unreachable_tolerance_m))
    return result


def table(path: Path) -> str:
    planner = read_answers(path)[0]
    lines = [
        f"| ours beside {planner} on | pairs | path only ours, only theirs | length, ours / theirs | apart, m | 95 %"
    ]
    lines[0] += " | another way, % | least clearance, ours and theirs, m |"
    lines.append("|---|---|---|---|---|---|---|---|")
    for name, f in compare(path).items():
        ratio = f"{f['length_ratio']:.3f} [{f['length_ratio_5']:.3f}, {f['length_ratio_95']:.3f}]"
        lines.append(
            f"| {name} | {f['pairs']} | {f['only_ours']}, {f['only_theirs']} | {ratio} | {f['apart_m']:.3f}"
            f" | {f['apart_95_m']:.3f} | {100 * f['another_way']:.1f}"
            f" | {f['clearance_m']:.3f}, {f['clearance_theirs_m']:.3f} |"
        )
    return "\n".join(lines)
