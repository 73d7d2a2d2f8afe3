"""Gymnasium spaces of the environments, and actions checked against them."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from ..config import Config
from ..game.ghosts import GHOST_NAMES
from ..sim.core.batch import GameBatch
from ..sim.observation.kinds import FLAT, MASK, ObservationPart, bounds
from ..sim.observation.robot_features import FAST_MPS

OBSERVATION = "observation"  # where the mask is beside it
_MANY = 1e9  # rounds, or pellets over all rounds


def observation_space(parts: Mapping[str, ObservationPart], beside: int | None = None) -> spaces.Dict | spaces.Box:
    """Of one game; with the mask of ``beside`` candidates beside it, as PettingZoo's games have it."""
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
    """Of one game: the candidate to drive to, of so many (None: all of the batch's), or v and omega."""
    if batch.config.action == "goal":
        return spaces.Discrete(batch.candidates if candidates is None else candidates)
    if batch.config.action_range == "unit":
        return spaces.Box(-1.0, 1.0, (2,), np.float32)
    robot = batch.config.robot
    high = np.array([robot.wheel_speed_mps, robot.omega_radps], dtype=np.float32)
    return spaces.Box(high * np.array([0, -1], dtype=np.float32), high, dtype=np.float32)


def state_limits(batch: GameBatch) -> dict[str, tuple[float, float]]:
    """Lowest and highest value of each number of the state of a whole game, by its name."""
    known, robot = bounds(batch), batch.config.robot
    x, y, turn, fast = known["x"], known["y"], (-np.pi, np.pi), (-FAST_MPS, FAST_MPS)
    wheels, place = 2 * robot.wheel_speed_mps, (-1.0, float(batch.hold))
    limits = {"x": x, "y": y, "heading": turn, "believed_x": x, "believed_y": y, "believed_heading": turn}
    limits |= {"v": (-wheels, wheels), "omega": (-wheels / robot.wheel_base_m, wheels / robot.wheel_base_m)}
    each = {"x": x, "y": y, "vx": fast, "vy": fast, "speed": (0.0, FAST_MPS), "place": place}
    for ghost in GHOST_NAMES[: batch.ghosts.shape[1]]:
        limits |= {f"{ghost}_{part}": value for part, value in each.items()}
    limits |= {f"pellet_{k}": (0.0, 1.0) for k in range(batch.pellet_slots)}
    return limits | {"goal": place, "time": known["time"], "round": (1.0, _MANY), "score": (0.0, _MANY)}


def velocities(actions: NDArray[np.float64], config: Config) -> NDArray[np.float64]:
    """(N, 2) v in m/s and omega in rad/s from actions in the configured range; the game cuts them to its limits."""
    if config.action_range == "physical":
        return actions
    v, omega = actions.T
    return np.stack([(v + 1.0) / 2.0 * config.robot.wheel_speed_mps, omega * config.robot.omega_radps], axis=1)


def checked_action(space: spaces.Space[Any], action: Any, agent: str = "") -> Any:
    """An action of one game as an int64, or as two float64 (v, omega) of any size; ValueError outside of the space."""
    whole = type(action) is int or isinstance(action, np.integer)
    if whole and isinstance(space, spaces.Discrete) and space.start <= action < space.start + space.n:
        return np.int64(action)
    if isinstance(space, spaces.Box):
        velocities = np.asarray(action)
        if velocities.shape != (2,) or velocities.dtype.kind not in "fiu" or not np.isfinite(velocities).all():
            raise ValueError(f"action {action!r}{agent}: must be two finite numbers, v and omega")
        return velocities.astype(np.float64)
    if not space.contains(action):
        raise ValueError(f"action {action!r}{agent} is not in {space}")
    return np.int64(action)
