"""The observations of a batch's games: prepared once, written in place by kernels at each step."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...config import ConfigError, ObservationConfig
from ...engine.arrays import Table, address
from ...engine.pipeline import Pipeline, Stage
from ...plugins import PluginError
from ..core.batch import GameBatch, situation_stage
from .kinds import FLAT, KINDS, MASK, CompiledKind, ObservationPart, kinds_shown, mask_part
from .robot_features import Observation, unit_scale
from .rows import BETWEEN_BOUNDS, BY_UNIT, NOT, PART, CandidateArrays, RowArrays, list_candidates, write_rows
from .situation import MISSING, Nearest, Situation, at_places


class Observer:
    """Make the observations of one batch; ``parts`` are the arrays of one game by key (flat: ``FLAT`` alone).

    All arrays are made once. ``situation`` is what the observation is made of: the batch's as the robot or a ghost sees
    it, or one from elsewhere. ``result`` is the observation, (N, ...) per key, until the next one is made.
    """

    def __init__(self, batch: GameBatch, config: ObservationConfig | None = None, *, ghost: bool = False) -> None:
        """``config`` replaces the batch's own; a ``ghost`` chooses candidates always. Raises ConfigError."""
        self._made_from = batch, config, ghost
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
        self._raw_parts: dict[str, ObservationPart] = {MASK: mask_part(batch)} if self._masked else {}
        for kind in self._kinds:
            for key, part in kind.parts(batch).items():
                if key in self._raw_parts:
                    raise ConfigError(f"observation kind {kind.name!r}: {key!r} is in the observation already")
                self._raw_parts[key] = part
        found = self._raw_parts
        if self.nearest:
            found = {key: _listed(key, part, self.nearest.count) for key, part in found.items()}
        self._unscaled = found
        if config.normalize:
            for key, part in found.items():
                _check_scalable(key, part)
            unit: dict[str, Any] = {"low": -1.0, "high": 1.0, "dtype": np.float32}
            found = {key: part if key == MASK else part._replace(**unit) for key, part in found.items()}
        self.parts = {FLAT: _flattened(found)} if config.flat else found
        self._compiled = [kind for kind in self._kinds if isinstance(kind, CompiledKind)]
        self._pipelines: dict[Any, tuple[tuple[int, int], Pipeline]] = {}  # with what they are made for
        self._filled = [kind for kind in self._kinds if not isinstance(kind, CompiledKind)]

    def __getstate__(self) -> tuple[Any, ...]:
        return self._made_from

    def __setstate__(self, state: tuple[Any, ...]) -> None:
        batch, config, ghost = state
        self.__init__(batch, config, ghost=ghost)  # type: ignore[misc]

    @cached_property
    def situation(self) -> Situation:
        """Return the arrays that the observation is made from; each observation overwrites them."""
        batch = self._batch
        return Situation.empty(batch.n, batch.candidates, batch.ghosts.shape[1], batch.levels, batch.threads)

    @cached_property
    def order(self) -> NDArray[np.int64]:
        """Return the candidates as ``listed``; (N, 0): all, by their numbers."""
        return np.full((self._batch.n, self.nearest.count if self.nearest else 0), MISSING, dtype=np.int64)

    @property
    def listed(self) -> NDArray[np.int64] | None:
        """Return the candidates in their order now, (N, K); None: all, by their numbers."""
        return self.order if self.nearest else None

    @cached_property
    def allowed(self) -> NDArray[np.int8]:
        """Return which actions may be chosen now, 0 or 1: (N, C), or (N, K) of listed candidates."""
        return np.zeros((self._batch.n, self.nearest.count if self.nearest else self._batch.candidates), dtype=np.int8)

    @cached_property
    def _wanted(self) -> NDArray[np.bool_]:
        return np.zeros((self._batch.n, self._batch.candidates), dtype=np.bool_)

    @cached_property
    def _raw(self) -> Observation:
        """Make the arrays that the kinds fill, (N, ...) of all candidates."""
        made = {}
        for key, part in self._raw_parts.items():
            if key != MASK:
                dtype = np.float32 if self._config.flat or self._changes(key) else part.dtype
                made[key] = np.zeros((self._batch.n, *part.shape), dtype)
        return made

    @cached_property
    def result(self) -> Observation:
        """Make the observation's arrays; a kind fills them itself where nothing is scaled, listed or laid out."""
        if self._config.flat:
            return {FLAT: np.zeros((self._batch.n, *self.parts[FLAT].shape), dtype=np.float32)}
        shown = ({MASK: self.allowed} if self._masked else {}) | self._raw
        made = {key: part for key, part in self.parts.items() if self._changes(key)}
        return shown | {key: np.zeros((self._batch.n, *part.shape), np.float32) for key, part in made.items()}

    @cached_property
    def first_game(self) -> tuple[Observation, NDArray[np.int8]]:
        """Return ``result`` and ``allowed`` of the first game."""
        return {key: array[0] for key, array in self.result.items()}, self.allowed[0]

    def _changes(self, key: str) -> bool:
        """Return whether an array is scaled or listed."""
        listed = self.nearest is not None and self._raw_parts[key].by_candidate
        return key != MASK and (self._config.normalize or listed)

    def pipeline(self, player: int = -1, before: Callable[[], list[Stage]] | None = None) -> Pipeline:
        """Return what observes the games as :meth:`observe` does, but for :meth:`finish`, after the stages ``before``.

        It is kept, and made again when arrays that it works on have been replaced.
        """
        batch, name = self._batch, (player, before is None)  # not the function: its owner would be kept alive
        if name not in self._pipelines or self._pipelines[name][0] != (batch.revision, batch.levels.most_goals):
            stages = [] if before is None else before()
            stages.append(situation_stage(batch, self.situation, player))
            stages.append(self._list_stage)
            stages += [kind.stage(batch, self.situation, self._wanted, self._raw) for kind in self._compiled]
            stages += [] if self._filled else self._row_stages
            self._pipelines[name] = (batch.revision, batch.levels.most_goals), Pipeline(stages, batch.threads)
        return self._pipelines[name][1]

    def observe(self, player: int = -1, index: NDArray[np.int64] | None = None) -> Observation:
        """Observe the batch's games as the robot (-1) or a ghost sees them now, or only the games ``index`` (M,).

        Returns ``result``.
        """
        look = self.pipeline(player)
        while (look.run(self._batch.n) if index is None else look.run_some(index)) < 0:
            self.maps_wanted()
        return self.finish()

    def finish(self) -> Observation:
        """Fill in the kinds that Python makes and lay the observation out, after the stages; returns ``result``."""
        if self._filled:
            for kind in self._filled:
                self._fill(kind, self.situation)
            self._lay_out.run(self._batch.n)
        return self.result

    def actions_of(self, candidates: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.bool_]]:
        """Return the actions (N,) that stand for candidates (hold where none does), and whether one does."""
        if self.listed is None:
            return candidates, np.ones(len(candidates), dtype=np.bool_)
        there = (self.listed == candidates[:, None]) & (self.listed != MISSING)
        listed = there.any(axis=1)
        return np.where(listed, there.argmax(axis=1), self.listed.shape[1] - 1), listed

    def chosen(self, actions: NDArray[Any]) -> tuple[NDArray[Any], NDArray[np.bool_]]:
        """Return the candidates (N,) that actions stand for (hold where forbidden), and whether each is forbidden."""
        if self.listed is None:
            return actions, ~self.situation.mask[np.arange(self._batch.n), actions]
        return at_places(self.listed, actions, self._batch.hold)

    def look_at(self, situation: Situation) -> None:
        """Make the observation of as many situations from elsewhere; ``situation`` is a copy of them then."""
        self.situation.block()[0][:] = situation.block()[0]
        Pipeline([self._list_stage], situation.threads).run(len(situation))
        for kind in self._kinds:
            self._fill(kind, situation)
        self._lay_out.run(len(situation))

    def _fill(self, kind: Any, situation: Situation) -> None:
        for key, array in kind.fill(self._batch, situation).items():
            self._raw[key][...] = array

    def maps_changed(self, games: NDArray[np.int64]) -> None:
        """Prepare what the kinds need of the maps that these games (M,) have changed to."""
        slots = self._batch.games["level"][games]
        self.situation.level[games] = slots
        for kind in self._compiled:
            if kind.maps_changed is not None:
                kind.maps_changed(self.situation, slots)

    def maps_wanted(self) -> None:
        """Prepare what a stage has asked for by a result below 0."""
        for kind in self._compiled:
            if kind.maps_wanted is not None:
                kind.maps_wanted(self.situation)

    @cached_property
    def _lay_out(self) -> Pipeline:
        return Pipeline(self._row_stages, self._batch.threads)

    @cached_property
    def _list_stage(self) -> Stage:
        s, nearest = self.situation, self.nearest or Nearest(0, 0)
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
        """Return the stage that scales, lists and lays out, if there is something to do."""
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
    """Return how an array is scaled, and the two numbers (2, ...) of each of its elements."""
    if not normalize or key == MASK:
        return NOT, np.zeros((2, int(np.prod(part.shape))), dtype=np.float32)
    if part.columns:
        numbers = unit_scale(part.columns, time_limit_s)
        return BY_UNIT, np.tile(numbers, int(np.prod(part.shape[:-1])))
    low, high = (np.broadcast_to(side, part.shape).astype(np.float32).ravel() for side in (part.low, part.high))
    return BETWEEN_BOUNDS, np.stack([(low + high) / 2, np.maximum((high - low) / 2, np.float32(1e-6))])


def _check_scalable(key: str, part: ObservationPart) -> None:
    """Raise ConfigError for a part without a scale."""
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
    """Return a part with ``count`` candidates, some of which may be missing: 0."""
    if not part.by_candidate:
        return part
    if key != MASK and part.dtype != np.float32:
        raise ConfigError(f"observation.candidates = 'nearest': {key!r} is {np.dtype(part.dtype)}, must be float32")
    shape = (count, *part.shape[1:])
    low = np.minimum(np.broadcast_to(part.low, part.shape)[:1], 0)
    high = np.maximum(np.broadcast_to(part.high, part.shape)[:1], 0)
    return part._replace(low=np.broadcast_to(low, shape), high=np.broadcast_to(high, shape), shape=shape)
