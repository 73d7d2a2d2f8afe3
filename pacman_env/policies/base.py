"""Protocol of policies, which choose goals, and a base class for most of them."""

import math
from collections.abc import Collection, Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config, make_config
from pacman_env.observations.situation import HOLD, Situation
from pacman_env.policies.policy_calls import checked_scores

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Indices = NDArray[np.int64]
#: Named terms of the decision per game and candidate, as plain Python values.
Explanation = list[list[dict[str, float | bool | str]]]
KIND_NAMES = ("pellet", "refuge", "hold")


class Policy(Protocol):
    """A function from situations to one score per candidate; the goal is the best allowed candidate."""

    name: str

    def reset(self, games: NDArray[np.bool_], config: Config) -> None:
        """Forget the state of the games that are True in ``games`` (N,), which will be played with ``config``."""

    def scores(self, situation: Situation) -> NDArray[np.float64]:
        """Return scores (N, C), higher is better, -inf for never; must not change the policy's state."""

    def select(self, situation: Situation) -> NDArray[np.int64]:
        """Return the chosen candidate (N,) of each game; a policy may favour its current goal over a better score."""

    def explain(self, situation: Situation) -> Explanation:
        """Return the terms of each score as dicts [game][candidate]; must not change the policy's state."""


def require_numbers(parameters: Mapping[str, float], above_0: Collection[str] = ()) -> None:
    """Raise ValueError for a parameter of a policy that is not finite or below 0, or 0 if it is among ``above_0``."""
    for name, value in parameters.items():
        least = "above" if name in above_0 else "of at least"
        if not 0 <= value < math.inf or (name in above_0 and value == 0):
            raise ValueError(f"{name} = {value!r}: must be a finite number {least} 0")


def hold_index(situation: Situation) -> NDArray[np.int64]:
    """Return the index (N,) of the HOLD candidate of each game, -1 if there is none."""
    hold = situation.kind == HOLD
    return np.where(hold.any(axis=1), hold.argmax(axis=1), -1)


def reach(situation: Situation, candidate: int, robot_mps: float) -> dict[str, float]:
    """Return how far a candidate of the first game is (m), and how much later the nearest ghost can be there (s)."""
    robot_m, ghost_m = float(situation.path_robot[0, candidate]), float(situation.path_clyde[0, candidate])
    ghost_mps = float(situation.clyde_speed[0])  # 0 while all ghosts are harmless
    later_s = ghost_m / ghost_mps - robot_m / robot_mps if ghost_mps else math.inf
    return {"robot_m": round(robot_m, 2), "ghost_later_s": round(later_s, 1)}


class BasePolicy:
    """A policy without state; subclasses define ``name`` and ``scores``. Arrays are for N games with C candidates."""

    name: str
    config = make_config()  #: configuration of the games, set by the last reset

    def reset(self, games: NDArray[np.bool_], config: Config) -> None:
        """Store the configuration; this policy has no state of the games (N,) to forget."""
        self.config = config

    def scores(self, situation: Situation) -> NDArray[np.float64]:
        """Return scores (N, C), higher is better, -inf for never; the base class raises NotImplementedError."""
        raise NotImplementedError(f"{type(self).__name__}.scores")

    def select(self, situation: Situation) -> NDArray[np.int64]:
        """Return the allowed candidate (N,) with the highest score, the first one in a tie; HOLD if none is allowed.

        Raises ValueError for scores of another shape, and for NaN of an allowed candidate.
        """
        scores = checked_scores(self, self.scores(situation), situation)
        allowed = np.where(situation.mask, scores, -np.inf)
        goal = allowed.argmax(axis=1)
        best = allowed[np.arange(len(goal)), goal]
        return np.where(best > -np.inf, goal, hold_index(situation))

    def explain(self, situation: Situation) -> Explanation:
        """Return kind, mask value and score of each candidate as dicts [game][candidate]."""
        columns = situation.kind.tolist(), situation.mask.tolist(), self.scores(situation).tolist()
        return [
            [{"kind": KIND_NAMES[kind], "allowed": may, "score": score} for kind, may, score in zip(*row, strict=True)]
            for row in zip(*columns, strict=True)
        ]
