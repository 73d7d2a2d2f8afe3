"""From an environment's arguments to a configuration, a source of maps and the policies of ghosts."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from ..config import Config, ConfigError, make_config
from ..game.ghosts import BEHAVIOURS, GHOST_NAMES
from ..policies.base import Policy
from ..sim.maps.assets import MapSource, map_assets
from ..sim.maps.generated import GeneratedMaps
from ..sim.maps.level_source import FixedMap, LevelSource
from ..world.maps.occupancy import OccupancyMap

RENDER_FPS = 2  # one frame per decision, in real time
KINDS = ("features", "scan", "grid", "planner")

#: How many wander, or for each a behaviour or a policy of his own.
Ghosts = int | str | Policy | Sequence[str | Policy]


def make_settings(
    preset: str,
    execution: str,
    *,
    ghosts: Ghosts | None,
    observation: str | Sequence[str] | None,
    action: str | None,
    endless: bool | None,
    settings: Mapping[str, Any] | None,
    config: Config | None,
) -> tuple[Config, dict[int, Policy]]:
    """The configuration and the policies by the ghost's number.

    Raises:
        ConfigError: ``config`` together with what it replaces, an unknown name, or a value out of range.
    """
    if config is not None and not isinstance(config, Config):
        raise ConfigError(f"config = {config!r}: must be a Config")
    if settings is not None and not (isinstance(settings, Mapping) and all(isinstance(key, str) for key in settings)):
        raise ConfigError(f"settings = {settings!r}: must be values by the dotted names of fields")
    behaviours, policies = _behaviours(ghosts)
    changes: dict[str, Any] = {}
    if behaviours is not None:
        changes["clyde.ghosts"] = behaviours
    if observation is not None:
        changes |= _kinds(observation)
    if action is not None:
        changes["action"] = action
    if endless is not None:
        changes["endless"] = endless
    if config is not None:
        if settings or changes or (preset, execution) != ("robot", "robust"):
            raise ConfigError("give either config or the arguments that make one, not both")
        return config, policies
    clash = sorted(changes.keys() & (settings or {}).keys())
    if clash:
        raise ConfigError(f"{clash[0]} is given twice: as an argument and in settings")
    return make_config(preset, execution, **{**changes, **(settings or {})}), policies


def _behaviours(ghosts: Ghosts | None) -> tuple[tuple[str, ...] | None, dict[int, Policy]]:
    if ghosts is None:
        return None, {}
    if isinstance(ghosts, (int, np.integer)) and not isinstance(ghosts, bool):
        if not 1 <= ghosts <= len(GHOST_NAMES):
            raise ConfigError(f"ghosts = {ghosts}: must be 1 to {len(GHOST_NAMES)}")
        return ("wander",) * int(ghosts), {}
    each: Any = [ghosts] if isinstance(ghosts, str) or hasattr(ghosts, "select") else ghosts
    if not isinstance(each, Sequence):
        raise ConfigError(f"ghosts = {ghosts!r}: must be a number, a behaviour, a policy, or a sequence of these")
    names, policies = [], {}
    for number, one in enumerate(each):
        if isinstance(one, str):
            names.append(one)
        elif hasattr(one, "select") and hasattr(one, "reset") and not isinstance(one, type):
            names.append("policy")
            policies[number] = one
        else:
            raise ConfigError(
                f"ghosts[{number}] = {one!r}: must be one of {(*BEHAVIOURS,)[:-1]} or an object with reset and select"
            )
    return tuple(names), policies


def _kinds(observation: str | Sequence[str]) -> dict[str, bool]:
    several = isinstance(observation, Iterable) and not isinstance(observation, (str, Mapping))
    chosen = list(observation) if several else [observation]
    unknown = [name for name in chosen if name not in KINDS]
    if unknown or not chosen:
        raise ConfigError(f"observation = {observation!r}: choose one or several of {KINDS}")
    return {f"observation.{name}": name in chosen for name in KINDS}


def make_source(
    map_source: MapSource,
    config: Config,
    home: tuple[float, float, float] | None,
    start_level: int | None,
    num_levels: int | None,
) -> LevelSource:
    """Where the maps come from: ``generated``, ``generated:test``, or one map.

    Raises:
        ConfigError: levels of a map that has none, or levels out of range.
        MapError: the map cannot be read or played on.
    """
    if not isinstance(map_source, (str, os.PathLike, OccupancyMap)):
        raise ConfigError(f"map = {map_source!r}: must be a name, a YAML file or an OccupancyMap")
    name = os.fspath(map_source) if isinstance(map_source, (str, os.PathLike)) else ""
    if name.partition(":")[0] == "generated":
        if home is not None:
            raise ConfigError("home: generated houses have home poses of their own")
        return GeneratedMaps.named(name, config, start_level, num_levels)
    if start_level is not None or num_levels is not None:
        raise ConfigError("start_level and num_levels are for map='generated'")
    return FixedMap(map_assets(map_source, config, home), config)


def check_render_mode(render_mode: str | None, known: list[str]) -> None:
    """Raise ValueError for a render mode that the environment does not have."""
    if render_mode is not None and render_mode not in known:
        raise ValueError(f"render_mode = {render_mode!r}: choose one of {known} or None")
