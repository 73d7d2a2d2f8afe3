"""The handcrafted scorer J of Milestone 3, Algorithm 3, in its deployed and its documented form.

J is a cost in m (``game/goal_cost.py``) and rates pellets only; refuges never win, HOLD only where no pellet may be
chosen. The replan rule exists once, as a kernel over one situation, which the policy runs for each game.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import make_config
from pacman_env.game.goal_cost import (
    DIRECTION,
    DISTANCE,
    RISK,
    SAFE,
    SKIPPED,
    TOTAL,
    ScorerParameters,
    is_threatening,
    score_situation,
    scorer_parameters,
)
from pacman_env.jit import kernel
from pacman_env.policies.base import KIND_NAMES, BasePolicy, Explanation
from pacman_env.sim.observation.situation import HOLD, PELLET, Situation


@kernel
def choose(
    terms: NDArray[np.float64],
    kind: NDArray[np.int8],
    mask: NDArray[np.bool_],
    current: int,
    prefer_safe: bool,
    p: ScorerParameters,
) -> int:
    """The goal of one situation: a pellet, else HOLD, else -1. The first of equals wins.

    Order: the cheapest safe pellet if ``prefer_safe``, the cheapest not skipped, the cheapest of all. The
    current pellet is kept unless the new one costs less by more than the margin.
    """
    best, safe, fallback, hold = -1, -1, -1, -1
    for c in range(terms.shape[0]):
        if kind[c] == HOLD and hold < 0:
            hold = c
        cost = terms[c, TOTAL]
        if kind[c] != PELLET or not mask[c] or not cost < np.inf:
            continue
        if fallback < 0 or cost < terms[fallback, TOTAL]:
            fallback = c
        if terms[c, SKIPPED]:
            continue
        if best < 0 or cost < terms[best, TOTAL]:
            best = c
        if terms[c, SAFE] and (safe < 0 or cost < terms[safe, TOTAL]):
            safe = c
    goal = safe if prefer_safe and safe >= 0 else best if best >= 0 else fallback
    if goal < 0:
        return hold
    pursued = 0 <= current < terms.shape[0] and kind[current] == PELLET and mask[current]
    if pursued and terms[current, TOTAL] <= terms[goal, TOTAL] + p.replan_margin_m:
        return current
    return goal


@kernel
def evaluate_batch(
    robot: NDArray[np.float64],
    clyde: NDArray[np.float64],
    closing_speed: NDArray[np.float64],
    position: NDArray[np.float64],
    kind: NDArray[np.int8],
    mask: NDArray[np.bool_],
    current: NDArray[np.int64],
    was_threatened: NDArray[np.bool_],
    documented: bool,
    p: ScorerParameters,
    terms: NDArray[np.float64],
    threatened: NDArray[np.bool_],
    goal: NDArray[np.int64],
) -> None:
    """Terms (N, C, 6), threat flag (N,) and goal (N,) of every game."""
    for n in range(len(goal)):
        distance = math.hypot(clyde[n, 0] - robot[n, 0], clyde[n, 1] - robot[n, 1])
        threatened[n] = is_threatening(distance, closing_speed[n], was_threatened[n], p)
        score_situation(robot[n], clyde[n], position[n], threatened[n], documented, p, terms[n])
        prefer_safe = threatened[n] and not documented
        goal[n] = choose(terms[n], kind[n], mask[n], current[n], prefer_safe, p)


class ClydeAware(BasePolicy):
    """Milestone 3, Algorithm 3.

    ``deployed`` is what the robot ran: the direction term is the cosine at the robot between Clyde and the
    pellet and spares pellets in a safe direction; while threatened the best safe pellet wins; pellets within
    the death radius of Clyde are left for last. ``documented`` is the milestone's text: the dot product (m2)
    and nothing else. With ``threat_exit_margin_m`` above 0 each game remembers that it was threatened.

    Raises:
        ValueError: an unknown form, or a parameter that is negative or not finite.
        TypeError: an unknown parameter; the known ones are the fields of ``ScorerParameters``.
    """

    def __init__(self, form: Literal["deployed", "documented"] = "deployed", **parameters: float) -> None:
        if form not in ("deployed", "documented"):
            raise ValueError(f"form = {form!r}: must be 'deployed' or 'documented'")
        for name, value in parameters.items():
            if name not in ScorerParameters._fields:
                raise TypeError(f"unknown parameter {name!r}: choose from {', '.join(ScorerParameters._fields)}")
            if not (math.isfinite(value) and value >= 0):
                raise ValueError(f"{name} = {value!r}: must be a finite number of at least 0")
        self.parameters = scorer_parameters(make_config())._replace(**{k: float(v) for k, v in parameters.items()})
        self.form = form
        self.name = "clyde_aware" if form == "deployed" else f"clyde_aware:{form}"
        self._threatened: NDArray[np.bool_] | None = None

    def reset(self, games: NDArray[np.bool_]) -> None:
        """Forget the threat in these games; another number of games forgets all."""
        if self._threatened is None or len(self._threatened) != len(games):
            self._threatened = np.zeros(len(games), np.bool_)
        else:
            self._threatened = self._threatened & ~games

    def scores(self, situation: Situation) -> NDArray[np.float64]:
        """-J for pellets that may be chosen, else -inf."""
        terms, _, _ = self._evaluate(situation)
        allowed = situation.mask & (situation.kind == PELLET)
        return np.where(allowed, -terms[..., TOTAL], -np.inf)

    def select(self, situation: Situation) -> NDArray[np.int64]:
        """(N,) goal; HOLD where no pellet may be chosen.

        Raises:
            ValueError: the number of games changed without a reset while games are remembered.
        """
        _, threatened, goal = self._evaluate(situation)
        if self.parameters.threat_exit_margin_m > 0:
            self._threatened = threatened
        return goal

    def explain(self, situation: Situation) -> Explanation:
        """Per pellet: distance, Clyde risk, direction penalty, total (m), and the flags of the decision."""
        terms, threatened, _ = self._evaluate(situation)
        return [
            [
                self._explain_candidate(int(situation.kind[n, c]), bool(situation.mask[n, c]), terms[n, c])
                | {"threatening": bool(threatened[n])}
                for c in range(terms.shape[1])
            ]
            for n in range(len(situation))
        ]

    @staticmethod
    def _explain_candidate(kind: int, allowed: bool, terms: NDArray[np.float64]) -> dict[str, float | bool | str]:
        common: dict[str, float | bool | str] = {"kind": KIND_NAMES[kind], "allowed": allowed}
        if kind != PELLET:
            return common | {"score": -math.inf}
        return common | {
            "score": -float(terms[TOTAL]) if allowed else -math.inf,
            "distance": float(terms[DISTANCE]),
            "clyde_risk": float(terms[RISK]),
            "direction_penalty": float(terms[DIRECTION]),
            "total": float(terms[TOTAL]),
            "safe": bool(terms[SAFE]),
            "skipped": bool(terms[SKIPPED]),
        }

    def _evaluate(self, situation: Situation) -> tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.int64]]:
        games, candidates = situation.mask.shape
        if self._threatened is None or self.parameters.threat_exit_margin_m == 0:
            was = np.zeros(games, np.bool_)
        elif len(self._threatened) != games:
            raise ValueError(f"{games} games, but {len(self._threatened)} are remembered: call reset first")
        else:
            was = self._threatened
        terms = np.empty((games, candidates, 6))
        threatened = np.empty(games, np.bool_)
        goal = np.empty(games, np.int64)
        evaluate_batch(
            situation.robot,
            situation.clyde,
            situation.closing_speed,
            situation.position,
            situation.kind,
            situation.mask,
            situation.current,
            was,
            self.form == "documented",
            self.parameters,
            terms,
            threatened,
            goal,
        )
        return terms, threatened, goal
