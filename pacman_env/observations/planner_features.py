"""Compute the features of a learned planner, scaled to about one; unreachable is far, and masked rows are 0.

The features of a candidate describe path lengths of robot and ghosts, possible encounters with wandering ghosts on the
way (``prediction.py``), and the outcome if the ghosts approach as believed (``outlook.py``).

Networks read columns by name, so that new columns do not matter to older networks. ``VERSION`` changes with the meaning
of any column: a network must not be run on columns of another version.
"""

import math
import weakref
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..engine.arrays import Array, Table, arrays_by_address
from ..engine.jit import kernel
from ..engine.pipeline import Stage
from ..game.behaviour_belief import BELIEVED
from ..game.goal_cost import TOTAL, ScorerParameters, is_threatening, score_situation
from ..levels.coarse_map import add_coarse_map
from ..levels.level import PREDICTION, level_arrays, prediction_arrays
from ..sim.beliefs import apart_cm
from ..world.navigation.grid import cell_of
from ..world.navigation.paths import UNREACHABLE_CM
from . import outlook, prediction
from .planner_columns import (
    CANDIDATE_FEATURES,
    FAR_M,
    GHOST_TOKENS,
    GLOBAL_FEATURES,
    MOST,
    TOKEN_FEATURES,
    CandidateColumn,
    GlobalColumn,
    TokenColumn,
)
from .situation import FRIGHTENED_S, HOLD, PELLET, REFUGE, Situation, maps_of, situation_arrays

if TYPE_CHECKING:
    from ..levels.level_slots import LevelSlots

VERSION = 5
_AROUND_M = 2.5  # pellets within this path length count as around a place
_SCORER = ScorerParameters()  # the handcrafted scorer, as deployed

_CANDIDATE_COLUMNS, _WHOLE_COLUMNS = len(CANDIDATE_FEATURES), len(GLOBAL_FEATURES)
_TOKENS, _TOKEN = len(GlobalColumn), len(TOKEN_FEATURES)  # first column of the ghosts; number of columns of one ghost
#: Number of behaviours; first column of the probabilities in a ghost's columns.
_BELIEVED, _PROBABILITIES = len(BELIEVED), len(TokenColumn)


class _PlannerArrays(NamedTuple):
    seen: Any = prediction.SeenArrays
    wanted: Any = Array(np.bool_, "N C")
    candidates: Any = Array(np.float32, f"N C {len(CANDIDATE_FEATURES)}")
    whole: Any = Array(np.float32, f"N {len(GLOBAL_FEATURES)}")
    outlook: Any = Array(np.int64, "1")  # address of the table of OutlookArrays


_arrays = arrays_by_address(_PlannerArrays)
_outlooks: "weakref.WeakKeyDictionary[LevelSlots, outlook.Outlook]" = weakref.WeakKeyDictionary()


