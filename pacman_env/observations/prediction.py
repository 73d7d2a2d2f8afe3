"""Predict for the next seconds how near ghosts may come to the robot's path to each candidate.

The paths of a ghost are the shortest ones from its position to the map's goals, weighted by its last motion; from a
goal it continues to another. The path of the robot leads to a candidate, including the first turn, and ends there.
Plain loops, whose shape ``benchmarks/history.md`` explains, compare the places of all paths at the same instants.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..engine.arrays import Array, Table, arrays_by_address
from ..engine.jit import kernel
from ..levels.level import PREDICTION, level_arrays, prediction_arrays
from ..world.navigation.controller import START_FIELDS, start_s, start_values
from ..world.navigation.grid import cell_of
from ..world.navigation.paths import ARRIVED, NO_WAY, coarse_step
from .situation import HARMLESS, Situation, maps_of, situation_arrays

STEP_S = 0.5  # time between two instants
STEPS = 20  # number of instants: 10 s
NEAR_M, WIDE_M, SOON_S = 0.45, 0.8, 5.0
_SOON = round(SOON_S / STEP_S)  # number of instants
_FIRST_M = 0.4  # length of the start of a path that decides its direction
_SHARPNESS = 4.0  # rate at which the weight of a path falls with the angle to the ghost's last motion
_FAR_M = 10.0  # distance of a ghost that cannot move in this part of the map
_SPARE = 3  # instants written per coarse step in any case, which saves a branch
_ROW = 8  # rows of a ghost's paths have a multiple of this length, which makes the loops over them fast
_BLOCK = 5  # instants compared per loop over the ghost's paths
REQUEST = np.dtype(
    [
        ("situation", np.int64),  # address of the situations' table
        ("goals", np.int64),  # largest number of goals on any level
        ("robot_speed", np.float64),  # m/s
        *START_FIELDS,
    ]
)


class SeenArrays(NamedTuple):
    levels: Any = Array(np.int64, "L")  # addresses of the levels
    request: Any = Array(REQUEST, "1")


class _EncounterArrays(NamedTuple):
    seen: Any = SeenArrays
    result: Any = Array(np.float32, "N C 9")


_arrays = arrays_by_address(_EncounterArrays)

#: Columns of :func:`encounters`.
CAUGHT_SOON, CAUGHT, APPROACHED, CLOSEST_MEAN, CLOSEST, TURN_COSINE, TOWARDS_CLYDE, STANDING, START_S = range(9)
COLUMNS = 9


def encounters(situation: Situation, robot_speed_mps: float) -> NDArray[np.float32]:
    """Return how near the nearest ghost may come on the path to each candidate within 10 s, (N, C, 9) float32.

    Columns 0 to 2 are the probabilities of a distance below 0.45 m within 5 s, below 0.45 m within 10 s, and below
    0.8 m within 10 s. Columns 3 and 4 are the smallest distance, m: mean and minimum over the ghost's paths. Columns 5
    and 6 are cosines between the start of the robot's path and its heading or the direction to the ghost. Column 7 is
    the smallest distance, m, if the ghost stands. Column 8 is the time, s, in which the robot turns to the path and
    speeds up. Rows of masked candidates are 0.
    """
    result = np.empty((*situation.mask.shape, COLUMNS), dtype=np.float32)
    table = Table(_EncounterArrays, seen=seen_arrays(situation, robot_speed_mps), result=result)
    situation.threads.run(_encounters, [table], len(result))
    return result


def seen_arrays(situation: Situation, robot_speed_mps: float) -> SeenArrays:
    maps = maps_of(situation)
    for level in maps.levels(situation.level):
        level.add_prediction_arrays()
    values = (situation.table.address, maps.most_goals, robot_speed_mps, *start_values(maps.config))
    request = np.array([values], dtype=REQUEST)
    return SeenArrays(maps.addresses, request)


class _Map(NamedTuple):
    """A level as walkers need it."""

    steps: Any  # (H, W, G) uint8, codes of coarse steps to each goal
    affine: Any  # (6,) m to column and row
    cells_per_m: Any


class _Place(NamedTuple):
    """A position in cells, and the drivable cell nearest to it."""

    x: Any  # column, float
    y: Any  # row, float
    column: Any
    row: Any


class _Paths(NamedTuple):
    """Positions of walkers at the instants, in cells."""

    x: Any  # float32
    y: Any


class _Room(NamedTuple):
    """Scratch memory of :func:`meet`."""

    ghost: Any  # _Paths (STEPS + _SPARE, W) of a ghost
    weights: Any  # (W,) of the ghost's paths
    robot: Any  # _Paths (C, STEPS + _SPARE) of the robot
    candidates: Any  # (C,) to which the robot's paths lead
    nearest: Any  # (W,) smallest squared distance to each of the ghost's paths
    early: Any  # (W,) the same within ``SOON_S``


@kernel
def _paths(rows, columns):  # type: ignore[no-untyped-def]
    """Return ``_Paths`` of zeros of the shape (``rows``, ``columns``)."""
    return _Paths(np.zeros((rows, columns), np.float32), np.zeros((rows, columns), np.float32))


@kernel
def room_to_meet(goals, candidates):  # type: ignore[no-untyped-def]
    """Return the scratch memory of :func:`meet` for at most ``goals`` goals."""
    width = goals + _ROW
    rows = np.empty((3, width), np.float32)
    instants = STEPS + _SPARE
    return _Room(
        _paths(instants, width), rows[0], _paths(candidates, instants), np.empty(candidates, np.int64), rows[1], rows[2]
    )


@kernel
def _map_of(level):  # type: ignore[no-untyped-def]
    """Return the ``_Map`` of a level, which must have its prediction arrays."""
    steps = prediction_arrays(level.later[PREDICTION]).coarse_steps
    return _Map(steps, level.affine, math.sqrt(level.affine[0] ** 2 + level.affine[3] ** 2))


@kernel
def _place(level, x, y):  # type: ignore[no-untyped-def]
    """Return the place at (x, y), m."""
    affine, (rows, columns) = level.affine, level.snap.shape
    column, row = cell_of(affine, rows, columns, x, y)
    nearest = level.cell_xy[level.snap[row, column]]
    column, row = cell_of(affine, rows, columns, nearest[0], nearest[1])
    x, y = affine[0] * x + affine[1] * y + affine[2], affine[3] * x + affine[4] * y + affine[5]
    return _Place(x, y, column, row)


@kernel
def _turned(affine, x, y):  # type: ignore[no-untyped-def]
    """Convert a vector in m to columns and rows, floats."""
    return affine[0] * x + affine[1] * y, affine[3] * x + affine[4] * y


@kernel
def _walk(m, place, goal, late, stretch, goals, xs, ys):  # type: ignore[no-untyped-def]
    """Simulate a walk on the shortest path from a place to a goal, and write its positions at the instants.

    It walks ``stretch`` cells per instant, after the time in which it would walk ``late`` cells. With ``goals`` above
    1, it continues to another goal when it has arrived.
    """
    x, y, column, row = place.x, place.y, place.column, place.row
    per_cell = 1.0 / max(stretch, 1e-9)
    first = STEPS if late >= STEPS * stretch else int(late / stretch)  # next instant
    for j in range(first):
        xs[j], ys[j] = x, y
    walked = late
    while first < STEPS:
        code = m.steps[row, column, goal]
        if code == ARRIVED and goals > 1:
            goal = (7 * goal + 5) % goals  # any other goal, but deterministic
            if m.steps[row, column, goal] == ARRIVED:
                goal = (goal + 1) % goals
            code = m.steps[row, column, goal]
        if code in (ARRIVED, NO_WAY):
            break
        columns, rows = coarse_step(code)
        column, row = column + columns, row + rows
        dx, dy = column + 0.5 - x, row + 0.5 - y
        length = math.sqrt(dx * dx + dy * dy)
        per_length = 1.0 / max(length, 1e-9)
        share, more = ((first + 1) * stretch - walked) * per_length, stretch * per_length
        for j in range(_SPARE):  # positions after the end of the coarse step are overwritten later
            part = min(max(share + j * more, 0.0), 1.0)
            xs[first + j], ys[first + j] = x + dx * part, y + dy * part
        walked += length
        last = min(int(walked * per_cell), STEPS)
        for j in range(_SPARE, last - first):
            part = min(max(share + j * more, 0.0), 1.0)
            xs[first + j], ys[first + j] = x + dx * part, y + dy * part
        first = max(last, first)
        x, y = column + 0.5, row + 0.5
    for j in range(first, STEPS):
        xs[j], ys[j] = x, y


@kernel
def _ghost_paths(m, place, velocity, stretch, goals, room):  # type: ignore[no-untyped-def]
    """Write the possible paths of a ghost and their weights, which sum to 1, and return their number.

    The ghost walks ``stretch`` cells per instant to one of ``goals`` goals; its velocity (2,) is in cells. One more
    path, which stands still, is written without a weight.
    """
    used, ghost, weights = 0, room.ghost, room.weights
    for goal in range(goals):
        if m.steps[place.row, place.column, goal] != NO_WAY:
            _walk(m, place, np.int64(goal), 0.0, stretch, np.int64(goals), ghost.x[:, used], ghost.y[:, used])
            used += 1
    for j in range(STEPS):
        ghost.x[j, used], ghost.y[j, used] = place.x, place.y
    v = math.sqrt(velocity[0] * velocity[0] + velocity[1] * velocity[1])
    early = STEPS - 1 if stretch <= 0.0 else min(int(_FIRST_M * m.cells_per_m / stretch), STEPS - 1)
    total = 0.0
    for k in range(used):
        dx, dy = ghost.x[early, k] - place.x, ghost.y[early, k] - place.y
        d = math.sqrt(dx * dx + dy * dy)
        weight = 1.0
        if v > 1e-6 and d > 1e-6:
            weight = math.exp(_SHARPNESS * ((dx * velocity[0] + dy * velocity[1]) / (d * v) - 1.0))
        weights[k] = weight
        total += weight
    for k in range(used):
        weights[k] /= total
    return used


@kernel
def _first_stretch(m, robot, heading, clyde, goal, result):  # type: ignore[no-untyped-def]
    """Write the two cosines of the start of the robot's path to a goal to ``result`` (9,), see :func:`encounters`.

    Return the angle between this start and the heading, rad; -1 if there is no path, or if the robot is at the goal.
    ``robot`` and ``clyde`` are places, and ``heading`` is a unit vector.
    """
    column, row = robot.column, robot.row
    for _ in range(2):
        code = m.steps[row, column, goal]
        if code == NO_WAY:
            return -1.0
        columns, rows = coarse_step(code)
        column, row = column + columns, row + rows
    dx, dy = column + 0.5 - robot.x, row + 0.5 - robot.y
    d = math.sqrt(dx * dx + dy * dy)
    if d <= 1.0:
        return -1.0
    cx, cy = clyde.x - robot.x, clyde.y - robot.y
    along, aside = dx * heading[0] + dy * heading[1], dx * heading[1] - dy * heading[0]
    result[TURN_COSINE] = along / d
    result[TOWARDS_CLYDE] = (dx * cx + dy * cy) / (d * max(math.sqrt(cx * cx + cy * cy), 1e-6))
    return math.atan2(abs(aside), along)


@kernel
def _lower(room, r, first, nearest):  # type: ignore[no-untyped-def]
    """Lower ``nearest`` (W,) to the squared distances between path ``r`` of the robot and the ghost's paths, in cells.

    Only ``_BLOCK`` instants count, from ``first`` on.
    """
    ghost, robot = room.ghost, room.robot
    for k in range(len(nearest)):
        least = nearest[k]
        for j in range(first, first + _BLOCK):
            dx, dy = ghost.x[j, k] - robot.x[r, j], ghost.y[j, k] - robot.y[r, j]
            square = dx * dx + dy * dy
            least = square if square < least else least
        nearest[k] = least


@kernel
def _compare(room, r, used, cells_per_m):  # type: ignore[no-untyped-def]
    """Return the first five columns of :func:`encounters` and column 7 for path ``r`` of the robot and one ghost.

    The ghost has ``used`` paths; the next path stands still.
    """
    far = np.float32((_FAR_M * cells_per_m) ** 2)
    near, wide = np.float32((NEAR_M * cells_per_m) ** 2), np.float32((WIDE_M * cells_per_m) ** 2)
    width = used // _ROW * _ROW + _ROW
    nearest, early = room.nearest[:width], room.early[:width]
    for k in range(width):
        nearest[k] = far
    for first in range(0, _SOON, _BLOCK):
        _lower(room, r, first, nearest)
    for k in range(width):
        early[k] = nearest[k]
    for first in range(_SOON, STEPS, _BLOCK):
        _lower(room, r, first, nearest)
    soon = caught = approached = mean = nothing = np.float32(0.0)
    least = far
    for k in range(used):
        w, square = room.weights[k], nearest[k]
        soon += w if early[k] < near else nothing
        caught += w if square < near else nothing
        approached += w if square < wide else nothing
        mean += w * math.sqrt(square)
        least = square if square < least else least
    mean_m = mean / cells_per_m if used > 0 else np.float32(_FAR_M)
    least_m, standing_m = math.sqrt(least) / cells_per_m, math.sqrt(nearest[used]) / cells_per_m
    return soon, caught, approached, mean_m, least_m, standing_m


@kernel
def is_nobody(s, i, k):  # type: ignore[no-untyped-def]
    """Return True if ghost k (-1: every ghost) of situation i is harmless."""
    return (s.fright[i, k, HARMLESS] if k >= 0 else s.fright[i, :, HARMLESS].min()) > 0.0


@kernel
def _meet_ghost(s, level, i, k, room, count, result):  # type: ignore[no-untyped-def]
    """Compare the robot's ``count`` paths with the paths of ghost k (-1: the nearest), and update ``result``."""
    m = _map_of(level)
    if is_nobody(s, i, k):
        if k <= 0:
            for j in range(count):
                r = result[room.candidates[j]]
                r[CLOSEST_MEAN], r[CLOSEST], r[STANDING] = _FAR_M, _FAR_M, _FAR_M
        return
    x, y, vx, vy = s.clyde[i, 0], s.clyde[i, 1], s.clyde_velocity[i, 0], s.clyde_velocity[i, 1]
    ghost_speed = s.clyde_speed[i]
    if k >= 0:
        x, y, vx, vy, ghost_speed = s.ghosts[i, k]
    stretch = ghost_speed * STEP_S * m.cells_per_m
    used = _ghost_paths(m, _place(level, x, y), _turned(m.affine, vx, vy), stretch, len(level.goal_xy), room)
    for j in range(count):
        r = result[room.candidates[j]]
        soon, caught, approached, mean_m, least_m, standing_m = _compare(room, j, used, m.cells_per_m)
        if k > 0:  # ghosts move independently of one another
            soon = 1.0 - (1.0 - r[CAUGHT_SOON]) * (1.0 - soon)
            caught = 1.0 - (1.0 - r[CAUGHT]) * (1.0 - caught)
            approached = 1.0 - (1.0 - r[APPROACHED]) * (1.0 - approached)
            mean_m, least_m = min(r[CLOSEST_MEAN], mean_m), min(r[CLOSEST], least_m)
            standing_m = min(r[STANDING], standing_m)
        r[CAUGHT_SOON], r[CAUGHT], r[APPROACHED] = soon, caught, approached
        r[CLOSEST_MEAN], r[CLOSEST], r[STANDING] = mean_m, least_m, standing_m


