"""Base class of all environments: games, spec, action masks and pictures, whatever the interface."""

import functools
import os
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..config import Config, ConfigError
from ..observations.situation import Situation
from ..sim.batch import GameBatch
from .arguments import EnvArguments, check_render_mode
from .game_runner import GameRunner
from .guard import Guarded, shared

_FIXED = ("observation_space", "action_space", "ghost_agents")  # settings of a reset must not change these


class BaseEnv(Guarded):
    """Base class of all environments; a :class:`GameRunner` plays their games."""

    metadata: dict[str, Any]
    render_mode: str | None
    _runner: GameRunner
    _spec: Any = None

    def _make_runner(self, n: int, arguments: EnvArguments, **more: Any) -> None:
        check_render_mode(arguments.render_mode, self.metadata["render_modes"])
        self._new_runner = functools.partial(GameRunner, n, arguments, **more)
        self._runner = self._new_runner()
        self.render_mode = arguments.render_mode

    @property
    def spec(self) -> Any:
        """Return the spec. Its arguments are plain JSON data, so that specs compare equal."""
        return self._spec

    @spec.setter
    def spec(self, spec: Any) -> None:
        if spec is not None:
            spec.kwargs = as_json(spec.kwargs)
        self._spec = spec

    @property
    def batch(self) -> GameBatch:
        """Return the simulator of all games, for example to read their state."""
        return self._runner.batch

    @property
    def config(self) -> Config:
        """Return the configuration of the games."""
        return self._runner.config

    @property
    def started(self) -> bool:
        """Return True after the first reset."""
        return self._runner.begun

    def _runner_with(self, settings: Mapping[str, Any]) -> GameRunner:
        """Return a runner with ``settings``; raises ConfigError if they change the spaces or the agents."""
        if settings == self._runner.settings:
            return self._runner
        runner = self._new_runner(settings=settings)
        if any(getattr(runner, name) != getattr(self._runner, name) for name in _FIXED):
            would = f"{', '.join(sorted(settings))} would change the spaces or agents"
            raise ConfigError(f"options['settings']: {would}; make an environment with them")
        return runner

    @property
    @shared
    def situation(self) -> Situation:
        """Return a copy of the situation of each game, as policies read it; raises ResetNeeded before a reset."""
        self._runner.require_reset()
        return self._runner.observer.situation.copy()

    @property
    def action_masks(self) -> Callable[[], NDArray[np.bool_]]:
        """Return a function that returns the current action mask; sb3-contrib calls it by this name.

        Masks are bool, (C,) or for a vector environment (N, C); ``action_space.sample`` needs them as int8. Raises
        AttributeError if actions are velocities, which have no mask.
        """
        if self.config.action != "goal":
            raise AttributeError("velocity actions have no masks")
        return self._masks

    @shared
    def action_of(self, candidates: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the actions (N,) for the candidates (N,) that a policy of this package chose.

        With ``observation.candidates="nearest"``, candidates that are not listed become the last action, hold. Raises
        AttributeError if actions are velocities, and ResetNeeded before the first reset.
        """
        if self.config.action != "goal":
            raise AttributeError("velocity actions choose no candidate")
        self._runner.require_reset()
        return self._runner.observer.actions_of(np.asarray(candidates))[0]

    @shared
    def _masks(self) -> NDArray[np.bool_]:
        self._runner.require_reset()
        return self._runner.observer.allowed != 0

    def _pictures(self) -> tuple[NDArray[np.uint8], ...] | None:
        """Return one picture (H, W, 3) uint8 per game, or None without a render mode."""
        if self.render_mode is None:
            return None
        from ..render.frames import render_frame

        return tuple(render_frame(self.batch, i) for i in range(self.batch.n))


def as_json(value: Any) -> Any:
    """Convert a configuration to a dict of settings, a path to text, arrays and tuples to lists; keep other values."""
    if isinstance(value, Config):
        value = value.as_settings()
    if isinstance(value, os.PathLike):
        value = os.fspath(value)
    if isinstance(value, Mapping):
        return {key: as_json(one) for key, one in value.items()}
    if isinstance(value, (np.ndarray, np.generic)):
        value = value.tolist()
    return [as_json(one) for one in value] if isinstance(value, (list, tuple)) else value
