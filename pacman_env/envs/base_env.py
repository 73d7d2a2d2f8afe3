"""Base class of all environments: games, spec, action masks, snapshots and pictures, whatever the interface."""

import copy
import functools
import os
import reprlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .._version import __version__
from ..config import Config, ConfigError
from ..config.composition import differences
from ..levels.level_source import FixedMap
from ..observations.situation import Situation
from ..sim.batch import GameBatch
from .arguments import EnvArguments, check_render_mode
from .game_runner import GameRunner
from .guard import Guarded, exclusive, shared

_FIXED = ("observation_space", "action_space", "ghost_agents")  # settings of a reset must not change these


@dataclass(frozen=True, eq=False, repr=False)
class EnvState:
    """A snapshot of an environment, which can be pickled; its contents are private."""

    made_by: dict[str, Any]  # class, version and arguments, as plain data
    content: dict[str, Any]  # settings of the last reset, state of the runner, attributes of the environment


class BaseEnv(Guarded):
    """Base class of all environments; a :class:`GameRunner` plays their games."""

    metadata: dict[str, Any]
    render_mode: str | None
    _runner: GameRunner
    _spec: Any = None
    _own_state: tuple[str, ...]  # attributes that belong to a snapshot

    def _make_runner(self, n: int, arguments: EnvArguments, **more: Any) -> None:
        check_render_mode(arguments.render_mode, self.metadata["render_modes"])
        self._new_runner = functools.partial(GameRunner, n, arguments, **more)
        self._runner = self._new_runner()
        self._base_config = self._runner.config  # without settings of resets
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

    @exclusive
    def clone_state(self) -> EnvState:
        """Return a snapshot of everything that decides how this environment continues, later episodes included.

        It contains neither the generators of spaces nor the state of wrappers. Raises ResetNeeded before a reset.
        """
        self._runner.require_reset()
        own = {name: getattr(self, name) for name in self._own_state}
        content = {"settings": self._runner.settings, "games": self._runner.state(), "own": copy.deepcopy(own)}
        return EnvState(self._made_by, content)

    @exclusive
    def restore_state(self, state: EnvState) -> None:
        """Continue like the environment that made the snapshot ``state``, bit for bit; it can be used several times.

        The next action refers to the last observation before the snapshot. Policies of ghosts are replaced by copies.
        Raises ValueError, without any change, unless class, version and arguments of both environments are equal.
        """
        if not isinstance(state, EnvState):
            raise ValueError(f"state = {reprlib.repr(state)}: must be a result of clone_state()")
        differ = [
            f"{name} = {a!r} instead of {b!r}" for name, (a, b) in differences(state.made_by, self._made_by).items()
        ]
        if differ:
            raise ValueError(f"state: must be of an environment with the same arguments, has {', '.join(differ)}")
        runner = self._runner_with(state.content["settings"])
        runner.restore(state.content["games"])
        self._runner = runner
        vars(self).update(copy.deepcopy(state.content["own"]))

    @functools.cached_property
    def _made_by(self) -> dict[str, Any]:
        source, arguments = self.batch.source, self._new_runner.args[1]
        fixed = source.first.occupancy if isinstance(source, FixedMap) else None
        return {
            "class": type(self).__name__,
            "version": __version__,
            "num_envs": self.batch.n,
            "map": f"{fixed.name} {fixed.hash[:12]}" if fixed else str(arguments.map),
            "ghosts": [type(policy).__name__ for policy in self._runner.policies.values()],
            "max_episode_steps": self._new_runner.keywords.get("max_episode_steps"),
            "autoreset_mode": str(getattr(self, "autoreset_mode", None)),
            **self._base_config.as_dict(),
        }

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