def planner_features(situation: Situation, robot_speed_mps: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Return the features of candidates (N, C, 34) and of situations (N, 51), float32.

    Raises ValueError without maps.
    """
    games, slots = situation.mask.shape
    candidates = np.empty((games, slots, _CANDIDATE_COLUMNS), dtype=np.float32)
    whole = np.empty((games, _WHOLE_COLUMNS), dtype=np.float32)
    mask = np.ascontiguousarray(situation.mask)
    job, tables = planner_stage(situation, robot_speed_mps, mask, candidates, whole)
    situation.threads.run(job, tables, games)
    return candidates, whole


def planner_stage(
    situation: Situation,
    robot_speed_mps: float,
    wanted: NDArray[np.bool_],
    candidates: NDArray[np.float32],
    whole: NDArray[np.float32],
) -> Stage:
    """Return the stage that fills the features ``candidates`` (N, C, 34) and ``whole`` (N, 51) from a situation.

    Features of candidates outside the mask ``wanted`` (N, C) are 0. Call :func:`maps_changed` after games have moved to
    other maps.
    """
    seen = prediction.seen_arrays(situation, robot_speed_mps)  # also prepares the maps for the prediction
    arrays = {"seen": seen, "wanted": wanted, "candidates": candidates, "whole": whole}
    maps = maps_of(situation)
    for level in maps.levels(situation.level):
        add_coarse_map(level)
    if maps not in _outlooks:
        _outlooks[maps] = outlook.Outlook(maps.config)
    memory = _outlooks[maps].memory(maps.most_goals, situation.ghosts.shape[1], situation.threads.number)
    return _fill, [Table(_PlannerArrays, outlook=own, **arrays) for own in memory]


def maps_changed(situation: Situation, slots: NDArray[np.integer[Any]]) -> None:
    """Prepare the maps in ``slots`` (M,) for prediction and outlook."""
    for level in maps_of(situation).levels(slots):
        level.add_prediction_arrays()
        add_coarse_map(level)


@kernel
def _describe_ghosts(s, i, level, tokens):  # type: ignore[no-untyped-def]
    """Write the ``TokenColumn`` values of the four nearest ghosts to ``tokens`` (4 x 9,), nearest first.

    Columns of missing ghosts keep their value.
    """
    snap, length_cm, affine = level.snap, level.length_cm, level.affine
    x, y = s.robot[i, 0], s.robot[i, 1]
    column, row = cell_of(affine, snap.shape[0], snap.shape[1], x, y)
    robot_cell = snap[row, column]
    least, last = -1.0, -1
    for k in range(min(GHOST_TOKENS, s.ghosts.shape[1])):
        best, nearest = np.inf, -1  # the next ghost: farther than the last, or equally far with a higher number
        for j in range(s.ghosts.shape[1]):
            d = math.sqrt((s.ghosts[i, j, 0] - x) ** 2 + (s.ghosts[i, j, 1] - y) ** 2)
            if (d > least or (d == least and j > last)) and d < best and not prediction.is_nobody(s, i, np.int64(j)):
                best, nearest = d, j
        if nearest < 0:
            break
        least, last = best, nearest
        gx, gy, vx, vy, speed = s.ghosts[i, nearest]
        column, row = cell_of(affine, snap.shape[0], snap.shape[1], gx, gy)
        ghost_cell = snap[row, column]
        v = math.sqrt(vx * vx + vy * vy)
        t = tokens[k * _TOKEN : (k + 1) * _TOKEN]
        t[TokenColumn.THERE] = 1.0
        t[TokenColumn.DISTANCE], t[TokenColumn.NEAR] = min(best, FAR_M) / 5.0, math.exp(-best)
        path = max(0.01 * apart_cm(length_cm[robot_cell], length_cm[ghost_cell]), best)
        t[TokenColumn.PATH] = min(path, FAR_M) / 5.0
        t[TokenColumn.TOWARDS] = (vx * (x - gx) + vy * (y - gy)) / (v * best) if v * best > 1e-6 else 0.0
        t[TokenColumn.SPEED] = min(speed / 0.5, 4.0)
        for b in range(1, _BELIEVED):
            t[_PROBABILITIES + b - 1] = s.belief[i, nearest, b]


@kernel
def _describe_round(s, i, clyde_m, shortest, limit_s, coming, row):  # type: ignore[no-untyped-def]
    """Write the ``GlobalColumn`` values of situation i to ``row``.

    ``clyde_m`` is the straight distance to the nearest ghost and ``shortest`` the path length to the nearest pellet, m.
    ``limit_s`` is the length of a round and ``coming`` the number of approaching ghosts.
    """
    left_s = max(limit_s - s.time_s[i], 0.0)
    row[GlobalColumn.TIME_LEFT], row[GlobalColumn.TIME_SHORT] = min(left_s / 200.0, 5.0), math.exp(-left_s / 30.0)
    row[GlobalColumn.COMING] = coming
    row[GlobalColumn.FRIGHTENED] = min(s.fright[i, :, FRIGHTENED_S].max() / 10.0, MOST)
    row[GlobalColumn.CLYDE_DISTANCE], row[GlobalColumn.CLYDE_NEAR] = min(clyde_m, FAR_M) / 5.0, math.exp(-clyde_m)
    row[GlobalColumn.CLOSING_SPEED] = min(max(s.closing_speed[i] / 0.5, -2.0), 2.0)
    row[GlobalColumn.CLYDE_SPEED] = min(s.clyde_speed[i] / 0.5, 4.0)
    row[GlobalColumn.V] = min(max(s.robot_velocity[i, 0] / 0.3, -MOST), MOST)
    row[GlobalColumn.OMEGA] = min(max(s.robot_velocity[i, 1] / 2.0, -MOST), MOST)
    row[GlobalColumn.PELLETS_LEFT] = min(s.pellets_left[i], 32) / 8.0
    row[GlobalColumn.LAST_PELLET] = s.pellets_left[i] == 1
    vx, vy = s.clyde_velocity[i, 0], s.clyde_velocity[i, 1]
    v = math.sqrt(vx * vx + vy * vy)
    dx, dy = s.robot[i, 0] - s.clyde[i, 0], s.robot[i, 1] - s.clyde[i, 1]
    row[GlobalColumn.CLYDE_TOWARDS] = (vx * dx + vy * dy) / (v * clyde_m) if v * clyde_m > 1e-6 else 0.0
    row[GlobalColumn.POSE_AGE] = min(s.pose_age_s[i], 10.0) / 5.0
    row[GlobalColumn.NEAREST_WAY] = min(shortest, FAR_M) / 5.0


@kernel
def _shortest_way(s, i):  # type: ignore[no-untyped-def]
    """Return the path length to the nearest allowed pellet in m, or 0 if there is none."""
    shortest = np.inf
    for c in range(s.mask.shape[1]):
        if s.mask[i, c] and s.kind[i, c] == PELLET:
            shortest = min(shortest, s.path_robot[i, c])
    return shortest if math.isfinite(shortest) else 0.0


@kernel
def _describe_ways(s, i, c, clyde_m, shortest, robot_speed, f):  # type: ignore[no-untyped-def]
    """Write the columns for candidate c's kind and its distances from robot and ghosts to its features ``f``."""
    f[CandidateColumn.IS_PELLET], f[CandidateColumn.IS_REFUGE] = s.kind[i, c] == PELLET, s.kind[i, c] == REFUGE
    f[CandidateColumn.IS_HOLD], f[CandidateColumn.IS_CURRENT] = s.kind[i, c] == HOLD, c == s.current[i]
    f[CandidateColumn.IS_POWER] = s.is_power[i, c]
    own, other = min(s.path_robot[i, c], FAR_M), min(s.path_clyde[i, c], FAR_M)
    if s.kind[i, c] == HOLD:
        other = min(clyde_m, FAR_M)
    f[CandidateColumn.PATH_ROBOT], f[CandidateColumn.NEARNESS_ROBOT] = own / 5.0, math.exp(-own / 2.0)
    f[CandidateColumn.BEYOND_NEAREST] = min(max(s.path_robot[i, c] - shortest, -FAR_M), FAR_M) / 5.0
    f[CandidateColumn.PATH_CLYDE], f[CandidateColumn.NEARNESS_CLYDE] = other / 5.0, math.exp(-other / 2.0)
    margin_s = other / max(s.clyde_speed[i], 0.05) - own / robot_speed
    f[CandidateColumn.TIME_MARGIN] = min(max(margin_s / 20.0, -2.0), 2.0)
    dx, dy = s.position[i, c, 0] - s.clyde[i, 0], s.position[i, c, 1] - s.clyde[i, 1]
    f[CandidateColumn.CLYDE_DISTANCE] = min(math.sqrt(dx * dx + dy * dy), FAR_M) / 5.0


@kernel
def _describe_meeting(m, f):  # type: ignore[no-untyped-def]
    """Write the columns of the encounters ``m`` (9,) with wandering ghosts to a candidate's features ``f``."""
    f[CandidateColumn.CAUGHT_SOON], f[CandidateColumn.CAUGHT] = m[prediction.CAUGHT_SOON], m[prediction.CAUGHT]
    f[CandidateColumn.APPROACHED] = m[prediction.APPROACHED]
    f[CandidateColumn.CLOSEST_MEAN] = min(m[prediction.CLOSEST_MEAN], 10.0) / 3.0
    f[CandidateColumn.CLOSEST_LEAST] = min(m[prediction.CLOSEST], 10.0) / 3.0
    f[CandidateColumn.TURN_COSINE] = m[prediction.TURN_COSINE]
    f[CandidateColumn.TOWARDS_CLYDE] = m[prediction.TOWARDS_CLYDE]
    f[CandidateColumn.STANDING_CLEARANCE] = min(m[prediction.STANDING], 10.0) / 3.0
    f[CandidateColumn.START] = min(m[prediction.START_S] / 5.0, MOST)


@kernel
def _describe_hunt(h, f):  # type: ignore[no-untyped-def]
    """Write the columns of the outlook ``h`` (7,) with approaching ghosts to a candidate's features ``f``."""
    f[CandidateColumn.HUNTED], f[CandidateColumn.HUNTED_CAUGHT] = 1.0, h[outlook.CAUGHT]
    f[CandidateColumn.HUNTED_ARRIVES] = h[outlook.ARRIVES_S] / 15.0
    f[CandidateColumn.HUNTED_CLOSEST] = min(h[outlook.CLOSEST_M], 5.0) / 3.0
    f[CandidateColumn.HUNTED_LEAD] = h[outlook.LEAD_M] / 5.0
    f[CandidateColumn.HUNTED_COLLECTED] = min(h[outlook.COLLECTED] / 3.0, MOST)
    f[CandidateColumn.HUNTED_WAYS_ON] = h[outlook.WAYS_ON]
    f[CandidateColumn.HUNTED_LEAD_AFTER] = h[outlook.LEAD_AFTER_M] / 5.0


@kernel
def _describe_place(s, i, c, level, cost, f):  # type: ignore[no-untyped-def]
    """Write the columns for pellets and ghost cells around candidate c to ``f``, if it has a cell on the grid."""
    g, goals = s.goal[i, c], prediction_arrays(level.later[PREDICTION])
    if g < 0 or goals.goal_cell[g] < 0:
        return
    lengths = level.length_cm[goals.goal_cell[g]]
    nearest, total, others, around = FAR_M, 0.0, 0, 0
    for k in range(s.mask.shape[1]):
        if s.kind[i, k] != PELLET or not s.mask[i, k] or k == c or s.goal[i, k] < 0:
            continue
        cm = lengths[s.goal[i, k]]
        metres = FAR_M if cm == UNREACHABLE_CM else min(cm * 0.01, FAR_M)
        nearest = min(nearest, metres)
        total += metres
        others += 1
        around += metres <= _AROUND_M
    f[CandidateColumn.NEAREST_PELLET] = nearest / 5.0 if others > 0 else 0.0
    f[CandidateColumn.MEAN_PELLET] = total / others / 5.0 if others > 0 else 0.0
    f[CandidateColumn.PELLETS_AROUND] = min(around / 4.0, MOST)
    f[CandidateColumn.CLYDE_APART] = min(goals.goal_apart_m[g], 1.0)
    f[CandidateColumn.HANDCRAFTED_COST] = min(cost, FAR_M) / 5.0 if s.kind[i, c] == PELLET else 0.0


@kernel
def _fill(table, first, last):  # type: ignore[no-untyped-def]
    """Write the features of the situations ``first`` to ``last - 1``; return 0."""
    a = _arrays(table)
    candidates, whole, request = a.candidates, a.whole, a.seen.request[0]
    memory = outlook.outlook_arrays(a.outlook[0])
    s = situation_arrays(request.situation)
    room = prediction.room_to_meet(request.goals, s.mask.shape[1])
    meetings = np.empty((s.mask.shape[1], prediction.COLUMNS), np.float32)
    terms = np.empty((s.mask.shape[1], 6))
    hunts = np.zeros((s.mask.shape[1], outlook.COLUMNS), np.float32)
    whole[first:last] = 0.0
    for i in range(first, last):
        wanted = a.wanted[i]
        level = level_arrays(a.seen.levels[s.level[i]])
        prediction.meet(s, level, i, wanted, request, room, True, meetings)
        coming = outlook.coming(s, i)
        if coming > 0:
            outlook.look_ahead(s, i, level, wanted, memory, hunts)
        clyde_m = math.sqrt((s.clyde[i, 0] - s.robot[i, 0]) ** 2 + (s.clyde[i, 1] - s.robot[i, 1]) ** 2)
        shortest = _shortest_way(s, i)
        _describe_round(s, i, clyde_m, shortest, memory.rules[0].limit_s, coming, whole[i])
        _describe_ghosts(s, i, level, whole[i, _TOKENS:])
        threatened = is_threatening(clyde_m, s.closing_speed[i], False, _SCORER)
        score_situation(s.robot[i], s.clyde[i], s.position[i], threatened, False, _SCORER, terms)
        for c in range(s.mask.shape[1]):
            f = candidates[i, c]
            f[:] = 0.0
            if not wanted[c]:
                continue
            _describe_ways(s, i, c, clyde_m, shortest, request.robot_speed, f)
            _describe_meeting(meetings[c], f)
            if coming > 0:
                _describe_hunt(hunts[c], f)
            _describe_place(s, i, c, level, terms[c, TOTAL], f)
    return 0
