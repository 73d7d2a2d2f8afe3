"""Compute float32 features and bearings for networks, and their scales.

Directions are in the robot's frame. Lengths are in m, capped at ``FAR_M``.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..engine.arrays import Array, Table, arrays_by_address
from ..engine.jit import kernel, table_kernel
from ..engine.native import address_of
from ..engine.pipeline import Stage
from ..levels.level import level_arrays
from ..world.navigation.grid import cell_of
from ..world.navigation.paths import AT_GOAL, NO_STEP
from .learner_layout import MISSING, NearestCounts, nearest_candidates
from .situation import AWAY_S, FRIGHTENED_S, HOLD, PELLET, REFUGE, Situation, maps_of, situation_arrays

FAR_M = 100.0  # cap of all lengths
FAST_MPS = 5.0  # cap of all speeds
OLD_S = 100.0  # cap of the age of a pose

Columns = tuple[tuple[str, float, float, str], ...]
#: name, low, high and unit of each column of the observation's arrays; infinite bounds are replaced by bounds from map
#: and configuration (``kinds.py``).
ROBOT_COLUMNS = (
    ("x", -np.inf, np.inf, "m, map frame"),
    ("y", -np.inf, np.inf, "m, map frame"),
    ("cos_heading", -1.0, 1.0, ""),
    ("sin_heading", -1.0, 1.0, ""),
    ("v", -FAST_MPS, FAST_MPS, "m/s"),
    ("omega", -10.0, 10.0, "rad/s"),
    ("pose_age", 0.0, OLD_S, "s since the believed pose was measured"),
)
CLYDE_COLUMNS = (
    ("forward", -FAR_M, FAR_M, "m, robot frame"),
    ("left", -FAR_M, FAR_M, "m, robot frame"),
    ("velocity_forward", -FAST_MPS, FAST_MPS, "m/s, robot frame"),
    ("velocity_left", -FAST_MPS, FAST_MPS, "m/s, robot frame"),
    ("distance", 0.0, FAR_M, "m, straight"),
    ("closing_speed", -FAST_MPS, FAST_MPS, "m/s"),
    ("speed", 0.0, FAST_MPS, "m/s, in this round"),
)
GHOST_COLUMNS = tuple(column for column in CLYDE_COLUMNS if column[0] != "closing_speed")
CANDIDATE_COLUMNS = (
    ("is_pellet", 0.0, 1.0, ""),
    ("is_refuge", 0.0, 1.0, ""),
    ("is_hold", 0.0, 1.0, ""),
    ("is_current", 0.0, 1.0, "the goal pursued now"),
    ("forward", -FAR_M, FAR_M, "m, robot frame"),
    ("left", -FAR_M, FAR_M, "m, robot frame"),
    ("distance", 0.0, FAR_M, "m, straight, from the robot"),
    ("path_robot", 0.0, FAR_M, "m, path length from the robot"),
    ("clyde_distance", 0.0, FAR_M, "m, straight, from Clyde"),
    ("path_clyde", 0.0, FAR_M, "m, path length from Clyde"),
)
ROUND_COLUMNS = (
    ("time", 0.0, np.inf, "s since the round began"),
    ("pellets_left", 0.0, np.inf, "on the map, those that may not be chosen now included"),
)
COLUMNS: dict[str, Columns] = {
    "robot": ROBOT_COLUMNS,
    "clyde": CLYDE_COLUMNS,
    "candidates": CANDIDATE_COLUMNS,
    "round": ROUND_COLUMNS,
    "ghosts": GHOST_COLUMNS,
}
Observation = dict[str, NDArray[Any]]


class FeatureArrays(NamedTuple):
    robot: Any = Array(np.float32, f"N {len(ROBOT_COLUMNS)}")
    clyde: Any = Array(np.float32, f"N {len(CLYDE_COLUMNS)}")
    candidates: Any = Array(np.float32, f"N C {len(CANDIDATE_COLUMNS)}")
    round: Any = Array(np.float32, f"N {len(ROUND_COLUMNS)}")
    ghosts: Any = Array(np.float32, f"N G {len(GHOST_COLUMNS)}")


class _RobotArrays(NamedTuple):
    situation: Any = Array(np.int64, "n")  # table of the situations
    seen: Any = FeatureArrays


_fill_arrays = arrays_by_address(_RobotArrays)


def features_stage(situation: Situation, arrays: Observation) -> Stage:
    """Return the stage that fills the arrays of ``FeatureArrays``; with one ghost, the array ``ghosts`` may be missing.

    Rows of forbidden candidates only contain the kind; their other columns are 0.
    """
    ghosts = arrays.get("ghosts")
    if ghosts is None:
        ghosts = np.zeros((*situation.ghosts.shape[:2], len(GHOST_COLUMNS)), dtype=np.float32)
    seen = FeatureArrays(**{name: arrays[name] for name in FeatureArrays._fields if name != "ghosts"}, ghosts=ghosts)
    return write_features, [Table(_RobotArrays, situation=situation.table.numbers, seen=seen)]


@kernel
def _cap(value, limit):  # type: ignore[no-untyped-def]
    """Clip a value to [-limit, limit]."""
    return min(max(value, -limit), limit)


@kernel
def in_robot_frame(dx, dy, cos, sin, limit):  # type: ignore[no-untyped-def]
    """Return a map vector's components forward and left of a robot with this heading, clipped to +-``limit``."""
    return _cap(dx * cos + dy * sin, limit), _cap(dy * cos - dx * sin, limit)


