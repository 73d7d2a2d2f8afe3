"""Arrays of a prepared map (a level), which kernels read through one address."""

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from ..config import Config
from ..engine.arrays import Array, Table, arrays_by_address
from ..world.navigation.paths import coarse_steps
from ..world.navigation.walls import clear_cells
from .assets import MapAssets

PREDICTION, COARSE_MAP = range(2)  # indices of ``LevelArrays.later``


class LevelArrays(NamedTuple):
    """Arrays of a level with K drivable cells, C ghost cells, G goals, H rows and W columns of the drive grid."""

    affine: Any = Array(np.float64, "6")  # from m to grid cells
    home: Any = Array(np.float64, "3")  # m, m, rad
    snap: Any = Array(np.int32, "H W")  # nearest drivable cell
    clearance_cm: Any = Array(np.uint8, "H W")
    clear: Any = Array(np.bool_, "H W")  # a robot at this cell touches no wall
    walls: Any = Array(np.float64, "s 4")  # x and y of both ends of each wall segment, m
    steps: Any = Array(np.uint8, "K")  # one bit per drivable neighbour
    cell_xy: Any = Array(np.float32, "K 2")  # m
    length_cm: Any = Array(np.uint16, "K G")  # path to each goal
    next_step: Any = Array(np.int16, "G K")  # next cell on that path, as a difference of cell numbers
    goal_xy: Any = Array(np.float64, "G 2")  # m
    plan_end: Any = Array(np.float64, "G 2")  # m, where plans to each goal end
    power: Any = Array(np.bool_, "G")  # True for power pellets
    spawn_cells: Any = Array(np.int32, "k")  # where ghosts may start
    ghost_graph: Any = Array(np.int32, "C 16")  # see ``ClydeCells.graph``
    ghost_part: Any = Array(np.int32, "C")
    ghost_part_start: Any = Array(np.int64, "k")
    ghost_part_cells: Any = Array(np.int32, "C")
    ghost_xy: Any = Array(np.float64, "C 2")  # m
    ghost_drive: Any = Array(np.int32, "C")  # drivable cell under each ghost cell, -1: none
    ghost_snap: Any = Array(np.int32, "H W")  # nearest ghost cell in the robot's area
    ghost_place: Any = Array(np.int32, "G")  # ghost cell nearest to each goal, -1: too far away
    ghost_corner: Any = Array(np.int32, "4")  # cell of each ghost's corner
    later: Any = Array(np.int64, "2")  # addresses of tables that are built on demand; 0: not yet


class PredictionArrays(NamedTuple):
    """Arrays of a level that only predictions and planner features read."""

    coarse_steps: Any = Array(np.uint8, "H W G")  # steps along paths
    goal_cell: Any = Array(np.int32, "G")  # drivable cell, -1: none
    goal_apart_m: Any = Array(np.float32, "G")  # smallest distance of a ghost


level_arrays = arrays_by_address(LevelArrays)
prediction_arrays = arrays_by_address(PredictionArrays)


class LevelFacts(NamedTuple):
    """Sizes of a level."""

    pellets: int
    refuges: int
    cells: int  # number of drivable cells
    longest_cm: int  # longest path to a goal
    ghost_cells: int
    longest_ghost_way: int  # number of cells of the longest ghost path


class Level:
    """A map prepared under a configuration; kernels read its arrays at ``address`` while this object exists.

    All arrays but ``later`` are constant.
    """

    def __init__(self, table: Table, facts: LevelFacts, prepare: Callable[[], MapAssets]) -> None:
        """Create a level; ``prepare`` returns the whole map when ``assets`` needs it."""
        self.table, self.facts, self._prepare = table, facts, prepare
        self._later: dict[int, Table] = {}

    @classmethod
    def of(cls, assets: MapAssets, config: Config) -> "Level":
        longest_cm = int((assets.length_cm + np.uint16(1)).max()) - 1  # UNREACHABLE_CM becomes 0
        ghost_cells, longest = len(assets.clyde.part), assets.clyde.longest
        facts = LevelFacts(assets.pellets, assets.refuges, len(assets.cell_xy), longest_cm, ghost_cells, longest)
        table = Table(LevelArrays, **_arrays(assets, config), later=np.zeros(2, dtype=np.int64))
        return cls(table, facts, functools.partial(_identity, assets))

    @property
    def address(self) -> int:
        return self.table.address

    @property
    def arrays(self) -> dict[str, Any]:
        """Arrays by name, declared in :class:`LevelArrays`."""
        return self.table.arrays

    def __deepcopy__(self, memo: dict[int, Any]) -> "Level":
        return self

    def __reduce__(self) -> tuple[Any, ...]:
        return _unpickle, (self.arrays, self.facts, self._prepare)

    @functools.cached_property
    def assets(self) -> MapAssets:
        """The whole map, for code outside of kernels; a level loaded from disk prepares it here."""
        return self._prepare()

    def find(self, place: int) -> Table | None:
        """Return the table added at an index of ``later``, or None."""
        return self._later.get(place)

    def add(self, place: int, table: Table) -> Table:
        """Store a table at an index of ``later`` unless another thread has stored one; return the stored table."""
        shared = self._later.setdefault(place, table)  # another thread may have added one
        self.table.array("later")[place] = shared.address
        return shared

    def add_prediction_arrays(self) -> None:
        if self.find(PREDICTION) is None:
            assets = self.assets
            steps = coarse_steps(assets.next_step, assets.grid.cell, *assets.grid.shape)
            goals = {"goal_cell": assets.goal_cell, "goal_apart_m": assets.goal_apart_m}
            self.add(PREDICTION, Table(PredictionArrays, coarse_steps=steps, **goals))


def _unpickle(arrays: dict[str, Any], *others: Any) -> Level:
    return Level(Table(LevelArrays, **{**arrays, "later": np.zeros(2, dtype=np.int64)}), *others)


def _identity(assets: MapAssets) -> MapAssets:
    return assets


def _arrays(assets: MapAssets, config: Config) -> dict[str, Any]:
    grid, clyde = assets.grid, assets.clyde
    # NavFn moves a goal out of reach to the nearest place where the robot can be.
    nearest = assets.cell_xy[assets.goal_cell].astype(np.float64)
    off = np.hypot(*(nearest - assets.goal_xy).T)
    moved = (assets.goal_cell >= 0) & (off > config.execution.pickup_radius_m)
    arrays = {
        "affine": grid.affine,
        "home": grid.home,
        "snap": grid.snap,
        "clearance_cm": grid.clearance_cm,
        "clear": clear_cells(grid.walls, grid.affine, grid.shape, grid.resolution, config.robot.radius_m),
        "walls": grid.walls,
        "steps": grid.steps,
        "cell_xy": assets.cell_xy,
        "length_cm": assets.length_cm,
        "next_step": assets.next_step,
        "goal_xy": assets.goal_xy,
        "plan_end": np.where(moved[:, None], nearest, assets.goal_xy),
        "power": assets.power_pellets(config.power.pellets),
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
    }
    return {name: np.asarray(array, order="C") for name, array in arrays.items()}
