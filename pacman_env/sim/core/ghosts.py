"""The ghosts of N games: where they are, the paths they are on, and what decides where each of them goes."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...config import Config, ConfigError
from ...engine.arrays import Table, address
from ...engine.bucket_queue import SearchArrays
from ...engine.native import address_of_kernel
from ...game.ghosts import BEHAVIOURS, POLICY, WANDER, Behaviour, find_behaviour
from ..maps.ghost_cells import search_memory
from ..maps.level_stack import LevelStack
from . import records
from .ghost_kernels import GhostArrays, behaviour_kernel

_TABLE = tuple(entry for entry in BEHAVIOURS.values() if entry.target is not None)
BEHAVIOUR_NAMES = tuple(entry.name for entry in _TABLE)
_FROM_OUTSIDE = -1  # in place of the address of a behaviour's kernel


def behaviour_choice(hold: int, number: int) -> int:
    """The choice that lets a ghost sent from outside do in this tick as ``BEHAVIOUR_NAMES[number]`` does."""
    return hold + 1 + number


class Ghosts:
    """The ghosts of N games under one configuration.

    Attributes:
        state: (N, G) records of type ``GHOST``.
        paths: (N, G, L) int32, the cells of the path that each is on.
        obstacles: (N, G, 3) float64, where they are seen, m.
        choices: (N, G) int64, for those sent from outside: a candidate, the last one to wander on, or beyond it the
            number of a behaviour (:func:`behaviour_choice`); written before each tick.
        wander_first: (G,) bool, those that draw targets of their own until they are sent somewhere.
        sent_from_outside: (G,) bool, those whose behaviour is ``policy``.
    """

    def __init__(self, n: int, config: Config) -> None:
        try:
            behaviours = [find_behaviour(name) for name in config.clyde.ghosts]
        except ConfigError as error:
            raise ConfigError(f"clyde.ghosts = {config.clyde.ghosts!r}: {error}") from error
        count = len(behaviours)
        self.state = np.zeros((n, count), dtype=records.GHOST)
        self.paths = np.zeros((n, count, 0), dtype=np.int32)
        self.obstacles = np.zeros((n, count, 3))
        self.choices = np.zeros((n, count), dtype=np.int64)
        self.wander_first = np.array([one.name in (WANDER, POLICY) for one in behaviours])
        self.sent_from_outside = np.array([one.name == POLICY for one in behaviours])
        self._any_sent = bool(self.sent_from_outside.any())
        self._config = config
        self._behaviours = np.zeros((count + len(_TABLE), 2), dtype=np.int64)
        self._constants: list[NDArray[np.float64]] = []
        self._used: dict[int, Callable[[int, int, int], int]] = {}  # kernels by their row
        for k, one in enumerate(behaviours):
            if one.name == POLICY:
                self._behaviours[k, 0] = _FROM_OUTSIDE
            elif one.name != WANDER:
                self._use(k, one)

    def _use(self, row: int, behaviour: Behaviour) -> None:
        self._used[row] = behaviour_kernel(behaviour)
        self._constants.append(np.array(behaviour.constants(self._config), dtype=np.float64))
        self._behaviours[row] = address_of_kernel(self._used[row]), address(self._constants[-1])

    def send(self, choices: NDArray[np.int64] | None) -> None:
        """Set the ``choices`` (N, G) for those sent from outside; None: all wander on.

        Raises ValueError for one that is no choice; nothing has been changed then.
        """
        if not self._any_sent:
            return
        if choices is None:
            self.choices[:] = self._hold
            return
        if choices.shape != self.choices.shape:
            raise ValueError(f"ghost choices of shape {choices.shape}: must be {self.choices.shape}")
        most = behaviour_choice(self._hold, len(BEHAVIOUR_NAMES) - 1)
        bad = np.flatnonzero(((choices < 0) | (choices > most)).any(axis=1))
        if len(bad) > 0:
            raise ValueError(
                f"ghost choices {choices[bad[0]].tolist()} of game {bad[0]}: candidates are 0 to {self._hold}"
            )
        self.choices[:] = choices
        self.compile_choices()

    def compile_choices(self) -> None:
        """Compile the behaviours that ``choices`` ask for."""
        number = int(self.choices.max()) - behaviour_choice(self._hold, 0)
        for k in range(number + 1):
            if self._behaviours[len(self.wander_first) + k, 0] == 0:
                self._use(len(self.wander_first) + k, _TABLE[k])

    def bind(self, levels: LevelStack, hold: int) -> None:
        """Use the arrays of the maps, after they have been made anew; ``hold`` is the last candidate."""
        self._hold = hold
        self._maps = levels.arrays_for(GhostArrays)
        self._searched = self._maps["ghost_xy"].shape[1], levels.longest_ghost_way
        # A ghost that turns round between two cells walks on to the second one first.
        room = max(levels.longest_ghost_way + 1, self.paths.shape[2])
        paths = np.zeros((*self.state.shape, room), dtype=np.int32)
        paths[:, :, : self.paths.shape[2]] = self.paths
        self.paths = paths

    def table(self, games: NDArray[Any], remembered: NDArray[np.int16], parameters: NDArray[Any]) -> Table:
        """What the kernels work on, with scratch memory of its own: one for each thread."""
        return Table(
            GhostArrays,
            games=games,
            ghosts=self.state,
            paths=self.paths,
            obstacles=self.obstacles,
            parameters=parameters,
            choices=self.choices,
            remembered=remembered,
            behaviours=self._behaviours,
            search=SearchArrays(*search_memory(*self._searched)),
            **self._maps,
        )

    def raise_again(self, table: int, game: int) -> None:
        """Raise what a behaviour's function raised in a game."""
        count = len(self.wander_first)
        for k in range(count):
            chosen = int(self.choices[game, k]) - behaviour_choice(self._hold, 0)
            row = k if k in self._used else count + chosen
            if row in self._used and (row == k or chosen >= 0):
                self._used[row](table, game, row * count + k)
        raise RuntimeError(f"a ghost of game {game} could not decide where to go")
