"""Predict for the next seconds how near ghosts may come to the robot's path to each candidate.

The paths of a ghost are the shortest ones from its position to the map's goals, weighted by its last motion; from a
goal it continues to another. The path of the robot leads to a candidate, including the first turn, and ends there. In
the kernels ``steps`` are a map's coarse steps with ``across`` tiles in a row, ``walkers`` are ``_Walkers``, ``affine``
(6,) maps m to cells, and ``room`` is the result of :func:`room_to_meet`.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...engine.arrays import Array, Table, arrays_by_address
from ...engine.jit import kernel, prefetch
from ...engine.native import address_of
from ...engine.simd import WIDTH, all_of, load, lower, minus, plus, roots, store, times, where_below
from ...world.navigation.controller import START_FIELDS, start_s, start_values
from ...world.navigation.grid import cell_of
from ...world.navigation.paths import ARRIVED, LENGTHS, NO_WAY, TILE, coarse_step, tile_index
from ..maps.level import COARSE_STEPS, level_arrays, steps_of_level
from .situation import HARMLESS, LAYOUT, Situation, maps_of

STEP_S = 0.5  # time between two instants
STEPS = 20  # number of instants: 10 s
NEAR_M, WIDE_M, SOON_S = 0.45, 0.8, 5.0
_SOON = round(SOON_S / STEP_S)  # number of instants
_FIRST_M = 0.4  # length of the start of a path that decides its direction
_SHARPNESS = 4.0  # rate at which the weight of a path falls with the angle to the ghost's last motion
_FAR_M = 10.0  # distance of a ghost that cannot move in this part of the map
_AHEAD = 3  # instants written per coarse step without a branch, usually enough
REQUEST = np.dtype(
    [
        ("games", np.int64),  # lengths of the situation's block
        ("candidates", np.int64),
        ("ghosts", np.int64),
        ("goals", np.int64),  # largest number of goals on any level
        ("robot_speed", np.float64),  # m/s
        *START_FIELDS,
    ]
)


class SeenArrays(NamedTuple):
    block: Any = Array(np.uint8, "b")  # memory block of the situations
    levels: Any = Array(np.int64, "L")  # addresses of the levels
    request: Any = Array(REQUEST, "1")


class _EncounterArrays(NamedTuple):
    seen: Any = SeenArrays
    result: Any = Array(np.float32, "N C 9")


_arrays, _situation = arrays_by_address(_EncounterArrays), LAYOUT.arrays
_BLOCK = (STEPS + _AHEAD) * WIDTH  # size of a block of WIDTH walkers: all walkers of an instant, then the next instant

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
        level.add_coarse_steps()
    block, *lengths = situation.block()
    values = (*lengths, maps.most_goals, robot_speed_mps, *start_values(maps.config))
    request = np.array([values], dtype=REQUEST)
    return SeenArrays(block, maps.addresses, request)


@kernel
def seen_by(seen):  # type: ignore[no-untyped-def]
    """Return the arrays of the situations whose block is in ``seen``, a ``SeenArrays``."""
    r = seen.request[0]
    return _situation(address_of(seen.block), r.games, r.candidates, r.ghosts)


@kernel
def _write(out_x, out_y, at, x, y, dx, dy, share):  # type: ignore[no-untyped-def]
    """Write (x, y) + ``share`` (dx, dy), in cells, to element ``at``; ``share`` is limited to 0..1."""
    part = min(max(share, 0.0), 1.0)
    out_x[at], out_y[at] = x + dx * part, y + dy * part


@kernel
def _walk(steps, across, count, goals, stretch, walkers, out_x, out_y):  # type: ignore[no-untyped-def]
    """Simulate ``count`` walkers on shortest paths to goals, and write their place in cells at every instant.

    ``out_x`` and ``out_y`` are blocks of ``_BLOCK`` float32: walker ``w`` is number ``w % WIDTH`` of block ``w //
    WIDTH``. Each walker walks ``stretch`` cells per instant. With ``goals`` above 1, a walker that has arrived
    continues to another goal.

    Walkers take coarse steps in turn, which hides the latency of memory. Instants beyond a coarse step are written too,
    and overwritten later, which avoids a branch.
    """
    starts, cells, targets, walked, written = walkers
    walking = 0
    for w in range(count):
        at = w // WIDTH * _BLOCK + w % WIDTH
        x, y, late = starts[w]
        waits = STEPS if late >= STEPS * stretch else int(late / stretch)
        for j in range(waits):
            out_x[at + j * WIDTH], out_y[at + j * WIDTH] = x, y
        written[w], walked[w] = waits, late
        walking += waits < STEPS
    per_cell = 1.0 / max(stretch, 1e-9)
    fresh = True
    while walking > 0:
        for w in range(count):
            first = written[w]
            if first >= STEPS:
                continue
            at = w // WIDTH * _BLOCK + w % WIDTH + first * WIDTH
            x, y = starts[w, 0], starts[w, 1]
            column, row, goal = cells[w, 0], cells[w, 1], targets[w]
            tile = tile_index(column, row, across)
            code = steps[tile, goal]
            if code == ARRIVED and goals > 1:
                goal = (7 * goal + 5) % goals  # any other goal, but deterministic
                if steps[tile, goal] == ARRIVED:
                    goal = (goal + 1) % goals
                code = steps[tile, goal]
                targets[w] = goal
            if code in (ARRIVED, NO_WAY):
                for j in range(STEPS - first):
                    out_x[at + j * WIDTH], out_y[at + j * WIDTH] = x, y
                written[w] = STEPS
                walking -= 1
                continue
            columns, rows = coarse_step(code)
            column, row = column + columns, row + rows
            prefetch(steps, tile_index(column, row, across))
            ahead_x, ahead_y = column + 0.5, row + 0.5
            dx, dy = ahead_x - x, ahead_y - y
            if fresh:  # the first step does not start at the middle of a cell
                length = math.sqrt(dx * dx + dy * dy)
                slope = 1.0 / max(length, 1e-9)
            else:
                length, slope = LENGTHS[code, 0], LENGTHS[code, 1]
            start = walked[w]
            end = start + length
            last = min(int(end * per_cell), STEPS)  # instants within the coarse step
            share, more = ((first + 1) * stretch - start) * slope, stretch * slope
            for u in range(_AHEAD):
                _write(out_x, out_y, at + u * WIDTH, x, y, dx, dy, share + u * more)
            if last - first > _AHEAD:
                for u in range(_AHEAD, last - first):
                    _write(out_x, out_y, at + u * WIDTH, x, y, dx, dy, share + u * more)
            walked[w], written[w] = end, max(last, first)
            starts[w, 0], starts[w, 1] = ahead_x, ahead_y
            cells[w, 0], cells[w, 1] = column, row
            walking -= last >= STEPS
        fresh = False


@kernel
def _ghost_paths(steps, across, ghost, stretch, first, goals, walkers, paths):  # type: ignore[no-untyped-def]
    """Write the possible paths of a ghost and their weights, which sum to 1, and return their number.

    ``ghost`` is position, drivable cell (column, row) and velocity, in cells; it walks ``stretch`` cells per instant to
    one of ``goals`` goals. The first ``first`` cells of a path decide its weight. One more path, which stands still, is
    written without a weight.
    """
    (x, y), cell, (vx, vy) = ghost
    tile = tile_index(cell[0], cell[1], across)
    walkers.cells[: goals + 1, 0], walkers.cells[: goals + 1, 1] = cell
    starts, used = walkers.starts, 0
    for k in range(goals):
        if steps[tile, k] != NO_WAY:
            starts[used, 0], starts[used, 1], starts[used, 2] = x, y, 0.0
            walkers.targets[used] = k
            used += 1
    starts[used, 0], starts[used, 1], starts[used, 2] = x, y, np.inf
    _walk(steps, across, np.int64(used + 1), np.int64(goals), stretch, walkers, paths.x, paths.y)
    v = math.sqrt(vx * vx + vy * vy)
    early = STEPS - 1 if stretch <= 0.0 else min(int(first / stretch), STEPS - 1)
    total = 0.0
    for k in range(used):
        at = k // WIDTH * _BLOCK + early * WIDTH + k % WIDTH
        dx, dy = paths.x[at] - x, paths.y[at] - y
        d = math.sqrt(dx * dx + dy * dy)
        weight = 1.0
        if v > 1e-6 and d > 1e-6:
            weight = math.exp(_SHARPNESS * ((dx * vx + dy * vy) / (d * v) - 1.0))
        paths.weights[k] = weight
        total += weight
    for k in range(used):
        paths.weights[k] /= total
    return used


@kernel
def _first_stretch(steps, across, start, cell, heading, clyde, goal, result):  # type: ignore[no-untyped-def]
    """Write the two cosines of the start of the robot's path to a goal to ``result`` (9,), see :func:`encounters`.

    Return the angle between this start and the heading, rad; -1 if there is no path, or if the robot is at the goal.
    ``start`` and ``clyde`` are positions in cells, ``cell`` is column and row, and ``heading`` a unit vector.
    """
    column, row = cell
    for _ in range(2):
        code = steps[tile_index(column, row, across), goal]
        if code == NO_WAY:
            return -1.0
        columns, rows = coarse_step(code)
        column, row = column + columns, row + rows
    dx, dy = column + 0.5 - start[0], row + 0.5 - start[1]
    d = math.sqrt(dx * dx + dy * dy)
    if d <= 1.0:
        return -1.0
    cx, cy = clyde[0] - start[0], clyde[1] - start[1]
    along, across = dx * heading[0] + dy * heading[1], dx * heading[1] - dy * heading[0]
    result[TURN_COSINE] = along / d
    result[TOWARDS_CLYDE] = (dx * cx + dy * cy) / (d * max(math.sqrt(cx * cx + cy * cy), 1e-6))
    return math.atan2(abs(across), along)


@kernel
def _nearest(own, at, paths, k, first, last, best):  # type: ignore[no-untyped-def]
    """Return the row ``best``, lowered to the squared distances between the robot's paths and ghost path k, in cells.

    ``best`` has one number for each of the ``WIDTH`` robot paths in the block of ``own`` that starts at element ``at``.
    The instants are ``first`` to ``last - 1``.
    """
    other = k // WIDTH * _BLOCK + k % WIDTH
    for j in range(first * WIDTH, last * WIDTH, WIDTH):
        dx = minus(load(own.x, at + j), all_of(paths.x[other + j]))
        dy = minus(load(own.y, at + j), all_of(paths.y[other + j]))
        best = lower(plus(times(dx, dx), times(dy, dy)), best)
    return best


@kernel
def _compare(own, at, paths, used, cells_per_m, sums):  # type: ignore[no-untyped-def]
    """Compare a block of the robot's paths, which starts at element ``at``, with ``used`` paths of the ghost.

    ``own`` and ``paths`` are ``_Paths``. The six rows of results in ``sums`` (6 x WIDTH,) are the first five columns of
    :func:`encounters` and its column 7, with distances in cells.
    """
    far = all_of((_FAR_M * cells_per_m) ** 2)
    near, wide = all_of((NEAR_M * cells_per_m) ** 2), all_of((WIDE_M * cells_per_m) ** 2)
    soon, caught, approached, mean, least = all_of(0.0), all_of(0.0), all_of(0.0), all_of(0.0), far
    for k in range(used):
        w = all_of(paths.weights[k])
        best = _nearest(own, at, paths, k, 0, _SOON, far)
        soon = plus(soon, where_below(best, near, w))
        best = _nearest(own, at, paths, k, _SOON, STEPS, best)
        caught = plus(caught, where_below(best, near, w))
        approached = plus(approached, where_below(best, wide, w))
        mean = plus(mean, times(w, roots(best)))
        least = lower(best, least)
    standing = _nearest(own, at, paths, used, 0, STEPS, far)
    store(sums, 0, soon)
    store(sums, WIDTH, caught)
    store(sums, 2 * WIDTH, approached)
    store(sums, 3 * WIDTH, mean)
    store(sums, 4 * WIDTH, least)
    store(sums, 5 * WIDTH, standing)


@kernel
def _in_cells(affine, x, y):  # type: ignore[no-untyped-def]
    """Convert a position in m to column and row, floats."""
    return affine[0] * x + affine[1] * y + affine[2], affine[3] * x + affine[4] * y + affine[5]


@kernel
def _turned(affine, x, y):  # type: ignore[no-untyped-def]
    """Convert a vector in m to columns and rows, floats."""
    return affine[0] * x + affine[1] * y, affine[3] * x + affine[4] * y


@kernel
def _steps(level):  # type: ignore[no-untyped-def]
    """Return the coarse steps of a level and the number of tiles in a row."""
    return steps_of_level(level.later[COARSE_STEPS]).coarse_steps, (level.snap.shape[1] + TILE - 1) // TILE


@kernel
def _drivable_cell(affine, snap, cell_xy, x, y):  # type: ignore[no-untyped-def]
    """Return column and row of the drivable cell nearest to (x, y), m."""
    rows, columns = snap.shape
    column, row = cell_of(affine, rows, columns, x, y)
    k = snap[row, column]
    return cell_of(affine, rows, columns, cell_xy[k, 0], cell_xy[k, 1])


class _Walkers(NamedTuple):
    starts: Any  # (W, 3) position in cells, and delay before the first coarse step, in cells of walking
    cells: Any  # (W, 2) column and row of the drivable cell at the position
    targets: Any  # (W,) goals
    walked: Any  # (W,) cells walked, including the delay
    written: Any  # (W,) number of instants that are written


class _Paths(NamedTuple):
    x: Any  # column at each instant, by block
    y: Any  # row at each instant, by block
    weights: Any  # (W,) weights of a ghost's paths
    candidates: Any  # (W,) candidates of the robot's paths


@kernel
def _paths(count):  # type: ignore[no-untyped-def]
    """Return memory for ``count`` paths."""
    size = (count + WIDTH - 1) // WIDTH * _BLOCK
    coordinates = np.zeros(size, np.float32), np.zeros(size, np.float32)
    return _Paths(coordinates[0], coordinates[1], np.empty(count, np.float32), np.empty(count, np.int64))


@kernel
def room_to_meet(goals, candidates):  # type: ignore[no-untyped-def]
    """Return the scratch memory of :func:`meet`: ghost paths, robot paths, walkers, sums."""
    ghost, most = goals + 1, max(goals + 1, candidates)
    starts, cells, targets = np.empty((most, 3)), np.empty((most, 2), np.int32), np.empty(most, np.int32)
    walkers = _Walkers(starts, cells, targets, np.empty(most), np.empty(most, np.int32))
    return _paths(ghost), _paths(candidates), walkers, np.empty(6 * WIDTH, np.float32)


@kernel
def is_nobody(s, i, k):  # type: ignore[no-untyped-def]
    """Return True if ghost k (-1: every ghost) of situation i is harmless."""
    return (s.fright[i, k, HARMLESS] if k >= 0 else s.fright[i, :, HARMLESS].min()) > 0.0


@kernel
def _meet_ghost(s, level, i, k, room, count, result):  # type: ignore[no-untyped-def]
    """Compare the robot's ``count`` paths with the paths of ghost k (-1: the nearest), and update ``result``."""
    paths, own, walkers, sums = room
    affine, (steps, across) = level.affine, _steps(level)
    per_m = math.sqrt(affine[0] ** 2 + affine[3] ** 2)  # cells per m
    if is_nobody(s, i, k):
        if k <= 0:
            for j in range(count):
                r = result[own.candidates[j]]
                r[CLOSEST_MEAN], r[CLOSEST], r[STANDING] = _FAR_M, _FAR_M, _FAR_M
        return
    x, y, vx, vy = s.clyde[i, 0], s.clyde[i, 1], s.clyde_velocity[i, 0], s.clyde_velocity[i, 1]
    ghost_speed = s.clyde_speed[i]
    if k >= 0:
        x, y, vx, vy, ghost_speed = s.ghosts[i, k]
    cell = _drivable_cell(affine, level.snap, level.cell_xy, x, y)
    ghost = _in_cells(affine, x, y), cell, _turned(affine, vx, vy)
    stretch, first = ghost_speed * STEP_S * per_m, _FIRST_M * per_m
    used = _ghost_paths(steps, across, ghost, stretch, first, len(level.goal_xy), walkers, paths)
    for block in range(-(-count // WIDTH)):
        _compare(own, block * _BLOCK, paths, used, per_m, sums)
        for j in range(min(count - block * WIDTH, WIDTH)):
            r = result[own.candidates[block * WIDTH + j]]
            mean = sums[3 * WIDTH + j] / per_m if used > 0 else np.float32(_FAR_M)
            closest, standing = math.sqrt(sums[4 * WIDTH + j]) / per_m, math.sqrt(sums[5 * WIDTH + j]) / per_m
            if k <= 0:
                r[CAUGHT_SOON], r[CAUGHT], r[APPROACHED] = sums[j], sums[WIDTH + j], sums[2 * WIDTH + j]
                r[CLOSEST_MEAN], r[CLOSEST], r[STANDING] = mean, closest, standing
            else:  # ghosts move independently of one another
                for column, at in ((CAUGHT_SOON, 0), (CAUGHT, WIDTH), (APPROACHED, 2 * WIDTH)):
                    r[column] = 1.0 - (1.0 - r[column]) * (1.0 - sums[at + j])
                r[CLOSEST_MEAN] = min(r[CLOSEST_MEAN], mean)
                r[CLOSEST] = min(r[CLOSEST], closest)
                r[STANDING] = min(r[STANDING], standing)


@kernel
def meet(s, level, i, wanted, request, room, every, result):  # type: ignore[no-untyped-def]
    """Write ``result`` (C, COLUMNS), the encounters of situation i with the nearest ghost, or with ``every`` ghost.

    Rows of candidates outside the mask ``wanted`` (C,) are 0; ``request`` is a ``REQUEST``. With several ghosts,
    probabilities refer to at least one ghost coming near, and CLOSEST_MEAN is the smallest of their means.
    """
    _, own, walkers, _ = room
    speed = request.robot_speed
    affine, (steps, across) = level.affine, _steps(level)
    per_m = math.sqrt(affine[0] ** 2 + affine[3] ** 2)  # cells per m
    place = _in_cells(affine, s.clyde[i, 0], s.clyde[i, 1])
    robot = _in_cells(affine, s.robot[i, 0], s.robot[i, 1])
    cell = _drivable_cell(affine, level.snap, level.cell_xy, s.robot[i, 0], s.robot[i, 1])
    x, y = _turned(affine, math.cos(s.robot[i, 2]), math.sin(s.robot[i, 2]))
    heading = x / per_m, y / per_m
    starts, count = walkers.starts, 0
    result[:] = 0.0
    for c in range(s.mask.shape[1]):
        if not wanted[c]:
            continue
        goal = s.goal[i, c]
        starts[count, 0], starts[count, 1], starts[count, 2] = robot[0], robot[1], np.inf
        if goal >= 0:
            off = _first_stretch(steps, across, robot, cell, heading, place, goal, result[c])
            if off >= 0.0:
                result[c, START_S] = start_s(off, s.robot_velocity[i, 0] / speed, request)
            starts[count, 2] = result[c, START_S] * speed * per_m
        walkers.cells[count, 0], walkers.cells[count, 1] = cell
        walkers.targets[count] = goal
        own.candidates[count] = c
        count += 1
    _walk(steps, across, np.int64(count), np.int64(0), speed * STEP_S * per_m, walkers, own.x, own.y)
    if every and s.ghosts.shape[1] > 1:
        for k in range(s.ghosts.shape[1]):
            _meet_ghost(s, level, i, np.int64(k), room, np.int64(count), result)
    else:
        _meet_ghost(s, level, i, np.int64(-1), room, np.int64(count), result)


@kernel
def _encounters(table, first, last):  # type: ignore[no-untyped-def]
    """Write the encounters of the situations ``first`` to ``last - 1`` with the nearest ghost; return 0."""
    a = _arrays(table)
    s = seen_by(a.seen)
    room = room_to_meet(a.seen.request[0].goals, a.result.shape[1])
    for i in range(first, last):
        level = level_arrays(a.seen.levels[s.level[i]])
        meet(s, level, i, s.mask[i], a.seen.request[0], room, False, a.result[i])
    return 0
