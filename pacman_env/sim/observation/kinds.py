"""The kinds of observation: one object per kind, found by name, and the observations that several kinds make up."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from ...config import ConfigError, ObservationConfig
from ...plugins import PluginError, Registry
from ...world.navigation import lidar
from ..core.batch import GameBatch
from .planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES, MOST, planner_features
from .raster import CHANNELS, raster_all
from .robot_features import (
    COLUMNS,
    GHOST_BEARING_COLUMNS,
    PELLET_BEARING_COLUMNS,
    Columns,
    Observation,
    Scale,
    features,
    ghost_bearings,
    pellet_bearings,
)
from .situation import Nearest, Situation, in_order, nearest_candidates

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
    #: As ``fill``, with rows of the candidates in (N, K) alone, others are 0; None: rows cost nothing.
    fill_listed: Callable[[GameBatch, Situation, NDArray[np.int64]], Observation] | None = None

    def __call__(self) -> _Kind:
        return self  # where other packages have a class


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


def _planner(batch: GameBatch, situation: Situation, listed: NDArray[np.int64] | None = None) -> Observation:
    candidates, whole = planner_features(situation, batch.config.robot.speed_mps, listed)
    return {"planner_candidates": candidates, "planner_globals": whole}


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
    config, games, arrays = batch.config.observation, batch.games, batch.levels.arrays
    ranges = np.empty((batch.n, config.scan_rays), dtype=np.float32)
    pose = np.stack([games["x"], games["y"], games["heading"]], axis=1)
    level, seed, tick = (np.ascontiguousarray(games[name]) for name in ("level", "seed", "tick"))
    maps = lidar.Maps(arrays["affine"], arrays["clearance_cm"], arrays["shape"], batch.levels.resolution)
    sensor = lidar.Sensor(config.scan_minimum_m, config.scan_maximum_m, config.scan_noise)
    lidar.scan(maps, lidar.Robots(level, pose, seed, tick), sensor, ranges)
    return {"scan": ranges}


def _grid_parts(batch: GameBatch) -> dict[str, ObservationPart]:
    size = batch.config.observation.grid_pixels
    return {"grid": ObservationPart(0, 255, (size, size, CHANNELS), np.uint8)}


def _grid(batch: GameBatch, situation: Situation) -> Observation:
    config, arrays = batch.config.observation, batch.levels.arrays
    images = np.empty((batch.n, config.grid_pixels, config.grid_pixels, CHANNELS), dtype=np.uint8)
    level = np.ascontiguousarray(batch.games["level"])
    maps = arrays["affine"], arrays["clearance_cm"], arrays["shape"], level
    ghosts = np.ascontiguousarray(situation.ghosts[:, :, :2])
    lengths = config.grid_pixel_m, batch.config.robot.radius_m
    raster_all(maps, situation.robot, situation.position, batch.alive, ghosts, *lengths, images)
    return {"grid": images}


FEATURES = _Kind("features", _feature_parts, _features)
SCAN, BEARINGS = _Kind("scan", _scan_parts, _scan), _Kind("bearings", _bearing_parts, _bearings)
GRID, PLANNER = _Kind("grid", _grid_parts, _grid), _Kind("planner", _planner_parts, _planner, _planner)
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


class Observer:
    """Builds the observations of one batch; ``parts`` are the arrays of one game by key (flat: ``FLAT`` alone)."""

    def __init__(self, batch: GameBatch, config: ObservationConfig | None = None, *, ghost: bool = False) -> None:
        """``config`` replaces the batch's own; a ``ghost`` chooses candidates always. Raises ConfigError."""
        self._batch = batch
        self._config = config = batch.config.observation if config is None else config
        self.nearest = (
            Nearest(config.nearest_pellets, config.nearest_refuges) if config.candidates == "nearest" else None
        )
        action = "goal" if ghost else batch.config.action
        self._masked = action == "goal" and config.mask == "observation"
        if self.nearest and action != "goal":
            raise ConfigError("observation.candidates = 'nearest': velocities choose no candidate")
        try:
            self._kinds = [KINDS.find(name)() for name in kinds_shown(config, action)]
        except PluginError as error:
            raise ConfigError(f"observation.kinds = {config.kinds!r}: {error}") from None
        found: dict[str, ObservationPart] = {MASK: mask_part(batch)} if self._masked else {}
        for kind in self._kinds:
            for key, part in kind.parts(batch).items():
                if key in found:
                    raise ConfigError(f"observation kind {kind.name!r}: {key!r} is in the observation already")
                found[key] = part
        batch.shows_features |= any(kind is FEATURES for kind in self._kinds)
        self._by_candidate = {key for key, part in found.items() if part.by_candidate}
        if self.nearest:
            found = {key: _listed(part, self.nearest.count) for key, part in found.items()}
        self._scales: dict[str, Callable[[NDArray[Any]], NDArray[Any]]] = {}
        if config.normalize:
            self._scales = {key: self._scale(key, part) for key, part in found.items() if key != MASK}
            unit: dict[str, Any] = {"low": -1.0, "high": 1.0, "dtype": np.float32}
            found = {key: part if key == MASK else part._replace(**unit) for key, part in found.items()}
        self.parts = {FLAT: self._flattened(found)} if config.flat else found

    def listed(self, situation: Situation) -> NDArray[np.int64] | None:
        """(N, K) the candidates in their order here; None: all, by their numbers."""
        return None if self.nearest is None else nearest_candidates(situation, self.nearest)

    def observe(self, situation: Situation, listed: NDArray[np.int64] | None = None) -> Observation:
        """Observations of all games, one new array (N, ...) per key, of the batch's own situation as it is now.

        ``listed`` is the result of :meth:`listed`, if that is known.
        """
        observation: Observation = {MASK: situation.mask.astype(np.int8)} if self._masked else {}
        if listed is None:
            listed = self.listed(situation)
        for kind in self._kinds:
            fill_listed = kind.fill_listed if isinstance(kind, _Kind) else None
            if listed is None or fill_listed is None:
                observation |= kind.fill(self._batch, situation)
            else:
                observation |= fill_listed(self._batch, situation, listed)
        if listed is not None:
            for key in self._by_candidate:
                observation[key] = in_order(observation[key], listed)
        observation = {key: self._scales[key](a) if key in self._scales else a for key, a in observation.items()}
        if not self._config.flat:
            return observation
        rows = [array.reshape(len(array), -1) for array in observation.values()]
        return {FLAT: np.concatenate(rows, axis=1, dtype=np.float32)}

    def _scale(self, key: str, part: ObservationPart) -> Callable[[NDArray[Any]], NDArray[Any]]:
        if part.columns:
            return Scale(part.columns, self._batch.config.time_limit_s)
        low, high = np.asarray(part.low, dtype=np.float32), np.asarray(part.high, dtype=np.float32)
        if part.dtype == np.uint8 or not (np.isfinite(low).all() and np.isfinite(high).all()):
            raise ConfigError(f"observation.normalize: {key!r} has no bounds to divide by, or is a picture")
        middle, half = (low + high) / 2, np.maximum((high - low) / 2, np.float32(1e-6))
        return partial(_within_1, middle=middle, half=half)

    def _flattened(self, parts: Mapping[str, ObservationPart]) -> ObservationPart:
        for key, part in parts.items():
            if part.dtype == np.uint8:
                raise ConfigError(f"observation.flat: {key!r} is a picture, which is not laid out as numbers in a row")
        ends = [
            (np.broadcast_to(p.low, p.shape).ravel(), np.broadcast_to(p.high, p.shape).ravel()) for p in parts.values()
        ]
        low, high = (np.concatenate(side).astype(np.float32) for side in zip(*ends, strict=True))
        return ObservationPart(low, high, low.shape, np.float32)


def _listed(part: ObservationPart, count: int) -> ObservationPart:
    """A part with so many candidates, some of which may be missing: 0."""
    if not part.by_candidate:
        return part
    shape = (count, *part.shape[1:])
    low = np.minimum(np.broadcast_to(part.low, part.shape)[:1], 0)
    high = np.maximum(np.broadcast_to(part.high, part.shape)[:1], 0)
    return part._replace(low=np.broadcast_to(low, shape), high=np.broadcast_to(high, shape), shape=shape)


def _within_1(array: NDArray[Any], middle: NDArray[Any], half: NDArray[Any]) -> NDArray[np.float32]:
    return np.clip((array - middle) / half, -1.0, 1.0).astype(np.float32)
