"""The features of a learned planner: numbers per candidate and of the whole, none of which names a particular map.

Built from a situation and its maps, alike in the simulator and on a robot. All are of the order of one; what is
unreachable is far, not infinite. Rows of candidates that may not be chosen are 0. ``VERSION`` changes with the meaning
of any column: a network trained on other columns must not be run on these.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ...engine.jit import kernel
from ...engine.native import Table, address_of, arrays_by_address
from ...game.goal_cost import TOTAL, ScorerParameters, is_threatening, score_situation
from ...world.navigation.paths import UNREACHABLE_CM
from . import prediction
from .situation import HOLD, LAYOUT, PELLET, REFUGE, Situation

VERSION = 3
FAR_M = 20.0
_AROUND_M = 2.5  # pellets within this way are around a place
_SCORER = ScorerParameters()  # the handcrafted one, as deployed

_REAL32 = np.float32
_MAPS = ("length_cm", "goal_cell", "goal_apart_m", *prediction.MAPS)
_MAP_KINDS = ((np.uint16, 3), (np.int32, 2), (_REAL32, 2), *prediction.MAP_KINDS)
_TABLE = (*prediction.PLACES, (np.float64, 1), (_REAL32, 3), (_REAL32, 2))  # the robot's speed, both results
_arrays, _maps, _situation = arrays_by_address(_TABLE), arrays_by_address(_MAP_KINDS), LAYOUT.arrays

CANDIDATE_FEATURES = (
    "is_pellet",
    "is_refuge",
    "is_hold",
    "is_current",
    "path_robot",
    "nearness_robot",
    "path_clyde",
    "nearness_clyde",
    "time_margin",
    "clyde_distance",
    "caught_soon",
    "caught",
    "approached",
    "closest_mean",
    "closest_least",
    "turn_cosine",
    "towards_clyde",
    "standing_clearance",
    "nearest_pellet",
    "mean_pellet",
    "pellets_around",
    "clyde_apart",
    "handcrafted_cost",
    "beyond_nearest",
)
GLOBAL_FEATURES = (
    "clyde_distance",
    "clyde_near",
    "closing_speed",
    "clyde_speed",
    "v",
    "omega",
    "pellets_left",
    "last_pellet",
    "clyde_towards",
    "pose_age",
    "nearest_way",
)


def planner_features(situation: Situation, robot_speed_mps: float) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """Candidates (N, C, 24) and globals (N, 11), float32.

    Raises:
        ValueError: the situation has no maps.
    """
    places = prediction.places_of(situation, _MAP_KINDS, _MAPS)
    candidates = np.empty((*situation.mask.shape, len(CANDIDATE_FEATURES)), dtype=np.float32)
    whole = np.empty((len(candidates), len(GLOBAL_FEATURES)), dtype=np.float32)
    table = Table(_TABLE, (*places, np.array([robot_speed_mps]), candidates, whole))
    situation.threads.run(_fill, [table], len(candidates))
    return candidates, whole


@kernel
def _fill(table, first, last):  # type: ignore[no-untyped-def]
    block, view, speed_mps, candidates, whole = _arrays(table)
    found = _maps(view[prediction.MAPS_AT])
    (lengths, goal_cells, aparts), maps = found[:3], found[3:]
    speed, first_length = speed_mps[0], prediction.LENGTHS_AT
    seen = _situation(address_of(block), view[first_length], view[first_length + 1], view[first_length + 2])
    (
        _, robot, velocity, pose_age, clyde, clyde_velocity, clyde_speed, closing, kind, position, mask,
        path_robot, path_clyde, current, _, _, pellets_left, _, goal, level,
    ) = seen  # fmt: skip
    room = prediction.room_to_meet(maps[3], mask.shape[1])
    meetings = np.empty((mask.shape[1], prediction.COLUMNS), np.float32)
    terms = np.empty((mask.shape[1], 6))
    for i in range(first, last):
        prediction.meet(seen, i, maps, view[prediction.ACROSS], speed, room, meetings)
        length_cm, goal_cell = lengths[level[i]], goal_cells[level[i]]
        x, y = robot[i, 0], robot[i, 1]
        cx, cy = clyde[i, 0], clyde[i, 1]
        d = math.sqrt((cx - x) ** 2 + (cy - y) ** 2)
        whole[i, 0] = min(d, FAR_M) / 5.0
        whole[i, 1] = math.exp(-d)
        whole[i, 2] = min(max(closing[i] / 0.5, -2.0), 2.0)
        whole[i, 3] = min(clyde_speed[i] / 0.5, 4.0)
        whole[i, 4] = velocity[i, 0] / 0.3
        whole[i, 5] = velocity[i, 1] / 2.0
        whole[i, 6] = min(pellets_left[i], 32) / 8.0
        whole[i, 7] = pellets_left[i] == 1
        vx, vy = clyde_velocity[i, 0], clyde_velocity[i, 1]
        v = math.sqrt(vx * vx + vy * vy)
        whole[i, 8] = (vx * (x - cx) + vy * (y - cy)) / (v * d) if v * d > 1e-6 else 0.0
        whole[i, 9] = min(pose_age[i], 10.0) / 5.0
        shortest = np.inf  # way to a pellet that may be chosen
        for c in range(mask.shape[1]):
            if mask[i, c] and kind[i, c] == PELLET:
                shortest = min(shortest, path_robot[i, c])
        shortest = shortest if math.isfinite(shortest) else 0.0
        whole[i, 10] = min(shortest, FAR_M) / 5.0
        threatened = is_threatening(d, closing[i], False, _SCORER)
        score_situation(robot[i], clyde[i], position[i], threatened, False, _SCORER, terms)
        count = mask.shape[1]
        for c in range(count):
            f = candidates[i, c]
            f[:] = 0.0
            if not mask[i, c]:
                continue
            is_pellet = kind[i, c] == PELLET
            f[0], f[1], f[2] = is_pellet, kind[i, c] == REFUGE, kind[i, c] == HOLD
            f[3] = c == current[i]
            mine, his = min(path_robot[i, c], FAR_M), min(path_clyde[i, c], FAR_M)
            if kind[i, c] == HOLD:
                his = min(d, FAR_M)
            f[4], f[5] = mine / 5.0, math.exp(-mine / 2.0)
            f[23] = min(max(path_robot[i, c] - shortest, -FAR_M), FAR_M) / 5.0
            f[6], f[7] = his / 5.0, math.exp(-his / 2.0)
            f[8] = min(max((his / max(clyde_speed[i], 0.05) - mine / speed) / 20.0, -2.0), 2.0)
            px, py = position[i, c, 0], position[i, c, 1]
            f[9] = min(math.sqrt((px - cx) ** 2 + (py - cy) ** 2), FAR_M) / 5.0
            for k in range(3):
                f[10 + k] = meetings[c, k]
            f[13] = min(meetings[c, 3], 10.0) / 3.0
            f[14] = min(meetings[c, 4], 10.0) / 3.0
            f[15], f[16], f[17] = meetings[c, 5], meetings[c, 6], min(meetings[c, 7], 10.0) / 3.0
            g = goal[i, c]
            if g < 0 or goal_cell[g] < 0:
                continue
            here = goal_cell[g]
            nearest, total, others, around = FAR_M, 0.0, 0, 0
            for other in range(count):
                if kind[i, other] != PELLET or not mask[i, other] or other == c or goal[i, other] < 0:
                    continue
                cm = length_cm[here, goal[i, other]]
                metres = FAR_M if cm == UNREACHABLE_CM else min(cm * 0.01, FAR_M)
                nearest = min(nearest, metres)
                total += metres
                others += 1
                around += metres <= _AROUND_M
            f[18] = nearest / 5.0 if others > 0 else 0.0
            f[19] = total / others / 5.0 if others > 0 else 0.0
            f[20] = around / 4.0
            f[21] = min(aparts[level[i], g], 1.0)
            f[22] = min(terms[c, TOTAL], FAR_M) / 5.0 if is_pellet else 0.0
    return 0
