"""Registry of the observation kinds, one object per kind; ``observer.py`` combines them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import NDArray

from ..config import ObservationConfig
from ..engine.pipeline import Stage
from ..plugins import Registry
from ..sim.batch import GameBatch
from ..world.navigation import lidar
from . import robot_features
from .learner_layout import MISSING, NearestCounts, nearest_candidates
from .planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES, MOST, maps_changed, planner_stage
from .raster import CHANNELS, FRIGHTENED, PRESENT, Lengths, ShownGhosts, ShownPellets, raster_all, scan_all
from .robot_features import COLUMNS, Columns, Observation, features_stage, ghost_bearings, pellet_bearings, power_stage
from .situation import Situation

_BELIEF_MARGIN_M = 2.0  # a believed pose lies at most this far outside the playable area ...
_BELIEF_MARGIN_SIGMAS = 9  # ... or this many standard deviations: a draw with 53 bits is at most 8.6 away
#: Bounds that hold for every map, so that spaces are equal.
_ANY_MAP = {"x": (-1e4, 1e4), "y": (-1e4, 1e4), "time": (0.0, 1e6), "pellets_left": (0.0, 1e4)}
FLAT = "flat"
MASK = "action_mask"  # part of every observation whose actions are candidates


class ObservationPart(NamedTuple):
    """One array of an observation of one game."""

    low: float | NDArray[Any]  # one bound for all elements, or one for each
    high: float | NDArray[Any]
    shape: tuple[int, ...]
    dtype: type[np.generic]
    columns: Columns = ()  # name, low, high and unit of each column of the last axis
    by_candidate: bool = False  # the first axis is the candidates


class ObservationKind(Protocol):
    """A kind of observation: describes and fills its arrays; keeps no state between observations."""

    name: str

    def parts(self, batch: GameBatch) -> dict[str, ObservationPart]:
        """Return the arrays that this kind adds to an observation, by key."""

    def fill(self, batch: GameBatch, situation: Situation) -> Observation:
        """Return new arrays ``(N, *shape)`` of all games, by key; ``situation`` is the batch's present situation."""


def bounds(batch: GameBatch) -> dict[str, tuple[float, float]]:
    """Return the bounds of columns that depend on the map or configuration; fixed bounds with nearest candidates."""
    if batch.config.observation.candidates == "nearest":
        return _ANY_MAP
    xs, ys = batch.source.extent()
    sigma = max(batch.config.localization.sigma_xy_m, (batch.config.randomize.sigma_xy_m or (0.0, 0.0))[1])
    margin = max(_BELIEF_MARGIN_M, _BELIEF_MARGIN_SIGMAS * sigma)
    return {
        "x": (xs[0] - margin, xs[1] + margin),
        "y": (ys[0] - margin, ys[1] + margin),
        "time": (0.0, batch.config.time_limit_s + batch.config.execution.tick_s),
        "pellets_left": (0.0, float(batch.pellet_slots)),
    }


def mask_part(batch: GameBatch) -> ObservationPart:
    """Return the part for the mask of allowed candidates."""
    return ObservationPart(0, 1, (batch.candidates,), np.int8, by_candidate=True)


@dataclass
class _Described:
    name: str
    parts: Callable[[GameBatch], dict[str, ObservationPart]]

    def __call__(self) -> Self:
        return self  # called like the classes that other packages register


@dataclass
class _Kind(_Described):
    fill: Callable[[GameBatch, Situation], Observation]


@dataclass
class CompiledKind(_Described):
    """A kind that a kernel fills, in the same call as the ticks of a step."""

    #: Returns the stage that fills the kind's arrays; the mask (N, C) selects candidates.
    stage: Callable[[GameBatch, Situation, NDArray[np.bool_], Observation], Stage]
    #: Called after games have moved to the maps in these slots.
    maps_changed: Callable[[Situation, NDArray[np.int64]], None] | None = None


def _table_part(
    columns: Columns, rows: tuple[int, ...], known: Mapping[str, tuple[float, float]] | None = None
) -> ObservationPart:
    """Describe an array of the shape (*rows, columns); ``known`` replaces the bounds of some columns, by name."""
    low, high = np.array([(known or {}).get(name, limits) for name, *limits, _ in columns], dtype=np.float32).T
    shape = *rows, len(columns)
    return ObservationPart(np.broadcast_to(low, shape), np.broadcast_to(high, shape), shape, np.float32, columns)


def _feature_parts(batch: GameBatch) -> dict[str, ObservationPart]:
    limits, ghosts = bounds(batch), len(batch.config.clyde.ghosts)
    rows = {"candidates": (batch.candidates,), "ghosts": (ghosts,)}
    parts = {key: _table_part(columns, rows.get(key, ()), limits) for key, columns in COLUMNS.items()}
    parts["candidates"] = parts["candidates"]._replace(by_candidate=True)
    if ghosts == 1:
        del parts["ghosts"]
    return parts


def _planner_parts(batch: GameBatch) -> dict[str, ObservationPart]:
    shape = batch.candidates, len(CANDIDATE_FEATURES)
    return {
        "planner_candidates": ObservationPart(-MOST, MOST, shape, np.float32, by_candidate=True),
        "planner_globals": ObservationPart(-MOST, MOST, (len(GLOBAL_FEATURES),), np.float32),
    }


