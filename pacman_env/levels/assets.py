"""Compute everything that depends only on map and configuration; cache it in memory, and path fields on disk."""

import collections
import contextlib
import errno
import functools
import hashlib
import json
import math
import os
import shutil
import threading
import uuid
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..config import Config, RefugeConfig
from ..engine.cache_folder import cache_dir, source_hash, warn_unkept
from ..engine.jit import kernel
from ..game.pellets import generate_pellets
from ..game.power import choose_power_pellets
from ..world.maps.occupancy import MapError, OccupancyMap, load_map
from ..world.navigation.grid import DriveGrid, build_grid, clearance_m, connected_parts, nearest_numbers
from ..world.navigation.paths import NO_STEP, UNREACHABLE_CM, PathFields
from .ghost_cells import ClydeCells, clyde_cells, nearest_positions

MapSource = str | os.PathLike[str] | OccupancyMap
MAX_PELLETS = 1000  # the memory for paths grows with the number of pellets
_KEEP = 16  # maps cached in memory
_NEAR_M = 1.0  # a ghost can only be sent to goals within this distance of its cells
#: In units of half the area's extent: Clyde's arcade corner is the lower left one, Blinky's the upper right.
_CORNERS = ((-1, -1), (1, 1), (-1, 1), (1, -1))


class GhostTargets(NamedTuple):
    """Target cells for ghosts, in the ghosts' connected part that overlaps the robot's area."""

    snap: NDArray[np.int32]  # (H, W) nearest ghost cell of each drive-grid cell
    place: NDArray[np.int32]  # (G,) ghost cell nearest to each goal, -1: too far away


@dataclass(frozen=True, eq=False)
class MapAssets:
    """A map prepared for play, with G goals: P pellets, then R refuges."""

    occupancy: OccupancyMap
    grid: DriveGrid
    clyde: ClydeCells
    clyde_part: int  # the ghosts' connected part that overlaps the robot's area
    spawn_cells: NDArray[np.int32]  # cells where ghosts may start
    clyde_drive: NDArray[np.int32]  # (K,) drivable cell under each ghost cell, -1: outside the robot's area
    pellet_ids: NDArray[np.int64]  # (P,) pellet numbers of the game
    dropped_ids: NDArray[np.int64]  # pellets of the game that the robot cannot reach
    goal_xy: NDArray[np.float64]  # (G, 2) m
    goal_cell: NDArray[np.int32]  # (G,) drivable cell, -1: none within Nav2's tolerance
    cell_xy: NDArray[np.float32]  # (K, 2) m
    length_cm: NDArray[np.uint16]  # (K, G) path length from each cell to each goal
    next_step: NDArray[np.int16]  # (G, K) next cell towards each goal, as a difference of cell numbers
    goal_apart_m: NDArray[np.float32]  # (G,) smallest distance of a ghost's centre to each goal

    @property
    def pellets(self) -> int:
        return len(self.pellet_ids)

    @property
    def refuges(self) -> int:
        return len(self.goal_xy) - len(self.pellet_ids)

    def power_pellets(self, count: int) -> NDArray[np.bool_]:
        """Return a mask (G,) of the goals that are power pellets."""
        power = np.zeros(len(self.goal_xy), dtype=np.bool_)
        x, y = self.grid.home[:2]
        power[: self.pellets] = choose_power_pellets(self.goal_xy[: self.pellets], (float(x), float(y)), count)
        return power

    @functools.cached_property
    def ghost_targets(self) -> GhostTargets:
        cells = self.clyde.cells_in(self.clyde_part)
        nearest, square = nearest_positions(self.clyde.position[cells], self.goal_xy)
        place = np.where(square <= _NEAR_M**2, cells[nearest], -1)
        number = _numbers_on(self.grid, self.clyde, self.clyde_part)
        return GhostTargets(nearest_numbers(number)[0], place.astype(np.int32))

    @functools.cached_property
    def ghost_corner(self) -> NDArray[np.int32]:
        """Cell of each ghost's corner (4,), in the robot's area."""
        cells = self.clyde.cells_in(self.clyde_part)
        position = self.clyde.position[cells]
        low, high = (np.array([end(position[:, 0]), end(position[:, 1])]) for end in (np.min, np.max))
        corners = (low + high) / 2 + np.array(_CORNERS) * (high - low) / 2
        return cells[nearest_positions(position, corners)[0]].astype(np.int32)


