"""The float32 features that a network reads: directions in the robot's frame, lengths in m, capped at ``FAR_M``."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...engine.arrays import Array, Layout, Table, address, arrays_by_address
from ...engine.jit import kernel
from .situation import HOLD, PELLET, REFUGE, Situation
from .situation import LAYOUT as situation_layout

FAR_M = 100.0  # cap of every length
FAST_MPS = 5.0  # cap of every speed
OLD_S = 100.0  # cap of a pose's age

Columns = tuple[tuple[str, float, float, str], ...]
#: name, low, high, unit of each column of the arrays that an observation holds; what has no bound of its own is
#: bounded by the map or the configuration (``kinds.py``).
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


class _FillArrays(NamedTuple):
    request: Any = Array(np.int64, "5")  # as write_features takes them


LAYOUT = Layout(FeatureArrays)
_ROOM, _WRITTEN = "_room", "_features"  # where a situation keeps the block; likewise, until it is used
_fill_arrays, _situation, _features = arrays_by_address(_FillArrays), situation_layout.arrays, LAYOUT.arrays


def observe(situation: Situation) -> Observation:
    return {**features(situation), "action_mask": situation.mask.astype(np.int8)}


def features(situation: Situation) -> Observation:
    """``robot`` (N, 7), ``clyde`` (N, 7), ``candidates`` (N, C, 10), ``round`` (N, 2), ``ghosts`` (N, G, 6) if several.

    Rows of candidates that the mask forbids keep their kind and are 0 otherwise.
    """
    block, *lengths = situation.block()
    seen = situation.__dict__.pop(_WRITTEN, None)
    if seen is None:
        seen = LAYOUT.new(*lengths)
        table = Table(_FillArrays, request=np.array([address(block), *lengths, address(seen)]))
        situation.threads.run(_fill, [table], lengths[0])
    found = LAYOUT.views(seen, *lengths)
    if lengths[2] == 1:
        del found["ghosts"]
    return found


@kernel
def _cap(value, limit):  # type: ignore[no-untyped-def]
    return min(max(value, -limit), limit)


@kernel
def in_robot_frame(dx, dy, cos, sin, limit):  # type: ignore[no-untyped-def]
    """A vector of the map frame as forward and left of a robot whose heading has that cosine and sine, cut."""
    return _cap(dx * cos + dy * sin, limit), _cap(dy * cos - dx * sin, limit)


def room_for_features(situation: Situation) -> NDArray[np.uint8]:
    """A block that :func:`write_features` may fill; the next call of :func:`features` uses it."""
    _, *lengths = situation.block()
    seen: NDArray[np.uint8] | None = situation.__dict__.get(_ROOM)
    if seen is None:
        seen = situation.__dict__[_ROOM] = LAYOUT.new(*lengths)
    situation.__dict__[_WRITTEN] = seen
    return seen


@kernel
def _fill(table, first, last):  # type: ignore[no-untyped-def]
    request = _fill_arrays(table).request
    write_features(request[0], request[1], request[2], request[3], request[4], first, last)
    return 0


@kernel
def write_features(block, n, count, others, seen, first, last):  # type: ignore[no-untyped-def]
    """Fill a block with features at ``seen`` from that of the situations at ``block``."""
    f, s = _features(seen, n, count, others), _situation(block, n, count, others)
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
        for c in range(count):
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