def _planner_stage(batch: GameBatch, situation: Situation, wanted: NDArray[np.bool_], arrays: Observation) -> Stage:
    filled = arrays["planner_candidates"], arrays["planner_globals"]
    return planner_stage(situation, batch.config.robot.speed_mps, wanted, *filled)


def _bearing_parts(batch: GameBatch) -> dict[str, ObservationPart]:
    pellets, ghosts = batch.config.observation.nearest_pellets, len(batch.config.clyde.ghosts)
    parts = {
        "pellet_bearings": _table_part(robot_features.PELLET_BEARING_COLUMNS, (pellets,)),
        "ghost_bearings": _table_part(robot_features.GHOST_BEARING_COLUMNS, (ghosts,)),
    }
    if batch.config.power.pellets > 0:
        parts["pellet_power"] = _table_part(robot_features.CANDIDATE_POWER_COLUMNS, (pellets,))
    return parts


def _bearings(batch: GameBatch, situation: Situation) -> Observation:
    count = batch.config.observation.nearest_pellets
    result = {"pellet_bearings": pellet_bearings(situation, count), "ghost_bearings": ghost_bearings(situation)}
    if batch.config.power.pellets > 0:
        order = nearest_candidates(situation, NearestCounts(count, 0))[:, :count]
        power = np.take_along_axis(situation.is_power, np.maximum(order, 0), axis=1) & (order != MISSING)
        result["pellet_power"] = power[:, :, None].astype(np.float32)
    return result


def _power_parts(batch: GameBatch) -> dict[str, ObservationPart]:
    candidates = _table_part(robot_features.CANDIDATE_POWER_COLUMNS, (batch.candidates,))._replace(by_candidate=True)
    ghosts = _table_part(robot_features.GHOST_POWER_COLUMNS, (len(batch.config.clyde.ghosts),))
    return {"candidate_power": candidates, "ghost_power": ghosts}


def _scan_parts(batch: GameBatch) -> dict[str, ObservationPart]:
    config = batch.config.observation
    return {"scan": ObservationPart(config.scan_minimum_m, config.scan_maximum_m, (config.scan_rays,), np.float32)}


def _scan(batch: GameBatch, situation: Situation) -> Observation:
    config, games = batch.config.observation, batch.games
    ranges = np.empty((batch.n, config.scan_rays), dtype=np.float32)
    pose = np.stack([games["x"], games["y"], games["heading"]], axis=1)
    level, seed, tick = (np.ascontiguousarray(games[name]) for name in ("level", "seed", "tick"))
    resolution = batch.assets.grid.resolution
    sensor = lidar.Sensor(config.scan_minimum_m, config.scan_maximum_m, config.scan_noise)
    scan_all(batch.levels.addresses, level, (pose, seed, tick), resolution, sensor, ranges)
    return {"scan": ranges}


def _grid_parts(batch: GameBatch) -> dict[str, ObservationPart]:
    size = batch.config.observation.grid_pixels
    return {"grid": ObservationPart(0, 255, (size, size, CHANNELS), np.uint8)}


def _grid(batch: GameBatch, situation: Situation) -> Observation:
    config = batch.config.observation
    images = np.empty((batch.n, config.grid_pixels, config.grid_pixels, CHANNELS), dtype=np.uint8)
    level = np.ascontiguousarray(batch.games["level"])
    ghosts = situation.ghosts[:, :, :2].copy()
    lengths = Lengths(config.grid_pixel_m, batch.config.robot.radius_m)
    pellets = ShownPellets(situation.position, batch.alive, situation.is_power)
    ghosts[situation.away_s > 0.0] = np.nan
    shades = np.where(situation.frightened_s > 0.0, FRIGHTENED, PRESENT)
    raster_all(batch.levels.addresses, level, situation.robot, pellets, ShownGhosts(ghosts, shades), lengths, images)
    return {"grid": images}


FEATURES = CompiledKind(
    "features", _feature_parts, lambda batch, situation, wanted, arrays: features_stage(situation, arrays)
)
PLANNER = CompiledKind("planner", _planner_parts, _planner_stage, maps_changed)
POWER = CompiledKind("power", _power_parts, lambda batch, situation, wanted, arrays: power_stage(situation, arrays))
SCAN = _Kind("scan", _scan_parts, _scan)
BEARINGS = _Kind("bearings", _bearing_parts, _bearings)
GRID = _Kind("grid", _grid_parts, _grid)
BUILT_IN_KINDS: dict[str, _Kind | CompiledKind] = {
    kind.name: kind for kind in (FEATURES, PLANNER, POWER, SCAN, BEARINGS, GRID)
}
#: Kinds by name, as classes without constructor arguments; other packages add entry points.
KINDS: Registry[Callable[[], ObservationKind | CompiledKind]] = Registry(
    "observation kind", "pacman_env.observations", BUILT_IN_KINDS
)
register_observation = KINDS.register


def kinds_shown(config: ObservationConfig, action: str, power: bool) -> list[str]:
    """Return the configured kinds and the kinds that they need.

    Bearings are added to a scan, and for velocity actions to features and planner features. ``POWER`` is added if
    there is ``power`` in the game, except to a grid alone.
    """
    kinds = set(config.kinds)
    steers = action == "velocity" and bool(kinds & {FEATURES.name, PLANNER.name})
    kinds |= {BEARINGS.name} if steers or SCAN.name in kinds else set()
    return sorted(kinds | ({POWER.name} if power and kinds - {GRID.name} else set()))