@table_kernel
def write_features(table, first, last):  # type: ignore[no-untyped-def]
    """Write the ``FeatureArrays`` in ``_RobotArrays`` for the situations ``first`` to ``last - 1``; return 0."""
    a = _fill_arrays(table)
    f, s = a.seen, situation_arrays(address_of(a.situation))
    robot, clyde, candidates, ghosts = f.robot, f.clyde, f.candidates, f.ghosts
    for i in range(first, last):
        x, y = s.robot[i, 0], s.robot[i, 1]
        ch, sh = math.cos(s.robot[i, 2]), math.sin(s.robot[i, 2])
        robot[i, 0], robot[i, 1], robot[i, 2], robot[i, 3] = x, y, ch, sh
        robot[i, 4] = _cap(s.robot_velocity[i, 0], FAST_MPS)
        robot[i, 5] = _cap(s.robot_velocity[i, 1], 10.0)
        robot[i, 6] = min(s.pose_age_s[i], OLD_S)
        cx, cy = s.clyde[i, 0], s.clyde[i, 1]
        dx, dy = cx - x, cy - y
        vx, vy = s.clyde_velocity[i, 0], s.clyde_velocity[i, 1]
        clyde[i, 0], clyde[i, 1] = in_robot_frame(dx, dy, ch, sh, FAR_M)
        clyde[i, 2], clyde[i, 3] = in_robot_frame(vx, vy, ch, sh, FAST_MPS)
        clyde[i, 4] = min(math.sqrt(dx * dx + dy * dy), FAR_M)
        clyde[i, 5] = _cap(s.closing_speed[i], FAST_MPS)
        clyde[i, 6] = min(s.clyde_speed[i], FAST_MPS)
        for c in range(s.mask.shape[1]):
            allowed = s.mask[i, c]
            k = s.kind[i, c]
            candidates[i, c, 0] = k == PELLET
            candidates[i, c, 1] = k == REFUGE
            candidates[i, c, 2] = k == HOLD
            if not allowed:
                for column in range(3, 10):
                    candidates[i, c, column] = 0.0
                continue
            candidates[i, c, 3] = c == s.current[i]
            px, py = s.position[i, c, 0], s.position[i, c, 1]
            dx, dy = px - x, py - y
            candidates[i, c, 4], candidates[i, c, 5] = in_robot_frame(dx, dy, ch, sh, FAR_M)
            candidates[i, c, 6] = min(math.sqrt(dx * dx + dy * dy), FAR_M)
            candidates[i, c, 7] = min(s.path_robot[i, c], FAR_M)
            dx, dy = px - cx, py - cy
            candidates[i, c, 8] = min(math.sqrt(dx * dx + dy * dy), FAR_M)
            candidates[i, c, 9] = min(s.path_clyde[i, c], FAR_M)
        f.round[i, 0] = s.time_s[i]
        f.round[i, 1] = s.pellets_left[i]
        for k in range(s.ghosts.shape[1]):
            dx, dy = s.ghosts[i, k, 0] - x, s.ghosts[i, k, 1] - y
            vx, vy = s.ghosts[i, k, 2], s.ghosts[i, k, 3]
            ghosts[i, k, 0], ghosts[i, k, 1] = in_robot_frame(dx, dy, ch, sh, FAR_M)
            ghosts[i, k, 2], ghosts[i, k, 3] = in_robot_frame(vx, vy, ch, sh, FAST_MPS)
            ghosts[i, k, 4] = min(math.sqrt(dx * dx + dy * dy), FAR_M)
            ghosts[i, k, 5] = min(s.ghosts[i, k, 4], FAST_MPS)
    return 0


