"""The maps of N games: which level each is played on, and the spaces with its walls."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...config import Config
from ...engine.threads import Threads
from ...world.navigation.physics import Spaces
from ..maps.assets import MapAssets
from ..maps.level_source import LevelSource
from ..maps.level_stack import LevelStack
from ..maps.levels_ahead import LevelsAhead

_MOST_AHEAD = 64  # levels, of some 4 MB each
_NONE = -1  # in place of a slot, before the first round


class GameLevels:
    """The slot of each game in a stack of levels, and spaces for robots near walls."""

    def __init__(self, source: LevelSource, config: Config, n: int, threads: Threads) -> None:
        self.source = source
        self.stack = LevelStack(source.first, config, source.slots(n))
        robot = config.robot
        body = {"radius_m": robot.radius_m, "mass_kg": robot.mass_kg, "step_s": config.physics_step_s}
        self.spaces = Spaces(n, len(self.stack), **body)
        self.slots = [_NONE] * n
        self._ahead: LevelsAhead | None = None
        self._threads = threads.number

    def assets_of(self, game: int) -> MapAssets:
        slot = self.slots[game]
        return self.source.first if slot == _NONE else self.stack.assets(slot)

    def expect(self, seeds: NDArray[np.uint64]) -> None:
        levels = dict.fromkeys(self.source.levels_of(seeds).tolist())
        self._prepare_ahead([level for level in levels if not self.stack.has(level)])

    def _prepare_ahead(self, levels: list[int]) -> None:
        if self._ahead is None and len(self.stack) > 1 and self._threads > 1:
            self._ahead = LevelsAhead(self.source, self._threads, min(len(self.slots), _MOST_AHEAD))
        if self._ahead is not None:
            self._ahead.ask(levels)

    def change(self, index: NDArray[np.int64], levels: NDArray[np.int64]) -> None:
        """Put each of the games ``index`` (M,) on another of ``levels`` (M,).

        Raises MapError for a map that cannot be played on; nothing has been changed then.
        """
        missing = [level for level in dict.fromkeys(levels.tolist()) if not self.stack.has(level)]
        if len(missing) > 1:
            self._prepare_ahead(missing)
        prepare = self.source.prepare if self._ahead is None else self._ahead.take
        prepared = {level: prepare(level) for level in missing}
        self.spaces.leave(index)
        for i in index.tolist():
            if self.slots[i] != _NONE:
                self.stack.release(self.slots[i])
        for i, level in zip(index.tolist(), levels.tolist(), strict=True):
            known = self.stack.has(level)
            self.slots[i] = self.stack.take(level, lambda number: prepared.get(number) or self.source.prepare(number))
            if not known:
                self.spaces.forget(self.slots[i])

    def enter(self, index: NDArray[np.int64], records: NDArray[Any]) -> None:
        """Rounds begin in the games ``index`` (M,): write the level's slot and size into their records (M,)."""
        for k, i in enumerate(index.tolist()):
            if self.slots[i] == _NONE:
                self.slots[i] = 0
            assets = self.stack.assets(self.slots[i])
            records[k]["level"] = self.slots[i]
            records[k]["pellets"], records[k]["refuges"] = assets.pellets, assets.refuges
        self.spaces.leave(index)
