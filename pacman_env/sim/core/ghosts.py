"""The ghosts of N games: where they are, the ways they are on, and who decides where each of them goes."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...config import Config, ConfigError
from ...game.ghosts import POLICY, WANDER, find_behaviour
from ..maps.ghost_cells import search_memory
from ..maps.level_stack import LevelStack
from . import ghost_kernels, records


class Ghosts:
    """The ghosts of N games under one configuration.

    Attributes:
        state: (N, G) records of type ``GHOST``.
        paths: (N, G, L) int32, the cells of the way that each is on.
        obstacles: (N, G, 3) float64, where they are seen, m.
        wander_first: (G,) bool, who draws his own targets until he is sent somewhere.
        sent_from_outside: (G,) bool, whose behaviour is ``policy``.
    """

    def __init__(self, n: int, config: Config) -> None:
        """Raises ConfigError for a behaviour that there is not."""
        try:
            behaviours = [find_behaviour(name) for name in config.clyde.ghosts]
        except ConfigError as error:
            raise ConfigError(f"clyde.ghosts = {config.clyde.ghosts!r}: {error}") from error
        self.state = np.zeros((n, len(behaviours)), dtype=records.GHOST)
        self.paths = np.zeros((n, len(behaviours), 0), dtype=np.int32)
        self.obstacles = np.zeros((n, len(behaviours), 3))
        self.wander_first = np.array([one.name in (WANDER, POLICY) for one in behaviours])
        self.sent_from_outside = np.array([one.name == POLICY for one in behaviours])
        self._deciding = [
            (k, ghost_kernels.behaviour_kernel(one), one.constants(config))
            for k, one in enumerate(behaviours)
            if one.name not in (WANDER, POLICY)
        ]
        self._sent = np.flatnonzero(self.sent_from_outside).tolist()

    def bind(self, levels: LevelStack) -> None:
        """Take over the arrays of the maps, after they have been made anew."""
        a = levels.arrays
        self.position = a["ghost_xy"]
        self._ways = tuple(a[f"ghost_{k}"] for k in ("graph", "part", "part_start", "part_cells"))
        self._places = tuple(a[k] for k in ("affine", "ghost_snap", "ghost_place", "ghost_corner", "ghost_xy"))
        self._search = search_memory(self.position.shape[1], levels.longest_ghost_way)
        # A ghost that turns round between two cells walks on to the second one first.
        room = max(levels.longest_ghost_way + 1, self.paths.shape[2])
        paths = np.zeros((*self.state.shape, room), dtype=np.int32)
        paths[:, :, : self.paths.shape[2]] = self.paths
        self.paths = paths

    def decide(
        self,
        games: NDArray[Any],
        choices: NDArray[np.int64] | None,
        remembered: NDArray[np.int16],
        parameters: NDArray[Any],
    ) -> None:
        """Where those who do not just wander go now; ``choices`` (N, G) are for those sent from outside."""
        around = (parameters, self._places, self._ways, self._search)
        for k, follow, constants in self._deciding:
            follow(games, self.state, self.paths, k, constants, *around)
        for k in self._sent:
            ghost_kernels.send_ghosts(games, self.state, self.paths, choices, remembered, k, *around)

    def move(self, games: NDArray[Any], parameters: NDArray[Any]) -> None:
        """One update in the games where it is due."""
        if ghost_kernels.move_ghosts(games, self.state, self.paths, self.obstacles, parameters, self.position):
            ghost_kernels.retarget_ghosts(games, self.state, self.paths, parameters, self._ways, self._search)
