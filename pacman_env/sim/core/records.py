"""The records of one game and one ghost; fields of a part of the simulator are declared where its rules are."""

from __future__ import annotations

import dataclasses

import numpy as np

from ...game.execution import Execution
from ...game.ghosts import GHOST_FIELDS
from ...world.navigation.localization import LOCALIZATION_FIELDS
from ...world.navigation.navigator import NAVIGATOR_FIELDS
from ...world.navigation.physics import BODY_FIELDS

#: The record of Algorithm 4, whose time is in physics steps here.
EXECUTION = tuple(field.name for field in dataclasses.fields(Execution))
_FIELDS = [
    *NAVIGATOR_FIELDS,
    *LOCALIZATION_FIELDS,
    *BODY_FIELDS,
    ("seed", np.uint64),  # of this round
    ("episode_seed", np.uint64),  # of the first one
    ("step", np.int32),  # physics steps done in this round
    ("substep", np.int32),  # physics steps done in this tick
    ("stage", np.int32),  # what comes next in this tick (ticks.py)
    ("tick", np.int32),  # decisions done in this round
    *((name, np.float64 if name == "pickup" else np.int32) for name in EXECUTION),
    ("tick_pellets", np.int32),  # collected in the last tick
    ("tick_rounds", np.int32),  # rounds completed in the last tick that others follow
    ("round", np.int32),  # from 1
    ("score", np.int32),  # pellets over all rounds
    ("level", np.int32),  # which of the stacked maps
    ("refuges", np.int32),  # goals of that map, after its pellets
    ("base_clyde_speed", np.float64),  # of round 1, m/s
    ("clyde_speed", np.float64),  # of this round
    ("command_v", np.float64),  # asked for by a velocity action, m/s
    ("command_w", np.float64),  # rad/s
    ("distance", np.float64),  # believed distance to the nearest ghost at the last decision, m
    ("closing", np.float64),  # m/s
]
#: What every physics step touches lies together, first: four cache lines, not eleven (6 % of the decisions per second).
_HOT = (
    *("x", "y", "vx", "vy", "body_x", "body_y", "body_vx", "body_vy", "force_x", "force_y", "touch"),
    *("heading", "heading_cos", "heading_sin", "omega", "left", "right"),
    *("error_x", "error_y", "error_cos", "error_sin", "step", "substep", "stage", "end"),
    *("nav_state", "nav_points", "nav_at", "nav_ahead", "nav_next", "nav_next_step", "nav_plan_step", "nav_wait_step"),
    *("nav_no_control_step", "nav_clear_step", "nav_result", "nav_no_path_step", "nav_end_x", "nav_end_y"),
    *("speed_limit", "clyde_x", "clyde_y", "odom_x", "odom_y", "odom_heading"),
    *("update_distance", "update_angle", "level"),
)
GAME = np.dtype(sorted(_FIELDS, key=lambda f: _HOT.index(f[0]) if f[0] in _HOT else len(_HOT)), align=True)
GHOST = np.dtype(GHOST_FIELDS, align=True)
#: Of the last decision in a game: it decides when the next is due.
LAST_DECISION = np.dtype(
    [
        ("awake", np.uint8),  # ASLEEP, ONE_TICK or UNTIL_DUE (ticks.py)
        ("tick", np.int32),
        ("round", np.int32),
        ("distance", np.float64),  # m, to the nearest ghost
        ("factor", np.float64),  # the next tick's discount
    ],
    align=True,
)