CANDIDATE_POWER_COLUMNS: Columns = (("is_power", 0.0, 1.0, ""),)
GHOST_POWER_COLUMNS: Columns = (
    ("is_frightened", 0.0, 1.0, ""),
    ("frightened", 0.0, OLD_S, "s, until it is not frightened any more"),
    ("is_away", 0.0, 1.0, "1, after it was caught"),
    ("away", 0.0, OLD_S, "s, until it starts again"),
)


class PowerArrays(NamedTuple):
    fright: Any = Array(np.float64, "N G 3")
    is_power: Any = Array(np.bool_, "N C")
    mask: Any = Array(np.bool_, "N C")
    candidate_power: Any = Array(np.float32, f"N C {len(CANDIDATE_POWER_COLUMNS)}")
    ghost_power: Any = Array(np.float32, f"N G {len(GHOST_POWER_COLUMNS)}")


_power_arrays = arrays_by_address(PowerArrays)


def power_stage(situation: Situation, arrays: Observation) -> Stage:
    """Return the stage that fills ``candidate_power`` and ``ghost_power``."""
    seen = {name: getattr(situation, name) for name in ("fright", "is_power", "mask")}
    filled = {name: arrays[name] for name in ("candidate_power", "ghost_power")}
    return write_power, [Table(PowerArrays, **seen, **filled)]


@table_kernel
def write_power(table, first, last):  # type: ignore[no-untyped-def]
    """Write ``candidate_power`` and ``ghost_power`` for the situations ``first`` to ``last - 1``; return 0."""
    a = _power_arrays(table)
    for i in range(first, last):
        for c in range(a.is_power.shape[1]):
            a.candidate_power[i, c, 0] = a.is_power[i, c] and a.mask[i, c]
        for k in range(a.fright.shape[1]):
            frightened_s, away_s = a.fright[i, k, FRIGHTENED_S], a.fright[i, k, AWAY_S]
            a.ghost_power[i, k, 0], a.ghost_power[i, k, 1] = frightened_s > 0.0, min(frightened_s, OLD_S)
            a.ghost_power[i, k, 2], a.ghost_power[i, k, 3] = away_s > 0.0, min(away_s, OLD_S)
    return 0


_AHEAD_CM = 50  # path length to the point that gives the direction of a path, short enough not to cut corners

PELLET_BEARING_COLUMNS = (
    ("is_pellet", 0.0, 1.0, "1, or 0: there are not so many, the row is 0"),
    ("cos_bearing", -1.0, 1.0, ""),
    ("sin_bearing", -1.0, 1.0, ""),
    ("distance", 0.0, FAR_M, "m, straight"),
    ("path_robot", 0.0, FAR_M, "m, path length from the robot"),
    ("cos_way", -1.0, 1.0, "1, to the place 0.5 m ahead on the shortest path"),
    ("sin_way", -1.0, 1.0, "1, likewise; both are 0 where there is no path"),
)
GHOST_BEARING_COLUMNS = (
    ("cos_bearing", -1.0, 1.0, ""),
    ("sin_bearing", -1.0, 1.0, ""),
    ("distance", 0.0, FAR_M, "m, straight"),
    ("velocity_forward", -FAST_MPS, FAST_MPS, "m/s, robot frame"),
    ("velocity_left", -FAST_MPS, FAST_MPS, "m/s, robot frame"),
)


def pellet_bearings(situation: Situation, count: int) -> NDArray[np.float32]:
    """Return ``PELLET_BEARING_COLUMNS`` of the nearest pellets (N, ``count``, 7). Raises ValueError without maps."""
    s, levels = situation, maps_of(situation).addresses
    result = np.zeros((len(s), count, len(PELLET_BEARING_COLUMNS)), dtype=np.float32)
    order = nearest_candidates(s, NearestCounts(count, 0))
    _fill_pellets(s.robot, s.position, s.path_robot, s.goal, s.level, order, levels, result)
    return result


def ghost_bearings(situation: Situation) -> NDArray[np.float32]:
    """Return ``GHOST_BEARING_COLUMNS`` of all ghosts, (N, G, 5) float32."""
    result = np.empty((*situation.ghosts.shape[:2], len(GHOST_BEARING_COLUMNS)), dtype=np.float32)
    _fill_ghosts(situation.robot, situation.ghosts, result)
    return result


