"""Gymnasium spaces of the environments, and checks of actions against them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ..config import Config
from ..game.ghosts import GHOST_NAMES
from ..observations.kinds import FLAT, MASK, ObservationPart, bounds
from ..observations.robot_features import FAST_MPS
from ..sim.batch import GameBatch

OBSERVATION = "observation"  # key of the observation next to a mask
_MANY = 1e9  # upper bound of rounds and of pellets over all rounds


def observation_space(parts: Mapping[str, ObservationPart], beside: int | None = None) -> spaces.Dict | spaces.Box:
    """Return the observation space of one game; ``beside`` is the length of a separate action mask (None: no mask)."""
    if beside is not None:
        mask = spaces.Box(0, 1, (beside,), np.int8)
        return spaces.Dict({OBSERVATION: observation_space(parts), MASK: mask})
    if FLAT in parts:
        part = parts[FLAT]
        return spaces.Box(part.low, part.high, part.shape, np.float32)
    return spaces.Dict(
        {
            key: spaces.MultiBinary(*p.shape) if key == MASK else spaces.Box(p.low, p.high, p.shape, p.dtype)
            for key, p in parts.items()
        }
    )


def action_space(batch: GameBatch, candidates: int | None = None) -> spaces.Discrete | spaces.Box:
    """Return the action space of one game: one of ``candidates`` goals (None: all of the batch), or velocities (2,)."""
    if batch.config.action == "goal":
        return spaces.Discrete(batch.candidates if candidates is None else candidates)
    if batch.config.action_range == "unit":
        return spaces.Box(-1.0, 1.0, (2,), np.float32)
    robot = batch.config.robot
    high = np.array([robot.wheel_speed_mps, robot.omega_radps], dtype=np.float32)
    return spaces.Box(high * np.array([0, -1], dtype=np.float32), high, dtype=np.float32)


def state_limits(batch: GameBatch) -> dict[str, tuple[float, float]]:
    """Return the lowest and highest value of each number of ``state()`` by its name."""
    limit, robot = bounds(batch), batch.config.robot
    x, y, turn, fast = limit["x"], limit["y"], (-np.pi, np.pi), (-FAST_MPS, FAST_MPS)
    wheels, place = 2 * robot.wheel_speed_mps, (-1.0, float(batch.hold))
    limits = {"x": x, "y": y, "heading": turn, "believed_x": x, "believed_y": y, "believed_heading": turn}
    limits |= {"v": (-wheels, wheels), "omega": (-wheels / robot.wheel_base_m, wheels / robot.wheel_base_m)}
    each = {"x": x, "y": y, "vx": fast, "vy": fast, "speed": (0.0, FAST_MPS), "place": place}
    if batch.config.power.pellets > 0:
        power, step_s = batch.config.power, batch.config.physics_step_s
        each |= {"frightened_s": (0.0, power.duration_s + step_s), "away_s": (0.0, power.return_s + step_s)}
    for ghost in GHOST_NAMES[: batch.ghosts.shape[1]]:
        limits |= {f"{ghost}_{part}": value for part, value in each.items()}
    limits |= {f"pellet_{k}": (0.0, 1.0) for k in range(batch.pellet_slots)}
    return limits | {"goal": place, "time": limit["time"], "round": (1.0, _MANY), "score": (0.0, _MANY)}


def velocities(actions: NDArray[np.float64], config: Config) -> NDArray[np.float64]:
    """Scale actions (N, 2) from the configured range to v in m/s and omega in rad/s; the game clips them later."""
    if config.action_range == "physical":
        return actions
    v, omega = actions.T
    return np.stack([(v + 1.0) / 2.0 * config.robot.wheel_speed_mps, omega * config.robot.omega_radps], axis=1)


def checked_action(space: spaces.Space[Any], action: Any, agent: str = "") -> Any:
    """Return a checked action: an int64, or v (m/s) and omega (rad/s) as float64 (2,), which are clipped later.

    Raises ValueError for an action outside the space.
    """
    whole = type(action) is int or isinstance(action, np.integer)
    if whole and isinstance(space, spaces.Discrete) and 0 <= action < space.n:
        return np.int64(action)
    if isinstance(space, spaces.Box):
        velocities = np.asarray(action)
        if velocities.shape != (2,) or velocities.dtype.kind not in "fiu" or not np.isfinite(velocities).all():
            raise ValueError(f"action {action!r}{agent}: must be two finite numbers, v and omega")
        return velocities.astype(np.float64)
    if not space.contains(action):
        raise ValueError(f"action {action!r}{agent} is not in {space}")
    return np.int64(action)


def checked_actions(space: spaces.Space[Any], actions: Any, games: int, agent: str = "") -> NDArray[Any]:
    """Return the actions of all games, int64 (N,) or float64 (N, 2): v and omega without limits.

    Raises ValueError for another shape or dtype, a number outside the space, and numbers that are not finite.
    """
    given, goals = np.asarray(actions), isinstance(space, spaces.Discrete)
    shape, kinds = ((games,), "iu") if goals else ((games, 2), "fiu")
    if given.shape != shape or given.dtype.kind not in kinds:
        expected = f"{games} {'integers' if goals else 'pairs of v and omega'}"
        raise ValueError(f"actions{agent} must be {expected}, got {given.dtype} of shape {given.shape}")
    if isinstance(space, spaces.Discrete):
        bad, rule = (given < 0) | (given >= space.n), f"must be 0 to {space.n - 1}"
    else:
        bad, rule = ~np.isfinite(given).all(axis=1), "must be two finite numbers"
    for game in np.flatnonzero(bad)[:1].tolist():
        raise ValueError(f"action {given[game].tolist()}{agent} in game {game}: {rule}")
    return np.ascontiguousarray(given, dtype=np.int64 if goals else np.float64)