_assets: collections.OrderedDict[str, MapAssets] = collections.OrderedDict()
_lock = threading.Lock()


def configuration_key(config: Config) -> str:
    """Return a text with all settings that change how a map is prepared, and with the hash of the sources."""
    relevant = {
        "inscribed": config.robot.inscribed_radius_m,
        "inflation": [config.nav2.inflation_radius_m, config.nav2.inflation_scale],
        "tolerance": [config.nav2.unreachable_tolerance_m, config.execution.pickup_radius_m],
        "pellets": asdict(config.pellets),
        "clyde": [config.clyde.clearance_m, config.clyde.spawn, config.clyde.spawn_distance_m],
        "refuges": asdict(config.refuges),
        "code": source_hash(),
    }
    return json.dumps(relevant, sort_keys=True)


def map_assets(source: MapSource, config: Config, home: tuple[float, float, float] | None = None) -> MapAssets:
    """Return the assets of a map; ``home`` None means ``config.home``. Raises MapError, ConfigError."""
    occupancy = source if isinstance(source, OccupancyMap) else load_map(source)
    home = config.home if home is None else home
    if home is not None:
        home = _pose(home, occupancy.name)
    key = hashlib.sha256(f"{occupancy.hash} {home} {configuration_key(config)}".encode()).hexdigest()[:32]
    with _lock:
        if key in _assets:
            _assets.move_to_end(key)
            # A map with the same content and another name shares the arrays and keeps its name.
            same = _assets[key]
            return same if same.occupancy.name == occupancy.name else replace(same, occupancy=occupancy)
        assets = _build(occupancy, config, home, key)
        _assets[key] = assets
        while len(_assets) > _KEEP:
            _assets.popitem(last=False)
        return assets


def prepare_map(occupancy: OccupancyMap, config: Config, home: tuple[float, float, float] | None = None) -> MapAssets:
    """Return the assets of a map without caching them, for a map that is played once; safe to call from threads."""
    _keep_freed_memory()
    return _build(occupancy, config, None if home is None else _pose(home, occupancy.name), None)


@functools.cache
def _keep_freed_memory() -> None:
    """Make glibc keep up to 62 MB of freed memory for later arrays, by freeing one large array.

    Otherwise preparing houses spends much of its time on requesting memory from the system.
    """
    np.empty(31 << 20, dtype=np.uint8)


def _pose(home: tuple[float, float, float], name: str) -> tuple[float, float, float]:
    try:
        x, y, heading = (float(value) for value in home)
    except (TypeError, ValueError):
        x = y = heading = math.nan
    if not all(map(math.isfinite, (x, y, heading))) or abs(heading) > 2 * math.pi:
        raise MapError(f"{name}: the home pose must be x, y, heading (m, m, rad within 2 pi), not {home!r}")
    return x, y, heading