@kernel
def _bearing(dx, dy, cos, sin):  # type: ignore[no-untyped-def]
    """Return cosine and sine of the bearing of (dx, dy), m, from a heading (cos, sin), and the distance (0: ahead)."""
    distance = math.sqrt(dx * dx + dy * dy)
    if distance < 1e-9:
        return 1.0, 0.0, 0.0
    return (dx * cos + dy * sin) / distance, (dy * cos - dx * sin) / distance, distance


@kernel
def _fill_pellets(robot, position, path, goals, level, order, levels, out):  # type: ignore[no-untyped-def]
    """Write ``out`` (N, K, 7), the bearings of the candidates ``order`` (N, K); rows of ``MISSING`` stay 0.

    The other arrays are arrays of a ``Situation``; ``levels`` are the addresses of the levels by slot.
    """
    for i in range(len(robot)):
        a = level_arrays(levels[level[i]])
        length_cm, next_step, cell_xy = a.length_cm, a.next_step, a.cell_xy
        x, y = robot[i, 0], robot[i, 1]
        cos, sin = math.cos(robot[i, 2]), math.sin(robot[i, 2])
        column, row = cell_of(a.affine, a.snap.shape[0], a.snap.shape[1], x, y)
        robot_cell = a.snap[row, column]
        for k in range(out.shape[1]):
            c = order[i, k]
            if c == MISSING:
                break
            px, py = position[i, c, 0], position[i, c, 1]
            out[i, k, 0] = 1.0
            out[i, k, 1], out[i, k, 2], distance = _bearing(px - x, py - y, cos, sin)
            out[i, k, 3] = min(distance, FAR_M)
            out[i, k, 4] = min(path[i, c], FAR_M)
            goal = goals[i, c]
            if robot_cell < 0 or next_step[goal, robot_cell] == NO_STEP:
                continue
            cell = robot_cell
            while next_step[goal, cell] != AT_GOAL and length_cm[robot_cell, goal] - length_cm[cell, goal] < _AHEAD_CM:
                cell += next_step[goal, cell]
            if next_step[goal, cell] != AT_GOAL:
                px, py = cell_xy[cell, 0], cell_xy[cell, 1]
            out[i, k, 5], out[i, k, 6], _ = _bearing(px - x, py - y, cos, sin)


@kernel
def _fill_ghosts(robot, ghosts, out):  # type: ignore[no-untyped-def]
    """Write ``out`` (N, G, 5), the bearings of the ghosts (N, G, 5) from the robots (N, 3)."""
    for i in range(len(robot)):
        cos, sin = math.cos(robot[i, 2]), math.sin(robot[i, 2])
        for k in range(ghosts.shape[1]):
            dx, dy = ghosts[i, k, 0] - robot[i, 0], ghosts[i, k, 1] - robot[i, 1]
            out[i, k, 0], out[i, k, 1], distance = _bearing(dx, dy, cos, sin)
            out[i, k, 2] = min(distance, FAR_M)
            out[i, k, 3], out[i, k, 4] = in_robot_frame(ghosts[i, k, 2], ghosts[i, k, 3], cos, sin, FAST_MPS)


LENGTH_M = 3.0
AGE_S = 3.0
COUNT = 10.0
#: c of the scale x / (|x| + c), by unit.
_SOFT = {"m": LENGTH_M, "s": AGE_S, "on the map": COUNT}
#: Divisor of x, by unit.
_LINEAR = {"": 1.0, "1": 1.0, "m/s": 1.0, "rad/s": 2.0, "the goal pursued now": 1.0}
_PLACE_M = 50.0  # divisor of map coordinates, whose origin is arbitrary
TIME = "time"  # column divided by the time limit


def unit_scale(columns: Columns, time_limit_s: float) -> NDArray[np.float32]:
    """Return two rows (2, F) of scale values for the columns: divisors, and c of x / (|x| + c) (0: linear).

    The first words of a column's unit decide. Raises KeyError for a unit without a scale.
    """
    by, soft = np.ones((2, len(columns)), dtype=np.float32)
    soft[:] = 0.0
    for k, (name, _, _, words) in enumerate(columns):
        unit = words.partition(",")[0].partition(" since")[0]
        if name == TIME:
            by[k] = time_limit_s
        elif words == "m, map frame":
            by[k] = _PLACE_M
        elif unit in _SOFT:
            soft[k] = _SOFT[unit]
        else:
            by[k] = _LINEAR[unit]
    return np.stack([by, soft])
