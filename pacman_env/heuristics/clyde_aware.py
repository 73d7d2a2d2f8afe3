"""The handcrafted scorer J of Milestone 3, Algorithm 3, in its deployed and its documented form.

J is a cost in m (``game/goal_cost.py``) and rates pellets only; refuges never win, HOLD only where no pellet may be
chosen.
"""

from __future__ import annotations

import math
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import make_config
from pacman_env.game.goal_cost import (
    SAFE,
    SKIPPED,
    TOTAL,
    ScorerParameters,
    is_threatening,
    score_situation,
    scorer_parameters,
)
from pacman_env.jit import kernel
from pacman_env.policies.base import KIND_NAMES, BasePolicy, Explanation, hold_index
from pacman_env.sim.observation.situation import PELLET, Situation

#: Names of the terms of a candidate in an explanation, in the order of their columns.
_TERMS = ("distance", "clyde_risk", "direction_penalty", "total", "safe", "skipped")


@kernel
def rate_batch(
    robot: NDArray[np.float64],
    clyde: NDArray[np.float64],
    closing_speed: NDArray[np.float64],
    position: NDArray[np.float64],
    was_threatened: NDArray[np.bool_],
    documented: bool,
    p: ScorerParameters,
    terms: NDArray[np.float64],
    threatened: NDArray[np.bool_],
) -> None:
    """Terms (N, C, 6) and threat flag (N,) of every game."""
    for n in range(len(robot)):
        distance = math.hypot(clyde[n, 0] - robot[n, 0], clyde[n, 1] - robot[n, 1])
        threatened[n] = is_threatening(distance, closing_speed[n], was_threatened[n], p)
        score_situation(robot[n], clyde[n], position[n], threatened[n], documented, p, terms[n])


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
        terms, _ = self._rate(situation)
        allowed = situation.mask & (situation.kind == PELLET)
        return np.where(allowed, -terms[..., TOTAL], -np.inf)

    def select(self, situation: Situation) -> NDArray[np.int64]:
        """(N,) goal; HOLD where no pellet may be chosen.

        The cheapest safe pellet where the deployed form is threatened, else the cheapest not skipped, else the cheapest
        of all, the first of equals. The current pellet is kept unless the new one costs less by more than the margin.

        Raises:
            ValueError: the number of games changed without a reset while games are remembered.
        """
        terms, threatened = self._rate(situation)
        if self.parameters.threat_exit_margin_m > 0:
            self._threatened = threatened
        total = terms[..., TOTAL]
        cost = np.where(situation.mask & (situation.kind == PELLET) & (total < np.inf), total, np.inf)
        near = np.where(terms[..., SKIPPED] > 0, np.inf, cost)
        safe = np.where((terms[..., SAFE] > 0) & threatened[:, None] & (self.form == "deployed"), near, np.inf)
        games, goal, goal_cost = np.arange(len(cost)), hold_index(situation), np.full(len(cost), -np.inf)
        for costs in (cost, near, safe):  # the last in which there is a pellet
            best = costs.argmin(axis=1)
            found = costs[games, best] < np.inf
            goal, goal_cost = np.where(found, best, goal), np.where(found, costs[games, best], goal_cost)
        current = situation.current
        keep = (current >= 0) & (cost[games, current] <= goal_cost + self.parameters.replan_margin_m)
        return np.where(keep, current, goal)

    def explain(self, situation: Situation) -> Explanation:
        """Per pellet: distance, Clyde risk, direction penalty, total (m), and the flags of the decision."""
        terms, threatened = self._rate(situation)
        reasons = super().explain(situation)
        for row, row_terms, flag in zip(reasons, terms.tolist(), threatened.tolist(), strict=True):
            for reason, values in zip(row, row_terms, strict=True):
                if reason["kind"] == KIND_NAMES[PELLET]:
                    reason.update(zip(_TERMS, [*values[:SAFE], *map(bool, values[SAFE:])], strict=True))
                reason["threatening"] = flag
        return reasons

    def _rate(self, situation: Situation) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """Terms (N, C, 6) and threat flag (N,)."""
        games, candidates = situation.mask.shape
        was = self._threatened
        if was is None or self.parameters.threat_exit_margin_m == 0:
            was = np.zeros(games, np.bool_)
        elif len(was) != games:
            raise ValueError(f"{games} games, but {len(was)} are remembered: call reset first")
        terms, threatened = np.empty((games, candidates, 6)), np.empty(games, np.bool_)
        rate_batch(
            situation.robot,
            situation.clyde,
            situation.closing_speed,
            situation.position,
            was,
            self.form == "documented",
            self.parameters,
            terms,
            threatened,
        )
        return terms, threatened
