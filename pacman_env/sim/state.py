"""State of N games in arrays with one row per game."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..config import Config
from ..engine.arrays import zeros
from ..game.decisions import Moment
from . import kernels
from .ghost_state import Ghosts
from .ticks import TickArrays

_OWN_RULES = "games", "alive", "waits", "aborts"  # fields of ``kernels.RuleArrays`` with a row for each game


class GameState:
    """Arrays of N games under one configuration.

    Attributes:
        rules: arrays by name, declared in :class:`kernels.RuleArrays`.
        arrays: arrays by name, declared in :class:`ticks.TickArrays`.
        games: (N,) records of type ``GAME``.
        alive: (N, P) bool, the remaining pellets.
        paths: (N, L, 2) m, the plans that the robots follow.
        reward: (N,) since the last decision; with ``terminated``, ``truncated`` (N,) bool and ``elapsed_s`` (N,).
        completed_s: (N,) duration in s of a round that was completed in the last step of an endless game, else 0.
        summary: (len(SUMMARY), N) int64, written with each situation (``kernels.SUMMARY``).
    """

    def __init__(self, n: int, config: Config, pellet_slots: int, refuge_slots: int) -> None:
        self.n, self.config = n, config
        self.pellet_slots, self.refuge_slots = pellet_slots, refuge_slots
        self.hold = pellet_slots + refuge_slots
        self.candidates = self.hold + 1
        self._ghosts = Ghosts(n, config)
        self.rules = zeros(kernels.RuleArrays, _OWN_RULES, N=n, P=pellet_slots, C=self.candidates)
        self.games, self.alive = self.rules["games"], self.rules["alive"]
        results = "reward", "elapsed_s", "terminated", "truncated"
        self.arrays = zeros(TickArrays, ("last_decision", "paths", "choices", "velocities", *results), N=n)
        self.paths = self.arrays["paths"]
        self.reward, self.elapsed_s, self.terminated, self.truncated = (self.arrays[name] for name in results)
        self.completed_s = np.zeros(n)
        self.summary = np.zeros((len(kernels.SUMMARY), n), dtype=np.int64)

    @property
    def ghosts(self) -> NDArray[Any]:
        """Records (N, G) of type ``GHOST``."""
        return self._ghosts.state

    @property
    def ghost_paths(self) -> NDArray[np.int32]:
        """Cells (N, G, L) of each ghost's path."""
        return self._ghosts.paths

    @property
    def obstacles(self) -> NDArray[np.float64]:
        """Observed positions (m) and times of the ghosts (N, G, 5), see ``kernels.RuleArrays``."""
        return self._ghosts.obstacles

    @property
    def bodies(self) -> NDArray[np.float64]:
        """Positions (m) and velocities (m/s) of the robots' bodies (N, 4) after the last physics step."""
        return np.stack([self.games[name] for name in ("body_x", "body_y", "body_vx", "body_vy")], axis=1)

    def moment(self, game: int) -> Moment:
        """Return the present moment of a game for :class:`~pacman_env.game.decisions.LastDecision`."""
        g, time_s = self.games[game], float(self.games["tick"][game]) * self.config.execution.tick_s
        news = int(g["round"]), int(g["collected"]), int(g["caught"])
        return Moment(time_s, int(g["pursued"]), news, float(g["distance"]))

    def state(self) -> dict[str, NDArray[Any]]:
        """Return all arrays that a step reads and changes, by name, with a row for each game; levels are by slot."""
        ghosts = {f"ghost_{name}": getattr(self._ghosts, name) for name in ("state", "paths", "obstacles")}
        return {**self.rules, **self.arrays, **ghosts, "completed_s": self.completed_s, "summary": self.summary.T}
