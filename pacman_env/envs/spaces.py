"""Gymnasium spaces of the environments, from the columns that the observation names."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium import spaces

from ..sim.core.batch import GameBatch
from ..sim.observation.observer import CHANNELS
from ..sim.observation.planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES
from ..sim.observation.robot_features import (
    CANDIDATE_COLUMNS,
    CLYDE_COLUMNS,
    FAST_MPS,
    GHOST_COLUMNS,
    ROBOT_COLUMNS,
    ROUND_COLUMNS,
)

Columns = tuple[tuple[str, float, float, str], ...]
_BELIEF_MARGIN_M = 2.0  # how far a believed pose may lie outside the played part of the map ...
_MANY = 1e9  # rounds, or pellets over all rounds
_BELIEF_MARGIN_SIGMAS = 9  # ... or this many standard deviations: a draw of 53 bits is off by 8.6 at most


def _bounds(batch: GameBatch) -> dict[str, tuple[float, float]]:
    """Bounds of the columns that depend on the map or the configuration."""
    xs, ys = batch.source.extent()
    sigma = max(batch.config.localization.sigma_xy_m, (batch.config.randomize.sigma_xy_m or (0.0, 0.0))[1])
    margin = max(_BELIEF_MARGIN_M, _BELIEF_MARGIN_SIGMAS * sigma)
    return {
        "x": (xs[0] - margin, xs[1] + margin),
        "y": (ys[0] - margin, ys[1] + margin),
        "time": (0.0, batch.config.time_limit_s + batch.config.execution.tick_s),
        "pellets_left": (0.0, float(batch.pellet_slots)),
    }


def _box(columns: Columns, bounds: dict[str, tuple[float, float]], rows: int | None = None) -> spaces.Box:
    limits = [bounds.get(name, (low, high)) for name, low, high, _ in columns]
    low, high = np.array(limits, dtype=np.float32).T
    if rows is not None:
        low, high = np.tile(low, (rows, 1)), np.tile(high, (rows, 1))
    return spaces.Box(low, high, dtype=np.float32)


def _features(batch: GameBatch) -> dict[str, spaces.Space[Any]]:
    bounds, ghosts = _bounds(batch), len(batch.config.clyde.ghosts)
    parts: dict[str, spaces.Space[Any]] = {
        "robot": _box(ROBOT_COLUMNS, bounds),
        "clyde": _box(CLYDE_COLUMNS, bounds),
        "candidates": _box(CANDIDATE_COLUMNS, bounds, batch.candidates),
        "round": _box(ROUND_COLUMNS, bounds),
    }
    if ghosts > 1:
        parts["ghosts"] = _box(GHOST_COLUMNS, bounds, ghosts)
    return parts


def planner_spaces(candidates: int) -> dict[str, spaces.Space[Any]]:
    """Of the learned planner's features (``sim/observation/planner_features.py``)."""
    return {
        "planner_candidates": spaces.Box(-10.0, 10.0, (candidates, len(CANDIDATE_FEATURES)), np.float32),
        "planner_globals": spaces.Box(-50.0, 50.0, (len(GLOBAL_FEATURES),), np.float32),
    }


def observation_space(batch: GameBatch) -> spaces.Dict:
    """Of one game."""
    kinds = batch.config.observation
    parts = _features(batch) if kinds.features else {}
    if kinds.planner:
        parts |= planner_spaces(batch.candidates)
    if batch.config.action == "goal":
        parts["action_mask"] = spaces.MultiBinary(batch.candidates)
    if kinds.scan:
        parts["scan"] = spaces.Box(kinds.scan_minimum_m, kinds.scan_maximum_m, (kinds.scan_rays,), np.float32)
    if kinds.grid:
        parts["grid"] = spaces.Box(0, 255, (kinds.grid_pixels, kinds.grid_pixels, CHANNELS), np.uint8)
    return spaces.Dict(parts)


def action_space(batch: GameBatch) -> spaces.Discrete | spaces.Box:
    """Of one game: the candidate to drive to, or v in m/s and omega in rad/s."""
    if batch.config.action == "goal":
        return spaces.Discrete(batch.candidates)
    robot = batch.config.robot
    high = np.array([robot.wheel_speed_mps, robot.omega_radps], dtype=np.float32)
    return spaces.Box(high * np.array([0, -1], dtype=np.float32), high, dtype=np.float32)


def ghost_observation_space(batch: GameBatch) -> spaces.Dict:
    """Of one ghost: the features, and his mask."""
    return spaces.Dict({**_features(batch), "action_mask": spaces.MultiBinary(batch.candidates)})


def state_space(batch: GameBatch) -> spaces.Box:
    """Of the whole game, the numbers of ``PacManBotParallelEnv.state_names``."""
    bounds, robot = _bounds(batch), batch.config.robot
    x, y, turn = bounds["x"], bounds["y"], (-np.pi, np.pi)
    wheels = 2 * robot.wheel_speed_mps
    limits = [x, y, turn, x, y, turn, (-wheels, wheels), (-wheels / robot.wheel_base_m, wheels / robot.wheel_base_m)]
    fast = (-FAST_MPS, FAST_MPS)
    place = (-1.0, float(batch.hold))
    limits += [x, y, fast, fast, (0.0, FAST_MPS), place] * batch.ghosts.shape[1] + [(0.0, 1.0)] * batch.pellet_slots
    low, high = np.array([*limits, place, bounds["time"], (1.0, _MANY), (0.0, _MANY)]).T
    return spaces.Box(low, high, dtype=np.float64)


def checked_action(space: spaces.Space[Any], action: Any, who: str = "") -> Any:
    """An action as the game takes it: an int64, or two float64 (v, omega).

    Raises:
        ValueError: it is not in the space; but velocities beyond the limits are cut to them by the game.
    """
    if isinstance(space, spaces.Box):
        velocities = np.asarray(action)
        if velocities.shape != (2,) or velocities.dtype.kind not in "fiu" or not np.isfinite(velocities).all():
            raise ValueError(f"action {action!r}{who}: must be two finite numbers, v in m/s and omega in rad/s")
        return velocities.astype(np.float64)
    if not space.contains(action) and not (
        isinstance(action, np.ndarray) and action.shape == () and space.contains(action[()])
    ):
        raise ValueError(f"action {action!r}{who} is not in {space}")
    return np.int64(action)


def ghost_action_space(batch: GameBatch) -> spaces.Discrete:
    """Of one ghost: the candidate to whose place he goes, or to wander on."""
    return spaces.Discrete(batch.candidates)
