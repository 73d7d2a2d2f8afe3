"""The maps of a batch by level: one map for all games, or a level of many for each episode."""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ...config import Config
from .assets import MapAssets, map_assets


class LevelSource(Protocol):
    @property
    def first(self) -> MapAssets: ...  # one of the maps, to size things by
    def slots(self, games: int) -> int: ...  # number of maps that so many games need at once
    def pellet_slots(self, config: Config) -> int: ...  # most pellets on any of the maps
    def refuge_slots(self, config: Config) -> int: ...  # most refuges on any of the maps
    def levels_of(self, seeds: NDArray[np.uint64]) -> NDArray[np.int64]: ...  # (M,) of the episode with each seed
    def prepare(self, level: int) -> MapAssets: ...
    def extent(self) -> tuple[tuple[float, float], tuple[float, float]]: ...  # of x and y of robots and ghosts, m


class FixedMap:
    def __init__(self, assets: MapAssets, config: Config) -> None:
        self.first = assets
        self._config = config

    def __deepcopy__(self, memo: dict[int, Any]) -> FixedMap:
        """Nothing of a map ever changes: a copied environment shares it."""
        return self

    def __getstate__(self) -> tuple[Any, ...]:
        """What the map is made from; all else is computed again or lies in the cache."""
        return self.first.occupancy, self._config, tuple(self.first.grid.home.tolist())

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        occupancy, config, home = state
        self.__init__(map_assets(occupancy, config, home), config)  # type: ignore[misc]

    def slots(self, games: int) -> int:
        return 1

    def pellet_slots(self, config: Config) -> int:
        return self.first.pellets

    def refuge_slots(self, config: Config) -> int:
        return self.first.refuges

    def levels_of(self, seeds: NDArray[np.uint64]) -> NDArray[np.int64]:
        return np.zeros(len(seeds), dtype=np.int64)

    def prepare(self, level: int) -> MapAssets:
        return self.first

    def extent(self) -> tuple[tuple[float, float], tuple[float, float]]:
        grid = self.first.grid
        rows, columns = grid.shape
        corners = [grid.to_world(c, r) for c in (0, columns) for r in (0, rows)]
        places = np.concatenate([np.array(corners), self.first.clyde.position])
        (x0, y0), (x1, y1) = places.min(axis=0).tolist(), places.max(axis=0).tolist()
        return (x0, x1), (y0, y1)
