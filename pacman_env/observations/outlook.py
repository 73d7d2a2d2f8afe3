"""Predict the outcome of driving to each candidate if ghosts react to the robot as they are believed to do.

For each candidate the coarse model is played. The robot drives there while the ghosts that are believed to approach it
react, then on to the nearest other goals. Wandering ghosts are left out; see ``prediction.py`` for them.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..config import Config
from ..engine.arrays import Array, Table, arrays_by_address
from ..engine.jit import kernel
from ..engine.native import address_of
from ..game.behaviour_belief import BELIEVED, WANDERS, comes, taken_for
from ..game.ghosts import BEHAVIOURS, WANDER
from ..levels.coarse_map import coarse_arrays
from ..levels.level import COARSE_MAP
from ..sim import coarse_model
from ..sim.coarse_model import MOST_PELLETS, NOWHERE, Model, begin, copy_ghosts, lead_m, play, put_ghost, put_robot
from .situation import HARMLESS, PELLET

_FAR_S, _STAY_S, _AFTER_S = 30.0, 6.0, 8.0  # longest time played: to a candidate, while holding, after arriving
_WAYS = 4  # goals tried after arriving
_FAR_M = 10.0
_APART_M = 0.05  # the model's death radius is at least this much below the distance of the nearest ghost
_ROBOT = np.dtype(coarse_model.ROBOT)
#: Columns for each candidate: caught on the way; s until arrival or capture, at most 30; smallest distance of a ghost,
#: m; lead on arrival, m by path; collected pellets; share of the survived continuations, and the lead, m, at the end of
#: the best one.
CAUGHT, ARRIVES_S, CLOSEST_M, LEAD_M, COLLECTED, WAYS_ON, LEAD_AFTER_M = range(7)
COLUMNS = 7


class OutlookArrays(NamedTuple):
    """Scratch memory and constants of one thread."""

    rules: Any = Array(coarse_model.RULES, "2")  # with the margin of the death radius, and without it
    robots: Any = Array(_ROBOT, "3")  # at the start, on the way, after arriving
    ghosts: Any = Array(coarse_model.GHOST, "3 g")
    goals: Any = Array(np.int64, f"{_WAYS}")
    bit: Any = Array(np.int8, "b")
    classes: Any = Array(np.int64, f"{len(BELIEVED)} 2")  # addresses of each behaviour's kernel and constants
    behaviours: Any = coarse_model.BehaviourArrays
    behaviours_table: Any = Array(np.int64, "t")  # ``behaviours`` as a table


class Outlook:
    """Memory of the outlook kernels for each thread, under one configuration."""

    def __init__(self, config: Config) -> None:
        lags = coarse_model.Lags(), coarse_model.Lags(death_margin_m=0.0)
        self._rules = np.concatenate([coarse_model.rules(config, one) for one in lags])
        believed = [BEHAVIOURS.get(name, BEHAVIOURS[WANDER]) for name in BELIEVED]
        self._believed = coarse_model.Behaviours(believed, config)
        self._tables: list[Table] = []  # of OutlookArrays, for each thread

    def memory(self, goals: int, ghosts: int, threads: int) -> list[NDArray[np.int64]]:
        """Return for each thread the address (1,) of its OutlookArrays, for maps with at most ``goals`` goals."""
        own = self._tables[0].arrays if self._tables else None
        if own is None or own["ghosts"].shape[1] != ghosts or len(own["bit"]) != goals:
            self._tables = []
        while len(self._tables) < threads:
            behaviours = coarse_model.new_behaviour_arrays(ghosts)
            self._tables.append(
                Table(
                    OutlookArrays,
                    rules=self._rules.copy(),
                    robots=np.zeros(3, dtype=coarse_model.ROBOT),
                    ghosts=np.zeros((3, ghosts), dtype=coarse_model.GHOST),
                    goals=np.zeros(_WAYS, dtype=np.int64),
                    bit=np.zeros(goals, dtype=np.int8),
                    classes=self._believed.table.array("behaviours"),
                    behaviours=behaviours,
                    behaviours_table=Table(coarse_model.BehaviourArrays, **behaviours._asdict()).numbers,
                )
            )
        return [np.array([table.address]) for table in self._tables[:threads]]


outlook_arrays = arrays_by_address(OutlookArrays)


@kernel
def coming(s, i):  # type: ignore[no-untyped-def]
    """Return the number of ghosts that are believed to approach the robot in situation i."""
    count = 0
    for k in range(s.belief.shape[1]):
        count += comes(s.belief[i, k]) and s.fright[i, k, HARMLESS] == 0.0
    return count


@kernel
def _mark_pellets(s, i, bit):  # type: ignore[no-untyped-def]
    """Write to ``bit`` (G,) int8 the bit of each goal that is an allowed pellet, else -1; return their number.

    If there are too many, only the nearest ones get a bit.
    """
    bit[:] = -1
    limit_m = np.inf
    count = 0
    for c in range(s.mask.shape[1]):
        count += s.mask[i, c] and s.kind[i, c] == PELLET
    if count > MOST_PELLETS:
        lengths = np.full(s.mask.shape[1], np.inf)
        for c in range(s.mask.shape[1]):
            if s.mask[i, c] and s.kind[i, c] == PELLET:
                lengths[c] = s.path_robot[i, c]
        limit_m = np.sort(lengths)[MOST_PELLETS - 1]
    used = 0
    for c in range(s.mask.shape[1]):
        near = s.path_robot[i, c] <= limit_m and s.path_robot[i, c] < np.inf
        if s.mask[i, c] and s.kind[i, c] == PELLET and near and s.goal[i, c] >= 0 and used < MOST_PELLETS:
            bit[s.goal[i, c]] = used
            used += 1
    return used


@kernel
def _list_ways(robot, model, goals):  # type: ignore[no-untyped-def]
    """Write the nearest remaining goals of a robot, by path length, to ``goals`` (W,); return their number."""
    length = model.map.robot_length[robot.block]
    count = 0
    for goal in range(len(length)):
        own = length[goal]
        bit = model.bit[goal]
        gone = bit >= 0 and not (robot.pellets >> np.uint64(bit)) & np.uint64(1)
        if own == np.inf or own <= model.rules[0].goal_m or gone:
            continue
        place = min(count, len(goals) - 1)
        if count == len(goals) and length[goals[place]] <= own:
            continue
        while place > 0 and length[goals[place - 1]] > own:
            goals[place] = goals[place - 1]
            place -= 1
        goals[place] = goal
        count = min(count + 1, len(goals))
    return count


@kernel
def _put_ghosts(s, i, model, a):  # type: ignore[no-untyped-def]
    """Put the ghosts that are believed to approach at the start; return their number and the least distance, m."""
    count, apart = 0, np.inf
    for k in range(s.belief.shape[1]):
        which = taken_for(s.belief[i, k])
        if which == WANDERS or s.fright[i, k, HARMLESS] > 0.0:
            continue
        a.behaviours.behaviours[k, 0], a.behaviours.behaviours[k, 1] = a.classes[which, 0], a.classes[which, 1]
        put_ghost(a.ghosts[0, count], k, model, s.ghosts[i, k])
        apart = min(apart, math.hypot(s.ghosts[i, k, 0] - s.robot[i, 0], s.ghosts[i, k, 1] - s.robot[i, 1]))
        count += 1
    return count, apart


@kernel
def look_ahead(s, i, level, wanted, a, result):  # type: ignore[no-untyped-def]
    """Write the outlook of each candidate in situation i to ``result`` (C, COLUMNS), 0 if not ``wanted`` (C,).

    ``s`` are the arrays of the situations, ``level`` are the arrays of the map, and ``a`` are ``OutlookArrays``.
    """
    result[:] = 0.0
    m = coarse_arrays(level.later[COARSE_MAP])
    bit = a.bit[: len(m.goal_xy)]
    model = Model(m, a.rules, address_of(a.behaviours_table), bit)
    robots, numbers = a.robots, a.rules[0]
    first, way, after = robots[0], robots[1], robots[2]
    used = _mark_pellets(s, i, bit)
    put_robot(first, model, s.robot[i, 0], s.robot[i, 1], s.robot[i, 2])
    first.time_s = s.time_s[i]
    first.pellets = np.uint64(0xFFFFFFFFFFFFFFFF) if used == 64 else (np.uint64(1) << np.uint64(used)) - np.uint64(1)
    count, apart = _put_ghosts(s, i, model, a)
    margin = numbers.death_m
    numbers.death_m = max(a.rules[1].death_m, min(margin, apart - _APART_M))
    now = s.current[i]
    if now >= 0 and s.mask[i, now] and s.goal[i, now] >= 0 and s.path_robot[i, now] < np.inf:
        begin(first, np.int64(s.goal[i, now]), s.path_robot[i, now], model)
    initial, moving, last = a.ghosts[0, :count], a.ghosts[1, :count], a.ghosts[2, :count]
    for c in range(s.mask.shape[1]):
        goal = np.int64(s.goal[i, c])
        if not wanted[c] or (goal >= 0 and s.path_robot[i, c] == np.inf):
            continue
        r = result[c]
        robots[1] = robots[0]
        copy_ghosts(initial, moving)
        until = first.time_s + (_FAR_S if goal >= 0 else _STAY_S)
        play(way, moving, goal if goal >= 0 else np.int64(NOWHERE), until, model)
        r[CAUGHT] = way.dead
        r[ARRIVES_S] = way.time_s - first.time_s
        r[CLOSEST_M] = min(way.closest_m, _FAR_M)
        r[COLLECTED] = way.collected
        if way.dead:
            continue
        r[LEAD_M] = min(lead_m(way, moving, m), _FAR_M)
        if way.pellets == 0:  # the round is complete
            r[LEAD_M] = r[LEAD_AFTER_M] = _FAR_M
            r[WAYS_ON] = 1.0
            continue
        ways = _list_ways(way, model, a.goals)
        for k in range(ways + 1):  # in the last play the robot stays
            robots[2] = robots[1]
            copy_ghosts(moving, last)
            play(after, last, a.goals[k] if k < ways else np.int64(NOWHERE), way.time_s + _AFTER_S, model)
            if not after.dead:
                r[WAYS_ON] += 1.0 / (ways + 1)
                r[LEAD_AFTER_M] = max(r[LEAD_AFTER_M], min(lead_m(after, last, m), _FAR_M))
    numbers.death_m = margin
