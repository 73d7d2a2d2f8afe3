"""Handcrafted scorer J of Milestone 3, Algorithm 3, in its deployed and its documented form.

J is a cost in m (``game/goal_cost.py``) of pellets. Refuges are never chosen, and HOLD only if no pellet is allowed.
"""

import math
from functools import partial
from typing import Literal

import numpy as np

from ..config import Config
from ..engine.jit import kernel
from ..game.goal_cost import SAFE, SKIPPED, TOTAL, ScorerParameters, is_threatening, score_situation
from ..observations.situation import PELLET, Situation
from ..policies.base import KIND_NAMES, BasePolicy, Explanation, Flags, Floats, Indices, hold_index, require_numbers

#: Names of a candidate's terms in explanations, in the order of their columns.
_TERMS = ("distance", "clyde_risk", "direction_penalty", "total", "safe", "skipped")


@kernel
def rate_batch(
    robot: Floats,
    clyde: Floats,
    closing_speed: Floats,
    position: Floats,
    documented: bool,
    p: ScorerParameters,
    terms: Floats,
    threatened: Flags,
) -> None:
    """Write ``terms`` (N, C, 6) and update the threat flags ``threatened`` (N,); other arrays as in ``Situation``."""
    for n in range(len(robot)):
        distance = math.hypot(clyde[n, 0] - robot[n, 0], clyde[n, 1] - robot[n, 1])
        threatened[n] = is_threatening(distance, closing_speed[n], threatened[n], p)
        score_situation(robot[n], clyde[n], position[n], threatened[n], documented, p, terms[n])


class ClydeAware(BasePolicy):
    """Handcrafted scorer of Milestone 3, Algorithm 3.

    ``deployed`` is the version on the robot. Its direction term uses the cosine at the robot between Clyde and the
    pellet, without a penalty for pellets in a safe direction. Under threat it chooses the best safe pellet; pellets
    within Clyde's death radius come last. ``documented`` is the milestone's text, with only the dot product (m2). With
    ``threat_exit_margin_m`` above 0 each game remembers whether it was threatened. Parameters are the fields of
    ``ScorerParameters``; the default of the death radius is the game's.

    An extension of ``deployed`` for games with power pellets: under threat a power pellet costs ``power_credit_m`` less
    (None: 4 m, and 0 in the documented form). Harmless ghosts are no risk.
    """

    def __init__(
        self,
        form: Literal["deployed", "documented"] = "deployed",
        power_credit_m: float | None = None,
        **parameters: float,
    ) -> None:
        if form not in ("deployed", "documented"):
            raise ValueError(f"form = {form!r}: must be 'deployed' or 'documented'")
        own = {} if power_credit_m is None else {"power_credit_m": power_credit_m}
        for name in parameters.keys() - set(ScorerParameters._fields):
            raise TypeError(f"unknown parameter {name!r}: choose from {', '.join(ScorerParameters._fields)}")
        require_numbers(parameters | own)
        self._given = {name: float(value) for name, value in parameters.items()}
        self.parameters = ScorerParameters(**self._given)
        self.power_credit_m = own.get("power_credit_m", 4.0 if form == "deployed" else 0.0)
        self.form = form
        self.name = "clyde_aware" if form == "deployed" else f"clyde_aware:{form}"
        self._threatened: Flags | None = None

    def reset(self, games: Flags, config: Config) -> None:
        """Clear the threat flags of the games in the mask (N,); clear all flags if the number of games changed."""
        super().reset(games, config)
        game = {"death_radius_m": config.execution.death_radius_m}
        self.parameters = ScorerParameters(**{**game, **self._given})
        if self._threatened is None or len(self._threatened) != len(games):
            self._threatened = np.zeros(len(games), np.bool_)
        else:
            self._threatened = self._threatened & ~games

    def scores(self, situation: Situation) -> Floats:
        """Return -J (N, C) for allowed pellets, and -inf for other candidates."""
        terms, _ = self._rate(situation)
        allowed = situation.mask & (situation.kind == PELLET)
        return np.where(allowed, -terms[..., TOTAL], -np.inf)

    def select(self, situation: Situation) -> Indices:
        """Return the goal (N,) of each game; HOLD if no pellet is allowed."""
        terms, threatened = self._rate(situation)
        if self.parameters.threat_exit_margin_m > 0:
            self._threatened = threatened
        safe_first = threatened & (self.form == "deployed")
        return _choose(terms, situation, safe_first, self.parameters.replan_margin_m)

    def explain(self, situation: Situation) -> Explanation:
        """Return distance, Clyde risk, direction penalty and total (m) of each pellet, and flags of the decision."""
        terms, threatened = self._rate(situation)
        reasons = super().explain(situation)
        for row, row_terms, flag in zip(reasons, terms.tolist(), threatened.tolist(), strict=True):
            for reason, values in zip(row, row_terms, strict=True):
                if reason["kind"] == KIND_NAMES[PELLET]:
                    reason.update(zip(_TERMS, [*values[:SAFE], *map(bool, values[SAFE:])], strict=True))
                reason["threatening"] = flag
        return reasons

    def _rate(self, situation: Situation) -> tuple[Floats, Flags]:
        """Return the terms (N, C, 6) and threat flags (N,)."""
        games, candidates = situation.mask.shape
        threatened, remembered = np.zeros(games, np.bool_), self._threatened
        if remembered is not None and self.parameters.threat_exit_margin_m > 0:
            if len(remembered) != games:
                raise ValueError(f"{games} games, but {len(remembered)} are remembered: call reset first")
            threatened[:] = remembered
        terms = np.empty((games, candidates, 6))
        s, documented = situation, self.form == "documented"
        rate_batch(s.robot, s.clyde, s.closing_speed, s.position, documented, self.parameters, terms, threatened)
        terms[..., TOTAL] -= self.power_credit_m * (threatened[:, None] & s.is_power)
        return terms, threatened


def _choose(terms: Floats, situation: Situation, safe_first: Flags, margin_m: float) -> Indices:
    """Return the goal (N,) of every game: a pellet, else HOLD, else -1; the first one in a tie.

    The goal is the cheapest safe pellet if ``safe_first`` (N,) and there is one, else the cheapest pellet that is not
    skipped, else the cheapest pellet. The current pellet stays unless the new one is cheaper by more than the margin.
    """
    current, games = situation.current, np.arange(len(terms))
    pellet = (situation.kind == PELLET) & situation.mask
    costs = np.where(pellet & (terms[..., TOTAL] < np.inf), terms[..., TOTAL], np.inf)  # (N, C)
    unskipped = np.where(terms[..., SKIPPED] > 0, np.inf, costs)
    safe = np.where((terms[..., SAFE] > 0) & safe_first[:, None], unskipped, np.inf)
    goal = hold_index(situation)
    for allowed in (costs, unskipped, safe):  # the last array with an allowed pellet decides
        best = allowed.argmin(axis=1)
        goal = np.where(allowed[games, best] < np.inf, best, goal)
    pursues = (current >= 0) & (goal >= 0) & pellet[games, current] & pellet[games, goal]
    return np.where(pursues & (costs[games, current] <= costs[games, goal] + margin_m), current, goal)


documented = partial(ClydeAware, form="documented")
