"""One level: all arrays that kernels read of a prepared map, unchanged, found by one address."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ...config import Config
from ...engine.arrays import Array, Table, arrays_by_address
from ...world.navigation.paths import coarse_steps
from .assets import MapAssets

COARSE_STEPS, COARSE_MAP = range(2)  # places in ``LevelArrays.later``


class LevelArrays(NamedTuple):
    """K drivable cells, C cells of the ghosts, G goals; the drive grid's rows H and columns W."""

    affine: Any = Array(np.float64, "6")  # from m to cells
    home: Any = Array(np.float64, "3")  # m, m, rad
    snap: Any = Array(np.int32, "H W")  # nearest drivable cell
    clearance_cm: Any = Array(np.uint8, "H W")
    clear: Any = Array(np.bool_, "H W")  # a robot there touches no wall
    steps: Any = Array(np.uint8, "K")  # a bit for each neighbour that may be driven to
    cell_xy: Any = Array(np.float32, "K 2")  # m
    length_cm: Any = Array(np.uint16, "K G")  # path to each goal
    next_step: Any = Array(np.int16, "G K")  # next cell on it, as a difference of numbers
    goal_xy: Any = Array(np.float64, "G 2")  # m
    goal_cell: Any = Array(np.int32, "G")
    goal_apart_m: Any = Array(np.float32, "G")  # how near a ghost can come
    plan_end: Any = Array(np.float64, "G 2")  # m
    spawn_cells: Any = Array(np.int32, "k")  # that ghosts may start from
    ghost_graph: Any = Array(np.int32, "C 16")  # the search's view of a cell
    ghost_part: Any = Array(np.int32, "C")
    ghost_part_start: Any = Array(np.int64, "k")
    ghost_part_cells: Any = Array(np.int32, "C")
    ghost_xy: Any = Array(np.float64, "C 2")  # m
    ghost_drive: Any = Array(np.int32, "C")  # drivable cell under each, -1: none
    ghost_snap: Any = Array(np.int32, "H W")  # nearest cell of the ghosts' in the robot's area
    ghost_place: Any = Array(np.int32, "G")  # cell of the ghosts' nearest to each goal, -1: too far away
    ghost_corner: Any = Array(np.int32, "4")  # cell of each ghost's corner
    corner_drive: Any = Array(np.int32, "4")  # drivable cell there
    later: Any = Array(np.int64, "2")  # addresses of tables that are made when they are needed; 0: not yet


class CoarseSteps(NamedTuple):
    """Hold the steps that ``prediction.py`` walks along; 64 cells of a tile follow one another."""

    coarse_steps: Any = Array(np.uint8, "t G")


level_arrays = arrays_by_address(LevelArrays)
steps_of_level = arrays_by_address(CoarseSteps)


class Facts(NamedTuple):
    """Hold what Python needs of a level."""

    pellets: int
    refuges: int
    cells: int  # drivable
    longest_cm: int  # path to a goal
    ghost_cells: int
    longest_ghost_way: int  # cells


class Level:
    """A map prepared under a configuration; kernels find its arrays at ``address`` as long as this object lives.

    Nothing of the arrays changes but ``later``.
    """

    def __init__(
        self, table: Table, walls: NDArray[np.float64], facts: Facts, prepare: Callable[[], MapAssets]
    ) -> None:
        """``walls`` are (S, 4) in m; ``prepare`` makes the whole map when it is asked for."""
        self.table, self.walls, self.facts, self._prepare = table, walls, facts, prepare
        self._later: dict[int, Table] = {}

    @classmethod
    def of(cls, assets: MapAssets, config: Config) -> "Level":
        longest_cm = int((assets.length_cm + np.uint16(1)).max()) - 1  # UNREACHABLE_CM becomes 0
        ghost_cells, longest = len(assets.clyde.part), assets.clyde.longest
        facts = Facts(assets.pellets, assets.refuges, len(assets.cell_xy), longest_cm, ghost_cells, longest)
        table = Table(LevelArrays, **_arrays(assets, config), later=np.zeros(2, dtype=np.int64))
        return cls(table, assets.grid.walls, facts, functools.partial(_given, assets))

    @property
    def address(self) -> int:
        return self.table.address

    @property
    def arrays(self) -> dict[str, Any]:
        """Return the arrays by name, as :class:`LevelArrays` declares them."""
        return self.table.arrays

    def __deepcopy__(self, memo: dict[int, Any]) -> "Level":
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return _again, (self.arrays, self.walls, self.facts, self._prepare)

    @functools.cached_property
    def assets(self) -> MapAssets:
        """Return the whole map, for pictures and what else no kernel reads; a loaded one is prepared here (30 ms)."""
        return self._prepare()

    def find(self, place: int) -> Table | None:
        """Return a table that was added; None if there is none."""
        return self._later.get(place)

    def add(self, place: int, table: Table) -> Table:
        """Let kernels find a table, which is kept as long as the level; return the one that they find."""
        kept = self._later.setdefault(place, table)  # another thread may be as far
        self.table.array("later")[place] = kept.address
        return kept

    def add_coarse_steps(self) -> None:
        if self.find(COARSE_STEPS) is None:
            found = coarse_steps(self.assets.next_step, self.assets.grid.cell, self.assets.grid.shape)
            self.add(COARSE_STEPS, Table(CoarseSteps, coarse_steps=found.reshape(-1, found.shape[-1])))


def _again(arrays: dict[str, Any], *others: Any) -> Level:
    return Level(Table(LevelArrays, **{**arrays, "later": np.zeros(2, dtype=np.int64)}), *others)


def _given(assets: MapAssets) -> MapAssets:
    return assets


def _arrays(assets: MapAssets, config: Config) -> dict[str, Any]:
    from ...world.navigation.physics import clear_cells  # policies must not load pymunk

    grid, clyde = assets.grid, assets.clyde
    # NavFn moves a goal that the robot cannot come near to the nearest place where it can be.
    nearest = assets.cell_xy[assets.goal_cell].astype(np.float64)
    off = np.hypot(*(nearest - assets.goal_xy).T)
    moved = (assets.goal_cell >= 0) & (off > config.execution.pickup_radius_m)
    arrays = {
        "affine": grid.affine,
        "home": grid.home,
        "snap": grid.snap,
        "clearance_cm": grid.clearance_cm,
        "clear": clear_cells(grid.walls, grid.affine, grid.shape, grid.resolution, config.robot.radius_m),
        "steps": grid.steps,
        "cell_xy": assets.cell_xy,
        "length_cm": assets.length_cm,
        "next_step": assets.next_step,
        "goal_xy": assets.goal_xy,
        "goal_cell": assets.goal_cell,
        "goal_apart_m": assets.goal_apart_m,
        "plan_end": np.where(moved[:, None], nearest, assets.goal_xy),
        "spawn_cells": assets.spawn_cells,
        "ghost_graph": clyde.graph,
        "ghost_part": clyde.part,
        "ghost_part_start": clyde.part_start,
        "ghost_part_cells": clyde.part_cells,
        "ghost_xy": clyde.position,
        "ghost_drive": assets.clyde_drive,
        "ghost_snap": assets.ghost_targets.snap,
        "ghost_place": assets.ghost_targets.place,
        "ghost_corner": assets.ghost_corner,
        "corner_drive": assets.clyde_drive[assets.ghost_corner],
    }
    return {name: np.asarray(array, order="C") for name, array in arrays.items()}
