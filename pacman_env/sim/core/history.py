"""How the rounds of a batch began and what was decided in them since: enough to play them again."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...config import Config
from . import records

_ROOM = 1024  # decisions to begin with


class RoundSoFar(NamedTuple):
    """One game's round."""

    game: int
    seed: int
    level: int
    began: Any  # the record that the round began with
    decisions: NDArray[Any]  # (T,) or (T, 2)
    ghost_choices: NDArray[np.int16]  # (T, G); (0, G) where no ghost is told where to go


class History:
    """The decisions of N games, by game and tick.

    Attributes:
        decisions: (N, T) int16 candidates or (N, T, 2) float64 velocities; kernels write them.
        ghost_choices: (N, T, G) int16, or (N, 0, G) where no ghost is told where to go.
        began: (N,) records of type ``GAME``.
    """

    def __init__(self, n: int, ghosts: int, told: bool, config: Config) -> None:
        velocity = config.action == "velocity"
        self.decisions = np.zeros((n, _ROOM, 2) if velocity else (n, _ROOM), np.float64 if velocity else np.int16)
        self.ghost_choices = np.zeros((n, _ROOM if told else 0, ghosts), np.int16)
        self.began = np.zeros(n, dtype=records.GAME)
        self._certain = 0  # so many more ticks have room in every game

    def make_room(self, games: NDArray[Any], ticks: int = 1) -> bool:
        """For so many more ticks in every game; True if the arrays are others now."""
        if self._certain >= ticks:
            self._certain -= ticks
            return False
        room, tick = self.decisions.shape[1], int(games["tick"].max())
        longer = tick + ticks > room
        while tick + ticks > room:
            self.decisions = _longer(self.decisions)
            self.ghost_choices = _longer(self.ghost_choices)
            room *= 2
        self._certain = room - tick - ticks
        return longer

    def so_far(self, game: int, record: Any, level: int) -> RoundSoFar:
        """The round that a game is in, whose record is given."""
        ticks = int(record["tick"])
        return RoundSoFar(
            game=game,
            seed=int(record["seed"]),
            level=level,
            began=self.began[game].copy(),
            decisions=self.decisions[game, :ticks].copy(),
            ghost_choices=self.ghost_choices[game, :ticks].copy(),
        )


def _longer(array: NDArray[Any]) -> NDArray[Any]:
    """Twice as long in time."""
    return np.concatenate([array, np.zeros_like(array)], axis=1)
