"""The state of N games: arrays of which row i is game i's, and what can be read from them."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...config import Config
from ...engine.native import zeros
from ...game.decisions import Moment
from . import kernels
from .ghosts import Ghosts
from .ticks import TickArrays

_STATE = (
    *("games", "alive", "waits", "aborts", "paths", "choices", "velocities", "awake"),
    *("since_tick", "since_distance", "since_round"),
    *("reward", "factor", "elapsed_s", "terminated", "truncated"),
)


class GameState:
    """N games under one configuration.

    Candidates are numbered: ``pellet_slots`` pellets, ``refuge_slots`` refuges (those beyond the map's are padding),
    hold.

    Attributes:
        arrays: by name, as :class:`ticks.TickArrays` declares them.
        games: (N,) records of type ``GAME``.
        alive: (N, P) bool, the pellets that are left.
        paths: (N, L, 2) m, the plans that the robots follow.
        reward: (N,) since the last decision; with ``terminated``, ``truncated`` (N,) bool and ``elapsed_s`` (N,).
        completed_s: (N,) how long the round was that was followed by another in the last step.
        summary: (len(SUMMARY), N) int64, written with each situation (``kernels.SUMMARY``).
    """

    def __init__(self, n: int, config: Config, pellet_slots: int, refuge_slots: int) -> None:
        self.n, self.config = n, config
        self.pellet_slots, self.refuge_slots = pellet_slots, refuge_slots
        self.hold = pellet_slots + refuge_slots
        self.candidates = self.hold + 1
        self.substeps = round(config.execution.tick_s / config.physics_step_s)
        self._ghosts = Ghosts(n, config)
        self.arrays = zeros(TickArrays, _STATE, N=n, P=pellet_slots, C=self.candidates)
        self.games, self.alive, self.paths = (self.arrays[name] for name in ("games", "alive", "paths"))
        self.reward, self.elapsed_s = self.arrays["reward"], self.arrays["elapsed_s"]
        self.terminated, self.truncated = self.arrays["terminated"], self.arrays["truncated"]
        self.completed_s = np.zeros(n)
        self.summary = np.zeros((len(kernels.SUMMARY), n), dtype=np.int64)

    @property
    def ghosts(self) -> NDArray[Any]:
        """(N, G) records of type ``GHOST``."""
        return self._ghosts.state

    @property
    def obstacles(self) -> NDArray[np.float64]:
        """(N, G, 3) where the ghosts are seen, m."""
        return self._ghosts.obstacles

    @property
    def bodies(self) -> NDArray[np.float64]:
        """(N, 4) where the robots' bodies are, m, and their velocities, m/s, after the last physics step."""
        return np.stack([self.games[name] for name in ("body_x", "body_y", "body_vx", "body_vy")], axis=1)

    def moment(self, game: int) -> Moment:
        """What :class:`~pacman_env.game.decisions.LastDecision` has to know of one game now."""
        g, time_s = self.games[game], float(self.games["tick"][game]) * self.config.execution.tick_s
        return Moment(time_s, int(g["pursued"]), (int(g["round"]), int(g["collected"])), float(g["distance"]))
