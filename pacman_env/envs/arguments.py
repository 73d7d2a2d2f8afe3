"""The arguments of every environment, and all that follows from them: a configuration, maps, the policies of ghosts."""

from __future__ import annotations

import functools
import inspect
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np

from ..config import Config, ConfigError, make_config
from ..game.ghosts import GHOST_NAMES, POLICY, behaviour_names
from ..plugins import PluginError
from ..policies.base import Policy
from ..policies.registry import make_policy, policy_names
from ..sim.maps.assets import MapSource, map_assets
from ..sim.maps.generated import GeneratedMaps
from ..sim.maps.level_source import FixedMap, LevelSource
from ..sim.observation.kinds import FLAT, KINDS
from ..world.maps.occupancy import OccupancyMap

#: How many wander, or for each a behaviour or a policy of his own.
Ghosts = int | str | Policy | Sequence[str | Policy]


@dataclass(frozen=True)
class EnvArguments:
    """All environments take these; :class:`~pacman_env.envs.pacmanbot.PacManBotEnv` describes each."""

    map: MapSource = "house"
    preset: str = "robot"
    execution: str = "robust"
    _: KW_ONLY
    ghosts: Ghosts | None = None
    observation: str | Sequence[str] | None = None
    candidates: str | None = None
    normalize: bool | None = None
    mask: str | None = None
    decide: str | None = None
    numeric_info: bool = False
    timeout: str = "truncation"
    action: str | None = None
    action_range: str | None = None
    endless: bool | None = None
    start_level: int | None = None
    num_levels: int | None = None
    settings: Mapping[str, Any] | None = None
    config: Config | None = None
    home: tuple[float, float, float] | None = None
    render_mode: str | None = None

    def make_config(self) -> tuple[Config, dict[int, Policy]]:
        """The configuration, and the policies by the ghost's number.

        Raises:
            ConfigError: ``config`` together with what it replaces, an unknown name, or a value out of range.
        """
        config, settings = self.config, self.settings or {}
        if config is not None and not isinstance(config, Config):
            raise ConfigError(f"config = {config!r}: must be a Config")
        if not (isinstance(settings, Mapping) and all(isinstance(key, str) for key in settings)):
            raise ConfigError(f"settings = {settings!r}: must be values by the dotted names of fields")
        behaviours, policies = _behaviours(self.ghosts)
        changes: dict[str, Any] = {} if self.observation is None else _kinds(self.observation)
        given = {"clyde.ghosts": behaviours, "action": self.action, "endless": self.endless}
        given |= {"decisions.when": self.decide, "observation.candidates": self.candidates}
        given |= {"observation.normalize": self.normalize, "observation.mask": self.mask}
        given |= {"action_range": self.action_range}
        changes |= {name: value for name, value in given.items() if value is not None}
        if config is not None:
            if settings or changes or (self.preset, self.execution) != ("robot", "robust"):
                raise ConfigError("give either config or the arguments that make one, not both")
            return config, policies
        for name in sorted(changes.keys() & settings.keys()):
            raise ConfigError(f"{name} is given twice: as an argument and in settings")
        return make_config(self.preset, self.execution, **changes, **settings), policies

    def timeout_ends(self) -> bool:
        """Whether a time-out is an end of the game's own, by its reward, and not a cut from outside.

        Raises:
            ConfigError: it is neither.
        """
        if self.timeout not in ("truncation", "termination"):
            raise ConfigError(f"timeout = {self.timeout!r}: choose truncation or termination")
        return self.timeout == "termination"

    def make_source(self, config: Config) -> LevelSource:
        """The maps: ``generated`` ones, ``generated:test``, or one map.

        Raises:
            ConfigError: levels of a map that has none, or levels out of range.
            MapError: the map cannot be read or played on.
        """
        if not isinstance(self.map, (str, os.PathLike, OccupancyMap)):
            raise ConfigError(f"map = {self.map!r}: must be a name, a YAML file or an OccupancyMap")
        name = os.fspath(self.map) if isinstance(self.map, (str, os.PathLike)) else ""
        if name.partition(":")[0] == "generated":
            if self.home is not None:
                raise ConfigError("home: generated houses have home poses of their own")
            return GeneratedMaps.named(name, config, self.start_level, self.num_levels)
        if self.start_level is not None or self.num_levels is not None:
            raise ConfigError("start_level and num_levels are for map='generated'")
        return FixedMap(map_assets(self.map, config, self.home), config)