def _build(
    occupancy: OccupancyMap, config: Config, home: tuple[float, float, float] | None, key: str | None
) -> MapAssets:
    """Compute the assets of a map; with a key, the path fields are loaded from the disk cache or stored there."""
    grid = build_grid(occupancy, config.robot, config.nav2, config.pellets, home)
    pellets = generate_pellets(occupancy, config.pellets)
    if len(pellets) > MAX_PELLETS:
        raise MapError(
            f"{occupancy.name}: {len(pellets):,} pellets at pellets.spacing_m = {config.pellets.spacing_m}:"
            f" must be {MAX_PELLETS:,} at most"
        )
    cells, near = grid.pellet_cells(pellets.position, config.nav2, config.execution)
    keep = near if config.pellets.reachable_only else np.ones(len(pellets), dtype=np.bool_)
    if not near.any():
        raise MapError(
            f"{occupancy.name}: no pellet that the robot can reach at a spacing of {config.pellets.spacing_m} m"
        )
    clyde = clyde_cells(occupancy, config.clyde, config.pellets.free_grey)
    clyde_drive = grid.cells_of_pixels(clyde.pixel, occupancy.height)
    shared = np.bincount(clyde.part[clyde_drive >= 0], minlength=len(clyde.part_start) - 1)
    if shared.max() == 0:
        raise MapError(f"{occupancy.name}: no place of the robot's area is wide enough for Clyde")
    part = int(shared.argmax())
    fields_of_grid = grid.path_fields()
    refuge_xy = choose_refuges(grid, clyde, part, config.refuges, fields_of_grid)
    tolerance = config.nav2.unreachable_tolerance_m
    refuge_cells = [grid.nearest_cell(x, y, tolerance) for x, y in refuge_xy]
    goal_cell = np.concatenate([cells[keep], np.array(refuge_cells, dtype=np.int32)]).astype(np.int32)
    names, compute = ("length_cm", "next_step"), lambda: path_fields(grid, goal_cell, fields_of_grid)
    fields = compute() if key is None else cached_arrays(key, names, compute)
    goal_xy = np.concatenate([pellets.position[keep], refuge_xy])
    reached = clyde.position[clyde.cells_in(part)].astype(np.float32)
    _, squares = nearest_positions(reached, goal_xy.astype(np.float32))
    return MapAssets(
        occupancy=occupancy,
        grid=grid,
        clyde=clyde,
        clyde_part=part,
        spawn_cells=clyde.start_cells(config.clyde, part, [tuple(grid.home[:2])]),
        clyde_drive=clyde_drive,
        pellet_ids=pellets.ids[keep],
        dropped_ids=pellets.ids[~keep],
        goal_xy=goal_xy,
        goal_cell=goal_cell,
        cell_xy=np.stack(grid.to_world(*grid.cell.T), axis=1).astype(np.float32),
        length_cm=fields["length_cm"],
        next_step=fields["next_step"],
        goal_apart_m=np.sqrt(squares.astype(np.float32)),
    )


def path_fields(grid: DriveGrid, goal_cell: NDArray[np.int32], fields: PathFields | None = None) -> dict[str, NDArray]:
    """Return ``length_cm`` (K, G) and ``next_step`` (G, K) for all goals; a goal without a cell (-1) is unreachable."""
    count, goals = len(grid.cell), len(goal_cell)
    length_cm = np.empty((goals, count), dtype=np.uint16)
    next_step = np.empty((goals, count), dtype=np.int16)
    fields = fields or grid.path_fields()
    for k, cell in enumerate(goal_cell.tolist()):
        length_cm[k], next_step[k] = fields.to(cell) if cell >= 0 else (UNREACHABLE_CM, NO_STEP)
    return {"length_cm": np.ascontiguousarray(length_cm.T), "next_step": next_step}


def choose_refuges(
    grid: DriveGrid, clyde: ClydeCells, part: int, config: RefugeConfig, fields: PathFields | None = None
) -> NDArray[np.float64]:
    """Return refuges (R, 2), m: home, at most ``nooks`` nooks, and at most ``spread`` places far from other refuges."""
    home = grid.nearest_cell(grid.home[0], grid.home[1], 1.0)
    nooks = _nooks(grid, clyde, part, config)
    spread = _spread(grid, fields or grid.path_fields(), [home, *nooks], config)
    places = [(float(grid.home[0]), float(grid.home[1]))]
    places += [grid.to_world(*grid.cell[k]) for k in (*nooks, *spread)]
    return np.array(places, dtype=np.float64)


def _spread(grid: DriveGrid, fields: PathFields, given: list[int], config: RefugeConfig) -> list[int]:
    """Return cells by farthest-point sampling with path lengths, starting from the cells ``given``."""
    if config.spread == 0:
        return []
    clearance = grid.clearance[grid.cell[:, 1], grid.cell[:, 0]]
    roomy = clearance >= config.clearance_m
    if not roomy.any():
        roomy = clearance >= clearance.max()
    nearest = np.full(len(grid.cell), UNREACHABLE_CM, dtype=np.uint16)
    chosen = list(given)
    for k in range(len(given) + config.spread - 1):
        length_cm, _ = fields.to(chosen[k])
        farthest = _lower_lengths(nearest, length_cm, roomy)
        if k + 1 == len(chosen):
            if nearest[farthest] <= 0:
                break
            chosen.append(farthest)
    return chosen[len(given) :]


