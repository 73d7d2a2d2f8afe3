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
_NONE = -1  # instead of a slot or level, before the first round


class GameLevels:
    def __init__(self, source: LevelSource, config: Config, n: int, threads: Threads) -> None:
        self.source = source
        self.levels = LevelSlots(source.slots(n), source.most(config), config)
        if len(self.levels) == 1:
            self.levels.put(0, 0, source.prepare(0))
        self.slots = np.full(n, _NONE, dtype=np.int64)  # of each game
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
        """Move the games ``index`` (M,) to ``levels`` (M,), -1 for none; a MapError changes nothing."""
        if len(self.levels) == 1:
            self.slots[index] = np.minimum(levels, 0)
            return
        games = {level: index[levels == level] for level in dict.fromkeys(levels.tolist()) if level != _NONE}
        missing = [level for level in games if not self.levels.has(level)]
        if len(missing) > 1:
            self._prepare_ahead(missing)
        prepare = self.source.prepare if self._ahead is None else self._ahead.take
        prepared = {level: prepare(level) for level in missing}
        for slot in self.slots[index].tolist():
            if slot != _NONE:
                self.levels.release(slot)
        self.slots[index] = _NONE
        for level in sorted(games, key=prepared.__contains__):  # first reserve the slots that have their levels
            self.slots[games[level]] = self.levels.take(level, prepared.__getitem__, len(games[level]))

    def enter(self, index: NDArray[np.int64], records: NDArray[Any]) -> None:
        """Write slot and size of the levels to the ``records`` (M,) of the games ``index`` (M,) that start a round."""
        for k, slot in enumerate(self.slots[index].tolist()):
            facts = self.levels.level(slot).facts
            records[k]["level"] = slot
            records[k]["pellets"], records[k]["refuges"] = facts.pellets, facts.refuges
