"""Arguments shared by all environments, and the configuration, maps and ghost policies that follow from them."""

import functools
import inspect
import os
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass
from typing import Any

import numpy as np

from ..config import Config, ConfigError, make_config
from ..game.ghosts import GHOST_NAMES, POLICY, behaviour_names
from ..levels.assets import MapSource, map_assets
from ..levels.level_source import FixedMap, GeneratedMaps, LevelSource
from ..observations.kinds import FLAT, KINDS
from ..plugins import PluginError
from ..policies.base import Policy
from ..policies.registry import make_policy, moved_by_policy
from ..world.maps.occupancy import OccupancyMap

#: A number of wandering ghosts, or a behaviour or policy for each ghost.
Ghosts = int | str | Policy | Sequence[str | Policy]

#: Settings of ``flat=True`` for environments with several agents, which all decide at each tick ...
_FLAT_OF_SEVERAL: dict[str, Any] = {
    "observation.kinds": ("features",),
    "observation.flat": True,
    "observation.normalize": True,
    "observation.mask": "beside",
    "observation.numeric_info": True,
    "timeout": "termination",
}
#: ... and for environments with one agent.
_FLAT: dict[str, Any] = {
    **_FLAT_OF_SEVERAL,
    "observation.kinds": ("planner",),
    "observation.mask": "method",
    "observation.candidates": "nearest",
    "decisions.when": "event",
}


@dataclass(frozen=True)
class EnvArguments:
    """Arguments of every environment; :class:`~pacman_env.envs.pacmanbot.PacManBotEnv` describes each."""

    map: MapSource = "house"
    _: KW_ONLY
    ghosts: Ghosts | None = None
    observation: str | Sequence[str] | None = None
    action: str | None = None
    preset: str = "robot"
    settings: Mapping[str, Any] | Config | None = None
    render_mode: str | None = None
    flat: bool = False
    defaults: Mapping[str, Any] | None = None

    def make_config(self, *, several: bool = False) -> tuple[Config, dict[int, Policy]]:
        """Return the configuration, for several agents if ``several``, and the policy objects by ghost number."""
        settings = {} if self.settings is None else self.settings
        behaviours, policies = _behaviours(self.ghosts)
        changes = {} if self.observation is None else _kinds(self.observation)
        changes |= {} if behaviours is None else {"clyde.ghosts": behaviours}
        changes |= {} if self.action is None else {"action": self.action}
        if isinstance(settings, Config):
            if changes or self.preset != "robot" or self.flat or self.defaults:
                raise ConfigError(
                    "settings is a Config: ghosts, observation, action, preset, flat and defaults are part of it"
                )
            return settings, policies
        below = {} if self.defaults is None else self.defaults
        for given, what, rule in (
            (settings, "settings", "must be values by the dotted names of fields, or a Config"),
            (below, "defaults", "must be values by the dotted names of fields"),
        ):
            if not (isinstance(given, Mapping) and all(isinstance(key, str) for key in given)):
                raise ConfigError(f"{what} = {given!r}: {rule}")
        for name in sorted(changes.keys() & settings.keys()):
            raise ConfigError(f"{name} is given twice: as an argument and in settings")
        if not isinstance(self.flat, bool):
            raise ConfigError(f"flat = {self.flat!r}: must be True or False")
        defaults = dict(_FLAT_OF_SEVERAL if several else _FLAT) if self.flat else {}
        if self.observation is not None:
            defaults.pop("observation.flat", None)  # "flat" is among the kinds or not
        if several and self.ghosts is None:
            defaults["clyde.ghosts"] = ("policy",)
        return make_config(self.preset, **{**defaults, **below, **changes, **settings}), policies

    def make_source(self, config: Config) -> LevelSource:
        """Return the source of the maps: one map, or houses for names such as ``generated:test``."""
        if not isinstance(self.map, (str, os.PathLike, OccupancyMap)):
            raise ConfigError(f"map = {self.map!r}: must be a name, a YAML file or an OccupancyMap")
        name = os.fspath(self.map) if isinstance(self.map, (str, os.PathLike)) else ""
        if name.partition(":")[0] == "generated":
            return GeneratedMaps.named(name, config)
        if config.start_level is not None or config.num_levels is not None:
            raise ConfigError("start_level and num_levels are for map='generated'")
        return FixedMap(map_assets(self.map, config), config)


def takes_env_arguments(init: Callable[..., None]) -> Callable[..., None]:
    """Replace the parameter ``arguments`` of an ``__init__`` by the fields of :class:`EnvArguments`."""
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
        if isinstance(one, str) and moved_by_policy(one):
            one = make_policy(one)  # a name, unlike an object, can be saved in Gymnasium's spec
        if isinstance(one, str):
            names.append(one)
        elif hasattr(one, "select") and hasattr(one, "reset") and not isinstance(one, type):
            names.append(POLICY)
            policies[number] = one
        else:
            kinds = ", ".join(name for name in behaviour_names() if name != POLICY)
            raise ConfigError(f"ghosts[{number}] = {one!r}: must be one of {kinds}, or an object with reset and select")
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
    """Raise ValueError unless the render mode is None or in ``known``."""
    if render_mode is not None and render_mode not in known:
        raise ValueError(f"render_mode = {render_mode!r}: choose one of {known} or None")
