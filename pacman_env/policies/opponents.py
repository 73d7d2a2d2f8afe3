"""Policies for ghosts: a pool that draws one of its members for each round, and behaviours as members."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.levels.draws import draw_below
from pacman_env.observations.situation import Situation
from pacman_env.policies.base import BasePolicy, Policy
from pacman_env.sim.ghost_state import AS_BEHAVIOUR, BEHAVIOUR_NAMES, GHOST_CHOICE, choices_of

_OPPONENT = 32  # purpose number of the draw, different from the numbers in pacman_env/rng.py
_SHARES = 1 << 20  # resolution of drawn shares


class BehaviourOpponent(BasePolicy):
    """A behaviour (``wander``, ``arcade``, ``chase``) as policy of a ghost. Raises ValueError for another name."""

    def __init__(self, name: str) -> None:
        self.name = name
        self._number = BEHAVIOUR_NAMES.index(name)

    def select(self, situation: Situation) -> NDArray[Any]:
        """Return choices (N,) of type ``GHOST_CHOICE``: to follow the behaviour."""
        return choices_of(np.full(len(situation.mask), self._number), AS_BEHAVIOUR)


class Opponents(BasePolicy):
    """A pool. One member, drawn from the round's seed in proportion to ``shares``, plays each round.

    Members must not have state. Raises ValueError without members, if the numbers of members and shares differ, for a
    negative share, and if no share is positive.
    """

    name = "opponents"

    def __init__(self, members: Sequence[Policy], shares: Sequence[float]) -> None:
        if not members or len(members) != len(shares):
            raise ValueError(f"{len(members)} members and {len(shares)} shares: must be as many, at least one")
        weights = np.array(shares, dtype=np.float64)
        if not (np.isfinite(weights).all() and (weights >= 0).all() and weights.sum() > 0):
            raise ValueError(f"shares = {list(shares)}: must be at least 0, one of them above")
        self.members = tuple(members)
        self._limits = np.cumsum(weights) / weights.sum()

    def reset(self, games: NDArray[np.bool_], config: Config) -> None:
        """Reset all members for the games (N,) with their configuration."""
        super().reset(games, config)
        for member in self.members:
            member.reset(games, config)

    def drawn(self, seeds: NDArray[np.uint64]) -> NDArray[np.int64]:
        """Return the number (M,) of the member that plays the round of each seed."""
        share = (draw_below(seeds, _OPPONENT, _SHARES) + 0.5) / _SHARES
        return np.minimum(np.searchsorted(self._limits, share, side="right"), len(self.members) - 1)

    def select(self, situation: Situation) -> NDArray[Any]:
        """Return the choices (N,) of the members that play the rounds, of type ``GHOST_CHOICE``."""
        numbers = self.drawn(situation.seed)
        chosen = np.empty(len(numbers), dtype=GHOST_CHOICE)
        for number in np.unique(numbers).tolist():
            rows = np.flatnonzero(numbers == number)
            chosen[rows] = choices_of(self.members[number].select(situation.rows(rows)))
        return chosen
