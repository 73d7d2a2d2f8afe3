"""The records that the simulator's kernels work on: one game, one ghost, the constants of a batch.

Fields are named after what they hold; those of a part of the simulator are declared where its rules are.
"""

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
#: What every physics step touches lies together, first: a game's step then needs four cache lines, not eleven.
_HOT = [
    "x",
    "y",
    "vx",
    "vy",
    "body_x",
    "body_y",
    "body_vx",
    "body_vy",
    "force_x",
    "force_y",
    "touch",
    "heading",
    "heading_cos",
    "heading_sin",
    "omega",
    "left",
    "right",
    "error_x",
    "error_y",
    "error_cos",
    "error_sin",
    "step",
    "substep",
    "stage",
    "end",
    "nav_state",
    "nav_points",
    "nav_at",
    "nav_ahead",
    "nav_next",
    "nav_next_step",
    "nav_plan_step",
    "nav_wait_step",
    "nav_no_control_step",
    "nav_clear_step",
    "nav_result",
    "nav_no_path_step",
    "nav_end_x",
    "nav_end_y",
    "speed_limit",
    "clyde_x",
    "clyde_y",
    "odom_x",
    "odom_y",
    "odom_heading",
    "update_distance",
    "update_angle",
    "level",
]
GAME = np.dtype(sorted(_FIELDS, key=lambda f: _HOT.index(f[0]) if f[0] in _HOT else len(_HOT)), align=True)

#: What an endless game keeps when a round follows another.
KEPT_FROM_ROUND_TO_ROUND = (
    "episode_seed",
    "speed_limit",
    "base_clyde_speed",
    "sigma_xy",
    "sigma_heading",
    "update_distance",
    "update_angle",
    "nav_accept_steps",
    "nav_abort_rate",
    "pickup",
    "round",
    "score",
    "tick_pellets",
)
GHOST = np.dtype(GHOST_FIELDS, align=True)

PARAMETERS = np.dtype(
    [
        ("dt", np.float64),
        ("tick_s", np.float64),
        ("ticks_max", np.int64),
        ("substeps", np.int64),  # physics steps of a tick
        ("check_steps", np.int64),
        ("scan_steps", np.int64),
        ("clyde_steps", np.int64),
        ("clyde_period", np.float64),
        ("plan_steps", np.int64),
        ("perfect", np.int64),
        ("use_tf", np.int64),
        ("death", np.float64),
        ("cancel_then_send", np.int64),
        ("lose_on_abort", np.int64),
        ("back_off", np.int64),  # steps
        ("min_dwell", np.int64),  # steps
        ("goal_tolerance", np.float64),
        ("success_distance", np.float64),
        ("unreachable_tolerance", np.float64),
        ("clyde_keepout", np.float64),
        ("inscribed_cm", np.int64),
        ("comfort_cm", np.int64),
        ("open_cm", np.int64),
        ("progress_distance", np.float64),
        ("progress_steps", np.int64),
        ("no_path_steps", np.int64),
        ("no_control_steps", np.int64),
        ("stuck_steps", np.int64),
        ("recovery_steps", np.int64),
        ("omega_max", np.float64),
        ("omega_rate", np.float64),
        ("wheel_max", np.float64),
        ("wheel_rate", np.float64),
        ("half_base", np.float64),
        ("per_base", np.float64),  # 1 / wheel base
        ("mass_rate", np.float64),  # mass / dt
        ("per_mass", np.float64),  # 1 / mass
        ("resolution", np.float64),
        ("pellet_slots", np.int64),
        ("refuge_slots", np.int64),
        ("velocity_actions", np.int64),
        ("arcade_distance", np.float64),
        ("threat_distance", np.float64),
        ("longest", np.int64),  # ticks
        ("threat_longest", np.int64),  # ticks
    ],
    align=True,
)

REWARDS = np.dtype(
    [
        ("tick", np.float64),
        ("pellet", np.float64),
        ("end", np.float64, (5,)),  # by the code of the end; completion also counts for a round that another follows
        ("discount", np.float64),  # of a tick
    ],
    align=True,
)
