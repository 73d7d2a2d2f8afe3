"""The features of a learned planner, of the order of one; what is unreachable is far, rows that are masked are 0.

A candidate has what the robot's and the ghosts' paths say, what ghosts that wander may do on the way there
(``prediction.py``), and what becomes of the robot if those come for it that are believed to (``coarse/outlook.py``).

``VERSION`` changes with the meaning of any column: a network trained on other columns must not be run on these.
"""

import math
import weakref
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...engine.arrays import Array, Table, arrays_by_address
from ...engine.jit import kernel
from ...engine.pipeline import Stage
from ...game.behaviour_belief import ARCADE, CHASES, OTHER, comes
from ...game.goal_cost import TOTAL, ScorerParameters, is_threatening, score_situation
from ...world.navigation.grid import cell_of
from ...world.navigation.paths import UNREACHABLE_CM
from ..coarse import outlook
from ..coarse.coarse_map import add_coarse_map
from ..core.beliefs import apart_cm
from ..maps.level import COARSE_MAP, level_arrays
from . import prediction
from .situation import HOLD, PELLET, REFUGE, Situation, among

if TYPE_CHECKING:
    from ..maps.level_slots import LevelSlots

VERSION = 4
NEEDS_MAPS = -(2**40)  # of a stage: maps are to be made ready, and the stage is to run again
FAR_M = 20.0
MOST = 5.0  # of any feature, up or down
_AROUND_M = 2.5  # pellets within this path length are around a place
_SCORER = ScorerParameters()  # the handcrafted one, as deployed

CANDIDATE_FEATURES = (
    *("is_pellet", "is_refuge", "is_hold", "is_current"),
    *("path_robot", "nearness_robot", "path_clyde", "nearness_clyde", "time_margin", "clyde_distance"),
    *("caught_soon", "caught", "approached", "closest_mean", "closest_least"),  # prediction.py, and the next three
    *("turn_cosine", "towards_clyde", "standing_clearance"),
    *("nearest_pellet", "mean_pellet", "pellets_around", "clyde_apart", "handcrafted_cost", "beyond_nearest"),
    *("hunted", "hunted_caught", "hunted_arrives", "hunted_closest", "hunted_lead"),  # by ghosts that come for it
    *("hunted_collected", "hunted_ways_on", "hunted_lead_after"),
)
GHOST_TOKENS = 4  # the nearest ghosts, from the nearest on
_TOKEN = ("there", "distance", "near", "path", "towards", "speed", "arcade", "chase", "other")
GLOBAL_FEATURES = (
    *("clyde_distance", "clyde_near", "closing_speed", "clyde_speed", "v", "omega"),
    *("pellets_left", "last_pellet", "clyde_towards", "pose_age", "nearest_way"),
    *("time_left", "time_short", "coming"),
    *(f"ghost_{k}_{name}" for k in range(GHOST_TOKENS) for name in _TOKEN),
)
_FIRST_TOKEN, _COLUMNS = GLOBAL_FEATURES.index("ghost_0_there"), len(_TOKEN)


class _FillArrays(NamedTuple):
    seen: Any = prediction.SeenArrays
    wanted: Any = Array(np.bool_, "N C")
    candidates: Any = Array(np.float32, f"N C {len(CANDIDATE_FEATURES)}")
    whole: Any = Array(np.float32, f"N {len(GLOBAL_FEATURES)}")
    outlook: Any = Array(np.int64, "1")  # address of the table of OutlookArrays


_arrays = arrays_by_address(_FillArrays)
_outlooks: "weakref.WeakKeyDictionary[LevelSlots, outlook.Outlook]" = weakref.WeakKeyDictionary()


