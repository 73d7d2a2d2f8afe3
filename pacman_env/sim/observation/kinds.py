"""The kinds of observation: one object per kind, found by name; ``observer.py`` puts them together."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ...config import ObservationConfig
from ...engine.pipeline import Stage
from ...plugins import Registry
from ...world.navigation import lidar
from ..core.batch import GameBatch
from .planner_features import (
    CANDIDATE_FEATURES,
    GLOBAL_FEATURES,
    MOST,
    maps_changed,
    maps_wanted,
    planner_features,
    planner_stage,
)
from .raster import CHANNELS, raster_all, scan_all
from .robot_features import (
    COLUMNS,
    GHOST_BEARING_COLUMNS,
    PELLET_BEARING_COLUMNS,
    Columns,
    Observation,
    features,
    features_stage,
    ghost_bearings,
    pellet_bearings,
)
from .situation import Situation

_BELIEF_MARGIN_M = 2.0  # how far a believed pose may lie outside the played part of the map ...
_BELIEF_MARGIN_SIGMAS = 9  # ... or this many standard deviations: a draw of 53 bits is off by 8.6 at most
#: Of every map: spaces are equal then.
_ANY_MAP = {"x": (-1e4, 1e4), "y": (-1e4, 1e4), "time": (0.0, 1e6), "pellets_left": (0.0, 1e4)}
FLAT = "flat"
MASK = "action_mask"  # in every observation whose actions are candidates, whatever its kinds


class ObservationPart(NamedTuple):
    """One array of an observation of one game."""

    low: float | NDArray[Any]  # least value, or that of each element
    high: float | NDArray[Any]
    shape: tuple[int, ...]
    dtype: type[np.generic]
    columns: Columns = ()  # of its last axis: name, low, high, unit
    by_candidate: bool = False  # its first axis is the candidates


class ObservationKind(Protocol):
    """One kind; it keeps nothing from one observation to the next."""

    name: str

    def parts(self, batch: GameBatch) -> dict[str, ObservationPart]:
        """The arrays that it adds, by key."""

    def fill(self, batch: GameBatch, situation: Situation) -> Observation:
        """Each of them for all games, ``(N, *shape)``, as new arrays; ``situation`` is the batch's own, as now."""


def bounds(batch: GameBatch) -> dict[str, tuple[float, float]]:
    """Bounds of the columns that depend on the map or the configuration; with the nearest candidates, on neither."""
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
    """Which candidates may be chosen."""
    return ObservationPart(0, 1, (batch.candidates,), np.int8, by_candidate=True)


@dataclass
class _Kind:
    name: str
    parts: Callable[[GameBatch], dict[str, ObservationPart]]
    fill: Callable[[GameBatch, Situation], Observation]

    def __call__(self) -> _Kind:
        return self  # where other packages have a class


@dataclass
class CompiledKind(_Kind):
    """A kind that a kernel fills, in the same call as the ticks of a step."""

    #: From a batch, its situation, the candidates wanted (N, C) and the kind's arrays: the stage that fills these.
    stage: Callable[[GameBatch, Situation, NDArray[np.bool_], Observation], Stage]
    #: Called after games have changed to the maps in these slots.
    maps_changed: Callable[[Situation, NDArray[np.int64]], None] | None = None
    #: Called where the stage returns less than 0, which then runs again.
    maps_wanted: Callable[[Situation], None] | None = None


def _table_part(
    columns: Columns, rows: tuple[int, ...], known: Mapping[str, tuple[float, float]] | None = None
) -> ObservationPart:
    """Rows of these columns; ``known`` are bounds that replace those of columns, by name."""
    low, high = np.array([(known or {}).get(name, limits) for name, *limits, _ in columns], dtype=np.float32).T
    shape = *rows, len(columns)
    return ObservationPart(np.broadcast_to(low, shape), np.broadcast_to(high, shape), shape, np.float32, columns)


def _feature_parts(batch: GameBatch) -> dict[str, ObservationPart]:
    known, ghosts = bounds(batch), len(batch.config.clyde.ghosts)
    rows = {"candidates": (batch.candidates,), "ghosts": (ghosts,)}
    parts = {key: _table_part(columns, rows.get(key, ()), known) for key, columns in COLUMNS.items()}
    parts["candidates"] = parts["candidates"]._replace(by_candidate=True)
    if ghosts == 1:
        del parts["ghosts"]
    return parts


def _features(batch: GameBatch, situation: Situation) -> Observation:
    return features(situation)


def _planner_parts(batch: GameBatch) -> dict[str, ObservationPart]:
    shape = batch.candidates, len(CANDIDATE_FEATURES)
    return {
        "planner_candidates": ObservationPart(-MOST, MOST, shape, np.float32, by_candidate=True),
        "planner_globals": ObservationPart(-MOST, MOST, (len(GLOBAL_FEATURES),), np.float32),
    }


def _planner(batch: GameBatch, situation: Situation) -> Observation:
    candidates, whole = planner_features(situation, batch.config.robot.speed_mps)
    return {"planner_candidates": candidates, "planner_globals": whole}


def _planner_stage(batch: GameBatch, situation: Situation, wanted: NDArray[np.bool_], arrays: Observation) -> Stage:
    filled = arrays["planner_candidates"], arrays["planner_globals"]
    return planner_stage(situation, batch.config.robot.speed_mps, wanted, *filled)


def _bearing_parts(batch: GameBatch) -> dict[str, ObservationPart]:
    pellets, ghosts = batch.config.observation.nearest_pellets, len(batch.config.clyde.ghosts)
    return {
        "pellet_bearings": _table_part(PELLET_BEARING_COLUMNS, (pellets,)),
        "ghost_bearings": _table_part(GHOST_BEARING_COLUMNS, (ghosts,)),
    }


def _bearings(batch: GameBatch, situation: Situation) -> Observation:
    pellets = pellet_bearings(situation, batch.config.observation.nearest_pellets)
    return {"pellet_bearings": pellets, "ghost_bearings": ghost_bearings(situation)}


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
    ghosts = np.ascontiguousarray(situation.ghosts[:, :, :2])
    lengths = config.grid_pixel_m, batch.config.robot.radius_m
    pellets = situation.position, batch.alive
    raster_all(batch.levels.addresses, level, situation.robot, pellets, ghosts, lengths, images)
    return {"grid": images}


FEATURES = CompiledKind(
    "features", _feature_parts, _features, lambda batch, situation, wanted, arrays: features_stage(situation, arrays)
)
PLANNER = CompiledKind("planner", _planner_parts, _planner, _planner_stage, maps_changed, maps_wanted)
SCAN, BEARINGS = _Kind("scan", _scan_parts, _scan), _Kind("bearings", _bearing_parts, _bearings)
GRID = _Kind("grid", _grid_parts, _grid)
#: Kinds as classes, made without arguments; other packages add theirs as entry points.
KINDS: Registry[Callable[[], ObservationKind]] = Registry(
    "observation kind",
    "pacman_env.observations",
    {kind.name: kind for kind in (FEATURES, SCAN, BEARINGS, GRID, PLANNER)},
)
register_observation = KINDS.register


def kinds_shown(config: ObservationConfig, action: str) -> list[str]:
    """The kinds asked for, and bearings where path lengths (features, planner features) or a scan are too little."""
    kinds = set(config.kinds)
    steers = action == "velocity" and bool(kinds & {FEATURES.name, PLANNER.name})
    return sorted(kinds | ({BEARINGS.name} if steers or SCAN.name in kinds else set()))
