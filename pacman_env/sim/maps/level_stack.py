"""The maps of a batch, stacked into one array per kind for the kernels; one map for all is stacked without copying."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...config import Config
from ...engine.arrays import Array, Table
from ...world.navigation.paths import TILE, coarse_steps
from ...world.navigation.physics import clear_cells
from .assets import MapAssets, are_sent

_SPARE = 1.5  # room for larger maps; memory counts when it is written to
_PADDED = ("snap", "clearance_cm", "clear", "ghost_snap")  # looked up by position
_VARIES = {"neighbours": 1, "cell_xy": 1, "goal_xy": 1, "plan_end": 1, "ghost_graph": 1, "ghost_xy": 1}
_FIXED = ("affine", "shape", "home", "goal_count", "spawn_count", "ghost_corner", "corner_drive")


def _kinds(assets: MapAssets, config: Config) -> dict[str, NDArray]:
    grid, clyde = assets.grid, assets.clyde
    # NavFn moves a goal that the robot cannot come near to the nearest place where it can be.
    nearest = assets.cell_xy[assets.goal_cell].astype(np.float64)
    off = np.hypot(*(nearest - assets.goal_xy).T)
    moved = (assets.goal_cell >= 0) & (off > config.execution.pickup_radius_m)
    kinds: dict[str, NDArray] = {
        "affine": grid.affine,
        "shape": np.array(grid.shape, dtype=np.int32),
        "snap": grid.snap,
        "neighbours": grid.neighbours[:, ::2],  # the 8 around a cell
        "cell_xy": assets.cell_xy,
        "length_cm": assets.length_cm,
        "next_step": assets.next_step,
        "clearance_cm": grid.clearance_cm,
        "clear": clear_cells(grid.walls, grid.affine, grid.shape, grid.resolution, config.robot.radius_m),
        "goal_xy": assets.goal_xy,
        "goal_cell": assets.goal_cell,
        "goal_apart_m": assets.goal_apart_m,
        "goal_count": np.array(len(assets.goal_xy), dtype=np.int32),
        "plan_end": np.where(moved[:, None], nearest, assets.goal_xy),
        "home": grid.home,
        "spawn_cells": assets.spawn_cells,
        "spawn_count": np.array(len(assets.spawn_cells), dtype=np.int32),
        "ghost_graph": clyde.graph,
        "ghost_part": clyde.part,
        "ghost_part_start": clyde.part_start,
        "ghost_part_cells": clyde.part_cells,
        "ghost_xy": clyde.position,
        "ghost_drive": assets.clyde_drive,
        "ghost_place": np.zeros(1, dtype=np.int32),
        "ghost_snap": np.zeros((1, 1), dtype=np.int32),
        "ghost_corner": assets.ghost_corner,
        "corner_drive": assets.clyde_drive[assets.ghost_corner],
    }
    if are_sent(config.clyde):
        targets = assets.ghost_targets
        kinds |= {"ghost_place": targets.place, "ghost_snap": targets.snap}
    return kinds


def _room(name: str, shape: tuple[int, ...], before: tuple[int, ...]) -> tuple[int, ...]:
    if name in _FIXED:
        return shape
    free = _VARIES.get(name, len(shape))  # axes that differ from map to map
    wanted = (*(math.ceil(n * _SPARE) for n in shape[:free]), *shape[free:])
    return tuple(map(max, wanted, before)) if before else wanted


class LevelStack:
    """S slots for maps; ``arrays[kind]`` is (S, ...) with the map of slot s in row s, padded at the far ends.

    A map lies in its slot while a game is played on it, and until another needs the slot.
    """

    def __init__(self, first: MapAssets, config: Config, slots: int = 1) -> None:
        self.config = config
        self.slots = slots
        self.resolution = first.grid.resolution
        self.longest_way_cm = 0  # of any goal, on any map so far
        self.longest_ghost_way = 0  # cells
        self.version = 0  # grows when the arrays are replaced by larger ones
        self._assets: list[MapAssets | None] = [None] * slots
        self.numbers = np.full(slots, -1, dtype=np.int64)  # the level in each slot
        self._users = np.zeros(slots, dtype=np.int64)
        self._last_use = np.zeros(slots, dtype=np.int64)
        self._clock = 0
        self._tiles = 0, 0  # rows and columns of ``coarse_steps``
        self._tables: dict[type, Table] = {}  # of the present arrays
        self._has_coarse_steps = np.zeros(slots, dtype=np.bool_)  # of the map that lies in the slot now
        kinds = _kinds(first, config)
        if slots == 1:
            self.arrays = {name: np.asarray(array, order="C")[None] for name, array in kinds.items()}
            self._assets[0], self.numbers[0] = first, 0
            self._measure(first)
        else:
            shapes = {name: (slots, *_room(name, array.shape, ())) for name, array in kinds.items()}
            self.arrays = {name: np.zeros(shape, dtype=kinds[name].dtype) for name, shape in shapes.items()}
        self.arrays["coarse_steps"] = np.zeros((slots, 0, 0), dtype=np.uint8)

    def __len__(self) -> int:
        return self.slots

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_tables": {}}  # a copy's arrays lie elsewhere

    def arrays_for(self, kind: type[tuple[Any, ...]]) -> dict[str, Any]:
        """Those of the arrays that a named tuple declares, tuples within it included."""
        found: dict[str, Any] = {}
        for name, field in kind._field_defaults.items():  # type: ignore[attr-defined]
            if not isinstance(field, Array):
                if set(field._fields) <= self.arrays.keys():
                    found[name] = field(**self.arrays_for(field))
            elif name in self.arrays:
                found[name] = self.arrays[name]
        return found

    def table(self, kind: type[tuple[Any, ...]]) -> Table:
        """A table of nothing but arrays of maps (half of a learned planner's time for one situation, if made anew)."""
        if kind not in self._tables:
            self._tables[kind] = Table(kind, **self.arrays_for(kind))
        return self._tables[kind]

    def assets(self, slot: int) -> MapAssets:
        assets = self._assets[slot]
        assert assets is not None
        return assets

    def has(self, level: int) -> bool:
        return bool((self.numbers == level).any())

    def take(self, level: int, prepare: Callable[[int], MapAssets]) -> int:
        """A slot with that level, held until :meth:`release`; ``prepare`` is called if no slot has it."""
        self._clock += 1
        if self.has(level):
            slot = int((self.numbers == level).argmax())
        else:
            free = np.flatnonzero(self._users == 0)
            slot = int(free[self._last_use[free].argmin()])
            self._load(slot, prepare(level))
            self.numbers[slot] = level
        self._users[slot] += 1
        self._last_use[slot] = self._clock
        return slot

    def release(self, slot: int) -> None:
        self._users[slot] -= 1

    def _load(self, slot: int, assets: MapAssets) -> None:
        self.numbers[slot] = -1  # until it is there as a whole
        for name, array in _kinds(assets, self.config).items():
            stacked = self.arrays[name]
            if any(n > room for n, room in zip(array.shape, stacked.shape[1:], strict=True)):
                larger = np.zeros((self.slots, *_room(name, array.shape, stacked.shape[1:])), dtype=stacked.dtype)
                larger[tuple(slice(n) for n in stacked.shape)] = stacked
                stacked = self.arrays[name] = larger
                self._tables.clear()
                self.version += 1
            if name in _PADDED:  # what lies beyond the map is what lies at its edge, whatever room there is
                rows, columns = array.shape
                stacked[slot, :rows, :columns], stacked[slot, rows:, :columns] = array, array[-1]
                stacked[slot, :, columns:] = stacked[slot, :, columns - 1 : columns]
            else:
                place: tuple[Any, ...] = (slot, *(slice(n) for n in array.shape))
                stacked[place] = array
        self._assets[slot] = assets
        self._has_coarse_steps[slot] = False
        self._measure(assets)

    def find_coarse_steps(self, slots: NDArray[np.int32]) -> int:
        """Fill ``coarse_steps`` (S, cells, G) for the maps in ``slots``; returns how many tiles lie side by side."""
        if self._has_coarse_steps[slots].all():
            return self._tiles[1]
        height, width = self.arrays["snap"].shape[1:]
        goals = self.arrays["next_step"].shape[1]
        tiles = -(-height // TILE), -(-width // TILE)
        shape = self.slots, *tiles, TILE, TILE, goals
        if tiles != self._tiles or goals != self.arrays["coarse_steps"].shape[2]:
            self.arrays["coarse_steps"] = np.zeros((self.slots, math.prod(shape[1:5]), goals), dtype=np.uint8)
            self._tiles = tiles
            self._has_coarse_steps[:] = False
            self._tables.clear()
            self.version += 1
        stacked = self.arrays["coarse_steps"].reshape(shape)
        for slot in np.unique(slots[~self._has_coarse_steps[slots]]).tolist():
            assets = self.assets(slot)
            found = coarse_steps(assets.next_step, assets.grid.cell, assets.grid.shape)
            rows, columns, *_, goals = found.shape
            stacked[slot, :rows, :columns, :, :, :goals] = found
            self._has_coarse_steps[slot] = True
        return tiles[1]

    def _measure(self, assets: MapAssets) -> None:
        longest = int((assets.length_cm + np.uint16(1)).max()) - 1  # UNREACHABLE_CM, the greatest uint16, becomes 0
        if longest > self.longest_way_cm or assets.clyde.longest > self.longest_ghost_way:
            self.version += 1
        self.longest_way_cm = max(self.longest_way_cm, longest)
        self.longest_ghost_way = max(self.longest_ghost_way, assets.clyde.longest)
