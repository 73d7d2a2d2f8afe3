"""State of N games in arrays with one row per game, and their levels."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...config import Config
from ...engine.arrays import zeros
from ...engine.threads import Threads
from ...game.decisions import Moment
from ..maps.assets import MapAssets
from ..maps.level_slots import LevelSlots
from ..maps.level_source import LevelSource
from ..maps.levels_ahead import LevelsAhead
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
        self.substeps = round(config.execution.tick_s / config.physics_step_s)
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


_MOST_AHEAD = 64  # levels, of about 4 MB each
_NONE = -1  # instead of a slot, before the first round


class GameLevels:
    def __init__(self, source: LevelSource, config: Config, n: int, threads: Threads) -> None:
        self.source = source
        self.levels = LevelSlots(source.slots(n), source.most(config), config)
        if len(self.levels) == 1:
            self.levels.put(0, 0, source.prepare(0))
        self.slots = [_NONE] * n
        self._ahead: LevelsAhead | None = None
        self._threads = threads.number

    def assets_of(self, game: int) -> MapAssets:
        slot = self.slots[game]
        return self.source.first if slot == _NONE else self.levels.level(slot).assets

    def expect(self, seeds: NDArray[np.uint64]) -> None:
        levels = dict.fromkeys(self.source.levels_of(seeds).tolist())
        self._prepare_ahead([level for level in levels if not self.levels.has(level)])

    def _prepare_ahead(self, levels: list[int]) -> None:
        if self._ahead is None and len(self.levels) > 1 and self._threads > 1:
            self._ahead = LevelsAhead(self.source, self._threads, min(len(self.slots), _MOST_AHEAD))
        if self._ahead is not None:
            self._ahead.ask(levels)

    def change(self, index: NDArray[np.int64], levels: NDArray[np.int64]) -> None:
        """Move the games ``index`` (M,) to ``levels`` (M,); a MapError changes nothing."""
        missing = [level for level in dict.fromkeys(levels.tolist()) if not self.levels.has(level)]
        if len(missing) > 1:
            self._prepare_ahead(missing)
        prepare = self.source.prepare if self._ahead is None else self._ahead.take
        prepared = {level: prepare(level) for level in missing}
        for i in index.tolist():
            if self.slots[i] != _NONE:
                self.levels.release(self.slots[i])
        for i, level in zip(index.tolist(), levels.tolist(), strict=True):
            self.slots[i] = self.levels.take(level, lambda number: prepared.get(number) or self.source.prepare(number))

    def enter(self, index: NDArray[np.int64], records: NDArray[Any]) -> None:
        """Write slot and size of the levels to the ``records`` (M,) of the games ``index`` (M,) that start a round."""
        for k, i in enumerate(index.tolist()):
            if self.slots[i] == _NONE:
                self.slots[i] = 0
            facts = self.levels.level(self.slots[i]).facts
            records[k]["level"] = self.slots[i]
            records[k]["pellets"], records[k]["refuges"] = facts.pellets, facts.refuges
