"""The level of each game of a batch; the next levels are prepared during play."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..config import Config
from ..engine.threads import Threads
from ..levels.assets import MapAssets
from ..levels.level_slots import LevelSlots
from ..levels.level_source import LevelSource
from ..levels.levels_ahead import LevelsAhead

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