def takes_env_arguments(init: Callable[..., None]) -> Callable[..., None]:
    """``__init__`` of an environment, called with the fields of :class:`EnvArguments` in place of ``arguments``.

    Its signature names them all, so that ``help`` shows them.
    """
    shared = inspect.signature(EnvArguments).parameters
    own = inspect.signature(init)
    parameters = [*(p for name, p in own.parameters.items() if name != "arguments"), *shared.values()]
    signature = own.replace(parameters=sorted(parameters, key=lambda p: p.kind))

    @functools.wraps(init)
    def wrapper(*given: Any, **named: Any) -> None:
        bound = signature.bind(*given, **named).arguments
        arguments = EnvArguments(**{name: bound.pop(name) for name in shared if name in bound})
        init(**bound, arguments=arguments)

    wrapper.__signature__ = signature  # type: ignore[attr-defined]
    return wrapper


def _behaviours(ghosts: Ghosts | None) -> tuple[tuple[str, ...] | None, dict[int, Policy]]:
    if ghosts is None:
        return None, {}
    each: Any = [ghosts] if isinstance(ghosts, str) or hasattr(ghosts, "select") else ghosts
    if isinstance(ghosts, (int, np.integer)) and not isinstance(ghosts, bool):
        if not 1 <= ghosts <= len(GHOST_NAMES):
            raise ConfigError(f"ghosts = {ghosts}: must be 1 to {len(GHOST_NAMES)}")
        each = ("wander",) * int(ghosts)
    if not isinstance(each, Sequence):
        raise ConfigError(f"ghosts = {ghosts!r}: must be a number, a behaviour, a policy, or a sequence of these")
    names, policies = [], {}
    for number, one in enumerate(each):
        if isinstance(one, str) and (one.endswith(".onnx") or (one in policy_names() and one not in behaviour_names())):
            one = make_policy(one)  # by name, so that Gymnasium's spec of the environment can be written to a file
        if isinstance(one, str):
            names.append(one)
        elif hasattr(one, "select") and hasattr(one, "reset") and not isinstance(one, type):
            names.append(POLICY)
            policies[number] = one
        else:
            known = ", ".join(name for name in behaviour_names() if name != POLICY)
            raise ConfigError(f"ghosts[{number}] = {one!r}: must be one of {known}, or an object with reset and select")
    return tuple(names), policies


def _kinds(observation: str | Sequence[str]) -> dict[str, Any]:
    several = isinstance(observation, Iterable) and not isinstance(observation, (str, Mapping))
    chosen: list[Any] = list(observation) if several else [observation]
    flat = FLAT in chosen
    if flat:
        chosen = [name for name in chosen if name != FLAT] or ["features"]
    if not chosen or not all(isinstance(name, str) for name in chosen):
        raise ConfigError(f"observation = {observation!r}: choose one or several of {', '.join(KINDS.names())}")
    try:
        for name in chosen:
            KINDS.find(name)
    except PluginError as error:
        raise ConfigError(f"observation = {observation!r}: {error}") from error
    return {"observation.kinds": tuple(chosen)} | ({"observation.flat": True} if flat else {})


def check_render_mode(render_mode: str | None, known: Sequence[str]) -> None:
    """Raise ValueError for a render mode that the environment does not have."""
    if render_mode is not None and render_mode not in known:
        raise ValueError(f"render_mode = {render_mode!r}: choose one of {known} or None")


def checked_games(num_envs: Any) -> int:
    """How many games; raises ValueError for what is no such number."""
    if not isinstance(num_envs, (int, np.integer)) or isinstance(num_envs, bool) or num_envs < 1:
        raise ValueError(f"num_envs = {num_envs!r}: must be a whole number of at least 1")
    return int(num_envs)