@kernel
def _lower_lengths(nearest, length_cm, roomy):  # type: ignore[no-untyped-def]
    """Lower ``nearest`` (K,), path lengths to the nearest place, to the lengths ``length_cm`` (K,) to one more place.

    Return the cell of the mask ``roomy`` (K,) that is then farthest.
    """
    farthest, most = 0, -1
    for k in range(len(nearest)):
        nearest[k] = min(nearest[k], length_cm[k])
        if roomy[k] and nearest[k] > most:
            farthest, most = k, int(nearest[k])
    return farthest


def _numbers_on(grid: DriveGrid, clyde: ClydeCells, part: int) -> NDArray[np.int32]:
    """Return for each grid cell (H, W) the number of its ghost cell, or -1 without a ghost cell in ``part``."""
    number = np.full(grid.shape, -1, dtype=np.int32)
    _put(number, grid.affine, clyde.position, clyde.cells_in(part))
    return number


@kernel
def _put(number, affine, position, cells):  # type: ignore[no-untyped-def]
    """Write each number in ``cells`` to the element of ``number`` (H, W) under its position (K, 2), m."""
    rows, columns = number.shape
    for k in cells:
        x, y = position[k]
        column = math.floor(affine[0] * x + affine[1] * y + affine[2])
        row = math.floor(affine[3] * x + affine[4] * y + affine[5])
        if 0 <= column < columns and 0 <= row < rows:
            number[row, column] = k


def _nooks(grid: DriveGrid, clyde: ClydeCells, part: int, config: RefugeConfig) -> list[int]:
    """Return the cell farthest from ghosts in each of the largest patches that ghosts cannot come near."""
    if config.nooks == 0:
        return []
    distance = clearance_m(_numbers_on(grid, clyde, part) < 0, grid.resolution)
    # A ghost can be half a cell's diagonal away from a cell centre.
    safe = (distance >= config.nook_clearance_m + grid.resolution * math.sqrt(0.5)) & (grid.cell_id >= 0)
    labels, areas = connected_parts(safe)
    number, patch, distance = grid.cell_id[safe], labels[safe], distance[safe]
    largest = np.argsort(-areas[1:], kind="stable")[: config.nooks] + 1
    return [int(number[np.where(patch == k, distance, -1.0).argmax()]) for k in largest]


Arrays = dict[str, NDArray]
KEEP_BYTES = 2 << 30  # arrays on disk; a house takes 2 to 5 MB, the largest real maps 300 MB


def cached_arrays(key: str, names: tuple[str, ...], compute: Callable[[], Arrays]) -> Arrays:
    """Load the arrays ``names`` from the disk cache or compute and store them; ``key`` is a hash of all inputs."""
    try:
        folder = cache_dir() / "maps" / key
        # copy-on-write protects the file and lets processes share its pages
        arrays = {n: np.asarray(np.load(folder / f"{n}.npy", mmap_mode="c", allow_pickle=False)) for n in names}
    except (OSError, ValueError, EOFError):  # EOFError: an empty file
        arrays = compute()
        _store(key, arrays)
    else:
        with contextlib.suppress(OSError):
            os.utime(folder)  # mark as recently used
    return arrays


def prune(root: Path, keep_bytes: int) -> None:
    """Remove the oldest folders until at most ``keep_bytes`` bytes remain; the newest folder always stays."""
    with contextlib.suppress(OSError):
        folders = sorted((f for f in root.iterdir() if f.is_dir()), key=lambda f: f.stat().st_mtime, reverse=True)
        total = 0
        for folder in folders:
            total += sum(file.stat().st_size for file in folder.iterdir())
            if total > keep_bytes and folder is not folders[0]:
                shutil.rmtree(folder, ignore_errors=True)


def _store(key: str, arrays: Arrays) -> None:
    """Store arrays in the disk cache, readable for all users; warn once if the cache cannot be written."""
    temporary = None
    try:
        folder = cache_dir() / "maps" / key
        temporary = folder.with_name(f".new-{uuid.uuid4().hex}")  # readable for others, unlike folders of tempfile
        temporary.mkdir(parents=True)
        for name, array in arrays.items():
            np.save(temporary / f"{name}.npy", array, allow_pickle=False)
        shutil.rmtree(folder, ignore_errors=True)
        os.replace(temporary, folder)
        prune(folder.parent, KEEP_BYTES)
    except OSError as error:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)
        if error.errno not in (errno.EEXIST, errno.ENOTEMPTY):  # another process has just stored the same arrays
            warn_unkept(error)