@kernel
def meet(s, level, i, wanted, request, room, every, result):  # type: ignore[no-untyped-def]
    """Write ``result`` (C, COLUMNS), the encounters of situation i with the nearest ghost, or with ``every`` ghost.

    Rows of candidates outside the mask ``wanted`` (C,) are 0; ``request`` is a ``REQUEST``. With several ghosts,
    probabilities refer to at least one ghost coming near, and CLOSEST_MEAN is the smallest of their means.
    """
    m, speed = _map_of(level), request.robot_speed
    clyde, robot = _place(level, s.clyde[i, 0], s.clyde[i, 1]), _place(level, s.robot[i, 0], s.robot[i, 1])
    x, y = _turned(m.affine, math.cos(s.robot[i, 2]), math.sin(s.robot[i, 2]))
    heading = x / m.cells_per_m, y / m.cells_per_m
    stretch, count = speed * STEP_S * m.cells_per_m, 0
    result[:] = 0.0
    for c in range(s.mask.shape[1]):
        if not wanted[c]:
            continue
        goal, late = np.int64(s.goal[i, c]), np.inf
        if goal >= 0:
            off = _first_stretch(m, robot, heading, clyde, goal, result[c])
            if off >= 0.0:
                result[c, START_S] = start_s(off, s.robot_velocity[i, 0] / speed, request)
            late = result[c, START_S] * speed * m.cells_per_m
        _walk(m, robot, goal, late, stretch, np.int64(0), room.robot.x[count], room.robot.y[count])
        room.candidates[count] = c
        count += 1
    ghosts = s.ghosts.shape[1]
    for k in range(ghosts) if every and ghosts > 1 else range(-1, 0):
        _meet_ghost(s, level, i, np.int64(k), room, np.int64(count), result)


@kernel
def _encounters(table, first, last):  # type: ignore[no-untyped-def]
    """Write the encounters of the situations ``first`` to ``last - 1`` with the nearest ghost; return 0."""
    a = _arrays(table)
    s = situation_arrays(a.seen.request[0].situation)
    room = room_to_meet(a.seen.request[0].goals, a.result.shape[1])
    for i in range(first, last):
        level = level_arrays(a.seen.levels[s.level[i]])
        meet(s, level, i, s.mask[i], a.seen.request[0], room, False, a.result[i])
    return 0
