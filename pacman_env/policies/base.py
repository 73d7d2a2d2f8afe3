"""The one protocol of everything that picks goals, and a base class with what most policies share."""

import inspect
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config, make_config
from pacman_env.policies.asking import checked_scores
from pacman_env.sim.observation.situation import HOLD, Situation

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Kinds = NDArray[np.int8]
Indices = NDArray[np.int64]
#: Per game, per candidate: named terms of the decision, plain Python values.
Explanation = list[list[dict[str, float | bool | str]]]
KIND_NAMES = ("pellet", "refuge", "hold")


class Policy(Protocol):
    """A function from situations to one score per candidate; the goal is the best unmasked candidate."""

    name: str

    def reset(self, games: NDArray[np.bool_], config: Config) -> None:
        """Forget the state of the games that are True, which are played by ``config``; ``games`` is (N,)."""

    def scores(self, situation: Situation) -> NDArray[np.float64]:
        """(N, C), higher is better, -inf: never. Leaves the policy's state alone."""

    def select(self, situation: Situation) -> NDArray[np.int64]:
        """(N,) the goal of each game, replan margin and hysteresis included."""

    def explain(self, situation: Situation) -> Explanation:
        """Why: the terms of each candidate's score. Leaves the policy's state alone."""


def check_reset(policy: Any, name: str) -> None:
    """Raise a ValueError, which names the policy, where ``reset`` is that of 0.10."""
    try:
        inspect.signature(policy.reset).bind("games", "config")
    except TypeError:
        raise ValueError(f"{name}: since 0.11.0 a policy has reset(self, games, config), add the argument") from None


def hold_index(situation: Situation) -> NDArray[np.int64]:
    """(N,) index of the HOLD candidate, -1 where a game has none."""
    hold = situation.kind == HOLD
    return np.where(hold.any(axis=1), hold.argmax(axis=1), -1)


class BasePolicy:
    """A policy without state: a subclass gives ``name`` and ``scores``; N games, C candidates as in :class:`Policy`."""

    name: str
    config = make_config()  #: of the games, from the last reset on

    def reset(self, games: NDArray[np.bool_], config: Config) -> None:
        """Keep the configuration; there is nothing to forget, whichever of the games (N,) begin anew."""
        self.config = config

    def scores(self, situation: Situation) -> NDArray[np.float64]:
        """(N, C), higher is better, -inf: never; here it raises NotImplementedError."""
        raise NotImplementedError(f"{type(self).__name__}.scores")

    def select(self, situation: Situation) -> NDArray[np.int64]:
        """(N,) the unmasked candidate with the highest score, the first of equals; HOLD where none is allowed.

        Raises ValueError for scores of another shape, and for NaN of an unmasked candidate.
        """
        scores = checked_scores(self, self.scores(situation), situation)
        allowed = np.where(situation.mask, scores, -np.inf)
        goal = allowed.argmax(axis=1)
        best = allowed[np.arange(len(goal)), goal]
        return np.where(best > -np.inf, goal, hold_index(situation))

    def explain(self, situation: Situation) -> Explanation:
        """Kind, mask and score of each candidate."""
        columns = situation.kind.tolist(), situation.mask.tolist(), self.scores(situation).tolist()
        return [
            [{"kind": KIND_NAMES[kind], "allowed": may, "score": score} for kind, may, score in zip(*row, strict=True)]
            for row in zip(*columns, strict=True)
        ]