def planner_features(
    situation: Situation, robot_speed_mps: float, listed: NDArray[np.int64] | None = None
) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Candidates (N, C, 32) and globals (N, 50), float32. Raises ValueError for a situation without maps.

    ``listed``: (N, K) the candidates that are wanted, or ``MISSING``; rows of others are 0. None: all.
    """
    maps_wanted(situation)
    candidates = np.empty((*situation.mask.shape, len(CANDIDATE_FEATURES)), dtype=np.float32)
    whole = np.empty((len(candidates), len(GLOBAL_FEATURES)), dtype=np.float32)
    wanted = np.ascontiguousarray(situation.mask if listed is None else among(situation.mask, listed))
    job, tables = planner_stage(situation, robot_speed_mps, wanted, candidates, whole)
    situation.threads.run(job, tables, len(candidates))
    return candidates, whole


def planner_stage(
    situation: Situation,
    robot_speed_mps: float,
    wanted: NDArray[np.bool_],
    candidates: NDArray[np.float32],
    whole: NDArray[np.float32],
) -> Stage:
    """What fills the features of candidates that are ``wanted`` (N, C) from a situation.

    Where a ghost is believed to come for the robot on a map that :func:`maps_wanted` has not made ready since it was
    put into its slot, the stage returns ``NEEDS_MAPS``.
    """
    seen = prediction.seen_arrays(situation, robot_speed_mps)
    arrays = {"seen": seen, "wanted": wanted, "candidates": candidates, "whole": whole}
    assert situation.maps is not None
    most = situation.maps.most_goals
    memory = _outlook_of(situation).memory(most, situation.ghosts.shape[1], situation.threads.number)
    return _fill, [Table(_FillArrays, outlook=own, **arrays) for own in memory]


def _outlook_of(situation: Situation) -> outlook.Outlook:
    levels = situation.maps
    assert levels is not None
    own = _outlooks.get(levels)
    if own is None:
        own = _outlooks[levels] = outlook.Outlook(levels.config)
    return own


def maps_changed(situation: Situation, slots: NDArray[np.integer[Any]]) -> None:
    """Make the maps in ``slots`` ready for the prediction."""
    assert situation.maps is not None
    for level in situation.maps.levels(slots):
        level.add_coarse_steps()


def maps_wanted(situation: Situation) -> None:
    """Make the maps ready on which a ghost comes for the robot."""
    if situation.maps is None:
        raise ValueError("the situation has no maps to look ahead on")
    hunted = comes(situation.belief.T).any(axis=0)
    for level in situation.maps.levels(situation.level[hunted]) if hunted.any() else ():
        add_coarse_map(level)


@kernel
def _describe_ghosts(s, i, level, tokens):  # type: ignore[no-untyped-def]
    """Fill in the tokens of the nearest ghosts, one behind the other."""
    snap, length_cm, affine = level.snap, level.length_cm, level.affine
    x, y = s.robot[i, 0], s.robot[i, 1]
    column, row = cell_of(affine, snap.shape[0], snap.shape[1], x, y)
    here = snap[row, column]
    least, last = -1.0, -1
    for k in range(min(GHOST_TOKENS, s.ghosts.shape[1])):
        best, nearest = np.inf, -1  # the next one: farther than the last, or as far with a greater number
        for j in range(s.ghosts.shape[1]):
            d = math.sqrt((s.ghosts[i, j, 0] - x) ** 2 + (s.ghosts[i, j, 1] - y) ** 2)
            if (d > least or (d == least and j > last)) and d < best:
                best, nearest = d, j
        if nearest < 0:
            break
        least, last = best, nearest
        gx, gy, vx, vy, speed = s.ghosts[i, nearest]
        column, row = cell_of(affine, snap.shape[0], snap.shape[1], gx, gy)
        there = snap[row, column]
        v = math.sqrt(vx * vx + vy * vy)
        t = tokens[k * _COLUMNS : (k + 1) * _COLUMNS]
        t[0], t[1], t[2] = 1.0, min(best, FAR_M) / 5.0, math.exp(-best)
        path = max(0.01 * apart_cm(length_cm[here], length_cm[there]), best)
        t[3] = min(path, FAR_M) / 5.0
        t[4] = (vx * (x - gx) + vy * (y - gy)) / (v * best) if v * best > 1e-6 else 0.0
        t[5] = min(speed / 0.5, 4.0)
        t[6], t[7], t[8] = s.belief[i, nearest, ARCADE], s.belief[i, nearest, CHASES], s.belief[i, nearest, OTHER]


@kernel
def _fill(table, first, last):  # type: ignore[no-untyped-def]
    a = _arrays(table)
    candidates, whole, request = a.candidates, a.whole, a.seen.request[0]
    memory = outlook.outlook_arrays(a.outlook[0])
    s = prediction.seen_by(a.seen)
    room = prediction.room_to_meet(request.goals, s.mask.shape[1])
    meetings = np.empty((s.mask.shape[1], prediction.COLUMNS), np.float32)
    terms = np.empty((s.mask.shape[1], 6))
    hunts = np.zeros((s.mask.shape[1], outlook.COLUMNS), np.float32)
    whole[first:last] = 0.0
    for i in range(first, last):
        wanted = a.wanted[i]
        level = level_arrays(a.seen.levels[s.level[i]])
        prediction.meet(s, level, i, wanted, request.robot_speed, room, True, meetings)
        coming = outlook.coming(s, i)
        if coming > 0:
            if level.later[COARSE_MAP] == 0:
                return NEEDS_MAPS
            outlook.look_ahead(s, i, level, wanted, memory, hunts)
        left_s = max(memory.rules[0].limit_s - s.time_s[i], 0.0)
        whole[i, 11], whole[i, 12], whole[i, 13] = min(left_s / 200.0, 5.0), math.exp(-left_s / 30.0), coming
        _describe_ghosts(s, i, level, whole[i, _FIRST_TOKEN:])
        length_cm, goal_cell = level.length_cm, level.goal_cell
        x, y = s.robot[i, 0], s.robot[i, 1]
        cx, cy = s.clyde[i, 0], s.clyde[i, 1]
        d = math.sqrt((cx - x) ** 2 + (cy - y) ** 2)
        whole[i, 0] = min(d, FAR_M) / 5.0
        whole[i, 1] = math.exp(-d)
        whole[i, 2] = min(max(s.closing_speed[i] / 0.5, -2.0), 2.0)
        whole[i, 3] = min(s.clyde_speed[i] / 0.5, 4.0)
        whole[i, 4] = min(max(s.robot_velocity[i, 0] / 0.3, -MOST), MOST)
        whole[i, 5] = min(max(s.robot_velocity[i, 1] / 2.0, -MOST), MOST)
        whole[i, 6] = min(s.pellets_left[i], 32) / 8.0
        whole[i, 7] = s.pellets_left[i] == 1
        vx, vy = s.clyde_velocity[i, 0], s.clyde_velocity[i, 1]
        v = math.sqrt(vx * vx + vy * vy)
        whole[i, 8] = (vx * (x - cx) + vy * (y - cy)) / (v * d) if v * d > 1e-6 else 0.0
        whole[i, 9] = min(s.pose_age_s[i], 10.0) / 5.0
        shortest = np.inf  # path length to a pellet that may be chosen
        for c in range(s.mask.shape[1]):
            if s.mask[i, c] and s.kind[i, c] == PELLET:
                shortest = min(shortest, s.path_robot[i, c])
        shortest = shortest if math.isfinite(shortest) else 0.0
        whole[i, 10] = min(shortest, FAR_M) / 5.0
        threatened = is_threatening(d, s.closing_speed[i], False, _SCORER)
        score_situation(s.robot[i], s.clyde[i], s.position[i], threatened, False, _SCORER, terms)
        count = s.mask.shape[1]
        for c in range(count):
            f = candidates[i, c]
            f[:] = 0.0
            if not wanted[c]:
                continue
            is_pellet = s.kind[i, c] == PELLET
            f[0], f[1], f[2] = is_pellet, s.kind[i, c] == REFUGE, s.kind[i, c] == HOLD
            f[3] = c == s.current[i]
            own, other = min(s.path_robot[i, c], FAR_M), min(s.path_clyde[i, c], FAR_M)
            if s.kind[i, c] == HOLD:
                other = min(d, FAR_M)
            f[4], f[5] = own / 5.0, math.exp(-own / 2.0)
            f[23] = min(max(s.path_robot[i, c] - shortest, -FAR_M), FAR_M) / 5.0
            f[6], f[7] = other / 5.0, math.exp(-other / 2.0)
            f[8] = min(max((other / max(s.clyde_speed[i], 0.05) - own / request.robot_speed) / 20.0, -2.0), 2.0)
            px, py = s.position[i, c, 0], s.position[i, c, 1]
            f[9] = min(math.sqrt((px - cx) ** 2 + (py - cy) ** 2), FAR_M) / 5.0
            for k in range(3):
                f[10 + k] = meetings[c, k]
            f[13] = min(meetings[c, 3], 10.0) / 3.0
            f[14] = min(meetings[c, 4], 10.0) / 3.0
            f[15], f[16], f[17] = meetings[c, 5], meetings[c, 6], min(meetings[c, 7], 10.0) / 3.0
            if coming > 0:
                h = hunts[c]
                f[24], f[25], f[26] = 1.0, h[outlook.CAUGHT], h[outlook.ARRIVES_S] / 15.0
                f[27], f[28] = min(h[outlook.CLOSEST_M], 5.0) / 3.0, h[outlook.LEAD_M] / 5.0
                f[29], f[30] = min(h[outlook.COLLECTED] / 3.0, MOST), h[outlook.WAYS_ON]
                f[31] = h[outlook.LEAD_AFTER_M] / 5.0
            g = s.goal[i, c]
            if g < 0 or goal_cell[g] < 0:
                continue
            here = goal_cell[g]
            nearest, total, others, around = FAR_M, 0.0, 0, 0
            for k in range(count):
                if s.kind[i, k] != PELLET or not s.mask[i, k] or k == c or s.goal[i, k] < 0:
                    continue
                cm = length_cm[here, s.goal[i, k]]
                metres = FAR_M if cm == UNREACHABLE_CM else min(cm * 0.01, FAR_M)
                nearest = min(nearest, metres)
                total += metres
                others += 1
                around += metres <= _AROUND_M
            f[18] = nearest / 5.0 if others > 0 else 0.0
            f[19] = total / others / 5.0 if others > 0 else 0.0
            f[20] = min(around / 4.0, MOST)
            f[21] = min(level.goal_apart_m[g], 1.0)
            f[22] = min(terms[c, TOTAL], FAR_M) / 5.0 if is_pellet else 0.0
    return 0
