"""Compose the observations of a batch: arrays are allocated once, and kernels write them at each step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property, partial
from types import SimpleNamespace
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray

from ..config import Config, ConfigError, ObservationConfig, located
from ..engine.arrays import Table, address
from ..engine.pipeline import Pipeline, Stage
from ..plugins import PluginError
from ..sim.batch import GameBatch
from ..sim.ticks import candidates_of
from . import learner_layout
from .kinds import FLAT, KINDS, MASK, CompiledKind, ObservationPart, kinds_shown, mask_part
from .learner_layout import MISSING, PART, CandidateArrays, NearestCounts, RowArrays, list_candidates, write_rows
from .robot_features import Observation, unit_scale
from .situation import Situation, maps_of
from .situation_writer import new_situation, situation_stage


class Observer:
    """Observes one batch; ``parts`` describes the arrays of one game by key (flat observations only have ``FLAT``).

    ``situation`` is the input: the batch as the robot or a ghost sees it, or a situation from elsewhere. ``result`` is
    the observation, (N, ...) per key, which the next one overwrites.
    """

    def __init__(self, batch: GameBatch, config: ObservationConfig | None = None, *, ghost: bool = False) -> None:
        """Prepare the kinds of ``config`` (None: the batch's); ghosts always choose candidates. Raises ConfigError."""
        self._made_from = partial(Observer, ghost=ghost), (batch, config)
        self._batch = batch
        self._config = config = batch.config.observation if config is None else config
        self.nearest = (
            NearestCounts(config.nearest_pellets, config.nearest_refuges) if config.candidates == "nearest" else None
        )
        action = "goal" if ghost else batch.config.action
        self._masked = action == "goal" and config.mask == "observation"
        if self.nearest and action != "goal":
            raise ConfigError("observation.candidates = 'nearest': velocities choose no candidate")
        with located(f"observation.kinds = {config.kinds!r}", caught=PluginError):
            self._kinds = [KINDS.find(name)() for name in kinds_shown(config, action, batch.config.power.pellets > 0)]
        self._raw_parts: dict[str, ObservationPart] = {MASK: mask_part(batch)} if self._masked else {}
        for kind in self._kinds:
            for key, part in kind.parts(batch).items():
                if key in self._raw_parts:
                    raise ConfigError(f"observation kind {kind.name!r}: {key!r} is in the observation already")
                self._raw_parts[key] = part
        own_parts = self._raw_parts
        if self.nearest:
            own_parts = {key: _listed(key, part, self.nearest.count) for key, part in own_parts.items()}
        self._unscaled = own_parts
        if config.normalize:
            for key, part in own_parts.items():
                _check_scalable(key, part)
            unit: dict[str, Any] = {"low": -1.0, "high": 1.0, "dtype": np.float32}
            own_parts = {key: part if key == MASK else part._replace(**unit) for key, part in own_parts.items()}
        self.parts = {FLAT: _flattened(own_parts)} if config.flat else own_parts
        self._compiled = [kind for kind in self._kinds if isinstance(kind, CompiledKind)]
        self._filled = [kind for kind in self._kinds if not isinstance(kind, CompiledKind)]
        self._pipelines: dict[Any, tuple[int, Pipeline]] = {}  # with the state for which they were built
        n, candidates, listed = batch.n, batch.candidates, self.nearest.count if self.nearest else 0
        #: Input arrays of the observation; each observation overwrites them.
        self.situation = new_situation(batch)
        #: Listed candidates (N, K); (N, 0) means all candidates in their own order.
        self.order = np.full((n, listed), MISSING, dtype=np.int64)
        #: Mask of the allowed actions, 0 or 1: (N, C), or (N, K) for listed candidates.
        self.allowed = np.zeros((n, listed or candidates), dtype=np.int8)
        self._wanted = np.zeros((n, candidates), dtype=np.bool_)

    def __reduce__(self) -> tuple[Any, ...]:
        return self._made_from

    @property
    def by_python(self) -> bool:
        """Return True if :meth:`finish` has to fill kinds of observation that are not compiled."""
        return bool(self._filled)

    @property
    def listed(self) -> NDArray[np.int64] | None:
        """Listed candidates (N, K), or None for all candidates in their own order."""
        return self.order if self.nearest else None

    @cached_property
    def _raw(self) -> Observation:
        """Return the arrays (N, ...) that the observation kinds fill, with all candidates."""
        arrays = {}
        for key, part in self._raw_parts.items():
            if key != MASK:
                dtype = np.float32 if self._config.flat or self._changes(key) else part.dtype
                arrays[key] = np.zeros((self._batch.n, *part.shape), dtype)
        return arrays

    @cached_property
    def result(self) -> Observation:
        """Arrays of the observation; a kind writes them directly unless they are scaled, listed or flattened."""
        if self._config.flat:
            return {FLAT: np.zeros((self._batch.n, *self.parts[FLAT].shape), dtype=np.float32)}
        shown = ({MASK: self.allowed} if self._masked else {}) | self._raw
        changed = {key: part for key, part in self.parts.items() if self._changes(key)}
        return shown | {key: np.zeros((self._batch.n, *part.shape), np.float32) for key, part in changed.items()}

    @cached_property
    def first_game(self) -> tuple[Observation, NDArray[np.int8]]:
        """``result`` and ``allowed`` of the first game."""
        return {key: array[0] for key, array in self.result.items()}, self.allowed[0]

    def _changes(self, key: str) -> bool:
        """Return True if the array ``key`` is scaled or reduced to listed candidates."""
        listed = self.nearest is not None and self._raw_parts[key].by_candidate
        return key != MASK and (self._config.normalize or listed)

    def pipeline(self, player: int = -1, before: Callable[[], list[Stage]] | None = None) -> Pipeline:
        """Return the pipeline of the stages ``before`` and the observation, which :meth:`finish` must complete.

        Pipelines are cached, and rebuilt when the arrays that they use are replaced.
        """
        batch, name = self._batch, (player, before is None)  # a reference to the function would keep its owner alive
        if name not in self._pipelines or self._pipelines[name][0] != batch.levels.most_goals:
            stages = [] if before is None else before()
            stages.append(situation_stage(batch, self.situation, player))
            self._pipelines[name] = batch.levels.most_goals, Pipeline([*stages, *self._stages()], batch.threads)
        return self._pipelines[name][1]

    def _stages(self) -> list[Stage]:
        """Return the stages that observe ``situation``."""
        kinds = [kind.stage(self._batch, self.situation, self._wanted, self._raw) for kind in self._compiled]
        return [self._list_stage, *kinds, *([] if self._filled else self._row_stages)]

    @classmethod
    def of(cls, situation: Situation, config: Config) -> Self:
        """Return an observer that has observed situations without a batch, for example of a robot.

        Only kinds that are computed from a situation alone are possible. Raises ValueError without maps.
        """
        n, candidates = situation.mask.shape
        shared = {"ghosts": situation.ghosts, "levels": maps_of(situation), "threads": situation.threads}
        batch: Any = SimpleNamespace(config=config, n=n, candidates=candidates, **shared)
        observer = cls(batch)
        observer.situation = situation.copy()
        Pipeline(observer._stages(), situation.threads).run(n)
        observer.finish()
        return observer

    def observe(self, player: int = -1, index: NDArray[np.int64] | None = None) -> Observation:
        """Observe all games, or the games ``index`` (M,), as the robot (-1) or a ghost, and return ``result``."""
        look = self.pipeline(player)
        if index is None:
            look.run(self._batch.n)
        else:
            look.run_some(index)
        return self.finish()

    def finish(self) -> Observation:
        """Complete the observation after its pipeline has run, and return ``result``.

        Kinds of observation that are not compiled are filled here; then the rows are written here, too.
        """
        if self._filled:
            for kind in self._filled:
                for key, array in kind.fill(self._batch, self.situation).items():
                    self._raw[key][...] = array
            for job, tables in self._row_stages:
                self._batch.threads.run(job, tables, self._batch.n)
        return self.result

    def actions_of(self, candidates: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.bool_]]:
        """Return the action (N,) of each candidate (hold if it is not listed) and a mask of the listed ones."""
        if self.listed is None:
            return candidates, np.ones(len(candidates), dtype=np.bool_)
        matches = (self.listed == candidates[:, None]) & (self.listed != MISSING)
        listed = matches.any(axis=1)
        return np.where(listed, matches.argmax(axis=1), self.listed.shape[1] - 1), listed

    def chosen(self, actions: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.bool_]]:
        """Return the candidate (N,) of each action (hold if forbidden) and a mask of the forbidden ones."""
        chosen: tuple[NDArray[Any], NDArray[np.bool_]] = candidates_of(
            np.asarray(actions, dtype=np.int64), self.situation.mask, self.order, self._batch.hold
        )
        return chosen

    def maps_changed(self, games: NDArray[np.int64]) -> None:
        """Prepare the observation kinds for the new maps of the games (M,)."""
        slots = self._batch.games["level"][games]
        self.situation.level[games] = slots
        for kind in self._compiled:
            if kind.maps_changed is not None:
                kind.maps_changed(self.situation, slots)

    @cached_property
    def _list_stage(self) -> Stage:
        s, nearest = self.situation, self.nearest or NearestCounts(0, 0)
        table = Table(
            CandidateArrays,
            kind=s.kind,
            mask=s.mask,
            path_robot=s.path_robot,
            current=s.current,
            listed=self.order,
            wanted=self._wanted,
            allowed=self.allowed,
            room=np.array([nearest.pellets, nearest.refuges], dtype=np.int64),
        )
        return list_candidates, [table]

    @cached_property
    def _row_stages(self) -> list[Stage]:
        """List with the stage that scales, lists and flattens the arrays; empty if nothing has to change."""
        parts, scales, at = [], [np.zeros((2, 0), dtype=np.float32)], 0
        for key, part in self._unscaled.items():
            width, raw = int(np.prod(part.shape)), self.allowed if key == MASK else self._raw[key]
            if self._config.flat or self._changes(key):
                columns = int(np.prod(part.shape[1:])) if part.by_candidate else width
                own = self.result[FLAT if self._config.flat else key]
                by, numbers = _scale(key, part, self._config.normalize, self._batch.config.time_limit_s)
                listed = self.nearest is not None and part.by_candidate and key != MASK
                parts.append(
                    (
                        *(address(raw), raw[0].size, raw.dtype == np.int8, width // columns, columns, listed, by),
                        *(sum(s.shape[1] for s in scales), address(own) + 4 * at, own[0].size),
                    )
                )
                scales.append(numbers)
            at += width if self._config.flat else 0
        first, second = np.concatenate(scales, axis=1)
        table = Table(RowArrays, parts=np.array(parts, dtype=PART), listed=self.order, first=first, second=second)
        return [(write_rows, [table])] if parts else []


def _scale(key: str, part: ObservationPart, normalize: bool, time_limit_s: float) -> tuple[int, NDArray[np.float32]]:
    """Return the scale type of an array and the two scale values (2, ...) of each element."""
    if not normalize or key == MASK:
        return learner_layout.NOT, np.zeros((2, int(np.prod(part.shape))), dtype=np.float32)
    if part.columns:
        numbers = unit_scale(part.columns, time_limit_s)
        return learner_layout.BY_UNIT, np.tile(numbers, int(np.prod(part.shape[:-1])))
    low, high = (np.broadcast_to(side, part.shape).astype(np.float32).ravel() for side in (part.low, part.high))
    return learner_layout.BETWEEN_BOUNDS, np.stack([(low + high) / 2, np.maximum((high - low) / 2, np.float32(1e-6))])


def _check_scalable(key: str, part: ObservationPart) -> None:
    """Raise ConfigError for a part that cannot be scaled."""
    bounded = part.columns or (np.isfinite(part.low).all() and np.isfinite(part.high).all())
    if key != MASK and (part.dtype == np.uint8 or not bounded):
        raise ConfigError(f"observation.normalize: {key!r} has no bounds to divide by, or is a picture")


def _flattened(parts: Mapping[str, ObservationPart]) -> ObservationPart:
    for key, part in parts.items():
        if part.dtype == np.uint8:
            raise ConfigError(f"observation.flat: {key!r} is a picture, which is not laid out as numbers in a row")
    ends = [(np.broadcast_to(p.low, p.shape).ravel(), np.broadcast_to(p.high, p.shape).ravel()) for p in parts.values()]
    low, high = (np.concatenate(side).astype(np.float32) for side in zip(*ends, strict=True))
    return ObservationPart(low, high, low.shape, np.float32)


def _listed(key: str, part: ObservationPart, count: int) -> ObservationPart:
    """Return a part with ``count`` candidates; missing ones are 0."""
    if not part.by_candidate:
        return part
    if key != MASK and part.dtype != np.float32:
        raise ConfigError(f"observation.candidates = 'nearest': {key!r} is {np.dtype(part.dtype)}, must be float32")
    shape = (count, *part.shape[1:])
    low = np.minimum(np.broadcast_to(part.low, part.shape)[:1], 0)
    high = np.maximum(np.broadcast_to(part.high, part.shape)[:1], 0)
    return part._replace(low=np.broadcast_to(low, shape), high=np.broadcast_to(high, shape), shape=shape)
