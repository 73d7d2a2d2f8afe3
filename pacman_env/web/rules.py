"""Rules of a simulated round: chosen by name on the page, checked, and converted to games."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any
from urllib.parse import quote, urlencode

from pacman_env.config import ClydeConfig, Config, ConfigError, make_config, preset_names
from pacman_env.config.described import settings
from pacman_env.envs.arguments import EnvArguments
from pacman_env.game.ghosts import POLICY, behaviour_names
from pacman_env.game.pellets import generate_pellets
from pacman_env.levels.assets import map_assets
from pacman_env.levels.level_source import TEST_LEVEL, TEST_LEVELS, LevelSource
from pacman_env.plugins import suggest
from pacman_env.policies.base import Policy
from pacman_env.policies.registry import LEARNED_CLYDE, make_policy, policy_names
from pacman_env.web.game_interface import Refused
from pacman_env.web.page_messages import Setup
from pacman_env.world.map_check import check_map
from pacman_env.world.maps.occupancy import MapError, OccupancyMap, load_map, read_map, shipped_maps

GENERATED = "generated"
#: Groups of the configuration in the page's form. Other groups are elsewhere on the page, or only learners need them.
_GROUPS = ("robot", "localization", "nav2", "pellets", "clyde", "power", "execution", "refuges")
_VARIANTS = ("clyde_aware:documented", "search:alone")  # policies for measurements, not listed
_CHOSEN_ELSEWHERE = ("clyde.speed_mps", "execution.tick_s")
_MOST_MAPS = 20  # uploaded maps
#: What *Play* on the page sets up. ``ppo`` completes at least half of each of the levels (``HARDEST`` in ``match.py``).
PLAY: dict[str, Any] = {
    "preset": "robot",
    "ghosts": ("arcade", "wander"),
    "clyde_mps": 0.15,
    "settings": {"power.pellets": 6, "clyde.speed_step_mps": 0.02, "time_limit_s": 420.0},
}
_GHOST_MPS = 0.25  # if a person plays a ghost; a ghost that only follows the robot wins 36 of 60 rounds against ppo
_LONGEST_S = 3600.0  # limit of a round, because all ticks are stored
_MOST_PIXELS = 4_000_000  # limit of an uploaded map: 2000 x 2000


@dataclass(frozen=True)
class Rules:
    map: str = "house"
    level: int | None = None  # level of a generated map; None: drawn from the seed
    preset: str = "robot"
    policy: str = "ppo"
    second: str = "clyde_aware"
    ghosts: tuple[str, ...] = ClydeConfig.ghosts
    settings: Mapping[str, Any] = field(default_factory=dict)

    def changed(self, setup: Setup) -> Rules:
        given = {name: value for name in vars(self) if (value := getattr(setup, name)) is not None}
        if "map" in given and "level" not in given:
            given["level"] = None
        return replace(self, **given)

    def link(self, seed: int, clyde_mps: float) -> str:
        words = {"map": self.map, "level": self.level, "preset": self.preset, "policy": self.policy}
        words |= {"second": self.second, "ghosts": ",".join(self.ghosts), "clyde": repr(float(clyde_mps)), "seed": seed}
        words |= {f"set.{name}": value for name, value in self.settings.items()}
        return urlencode({name: value for name, value in words.items() if value is not None}, quote_via=quote)


class Choices:
    """Available maps, policies and settings: shipped, installed, or given at the start as ``maps`` and ``policies``."""

    def __init__(self, maps: Sequence[str] = (), policies: Sequence[str] = ()) -> None:
        self._maps: dict[str, str | OccupancyMap] = {name: name for name in shipped_maps()}
        files = [load_map(one) for one in maps if one not in self._maps]
        self._maps |= {loaded.name: loaded for loaded in files}
        for spec in policies:
            make_policy(spec)
        listed = [name for name in policy_names() if name not in _VARIANTS]
        self._policies = list(dict.fromkeys([*listed, *policies]))
        shown = {s.name for s in settings() if s.name.partition(".")[0] in _GROUPS} - set(_CHOSEN_ELSEWHERE)
        self._settings = [s for s in settings() if s.name in {*shown, "time_limit_s"}]

    def facts(self) -> dict[str, Any]:
        return {
            "maps": [*self._maps, GENERATED],
            "presets": {name: self._preset(name) for name in preset_names()},
            "policies": self._policies,
            "behaviours": [*(name for name in behaviour_names() if name != POLICY), LEARNED_CLYDE],
            "settings": [setting._asdict() for setting in self._settings],
            "play": {"robot": PLAY, "ghost": PLAY | {"clyde_mps": _GHOST_MPS}},
        }

    def _preset(self, name: str) -> dict[str, Any]:
        """Return the ghosts of a preset, and the preset's settings that differ from the defaults."""
        config = make_config(name)
        changed = {one.name: config.value(one.name) for one in self._settings if config.value(one.name) != one.value}
        return {"ghosts": config.clyde.ghosts, "settings": changed}

    def check(self, rules: Rules) -> None:
        """Raise Refused for a name that is not available; the combination of names is not checked."""
        facts = self.facts()
        for what, name, known in (
            ("map", rules.map, facts["maps"]),
            ("preset", rules.preset, facts["presets"]),
            ("policy", rules.policy, facts["policies"]),
            ("policy", rules.second, facts["policies"]),
            *(("behaviour", ghost, facts["behaviours"]) for ghost in rules.ghosts),
        ):
            if name not in known:
                raise Refused(f"{what} {name!r}: {suggest(name, known)}")
        for name in rules.settings.keys() - {setting.name for setting in self._settings}:
            raise Refused(f"setting {name!r}: cannot be set on this page")
        if rules.level is not None:
            if rules.map != GENERATED:
                raise Refused(f"level {rules.level}: map {rules.map!r} has none")
            if rules.level >= TEST_LEVEL + TEST_LEVELS:
                raise Refused(f"level {rules.level}: must be 0 to {TEST_LEVEL + TEST_LEVELS - 1}")

    def prepare(self, rules: Rules, clyde_mps: float | None) -> tuple[Config, LevelSource, dict[int, Policy]]:
        self.check(rules)
        changes = {name: tuple(value) if isinstance(value, list) else value for name, value in rules.settings.items()}
        if clyde_mps is not None:
            changes["clyde.speed_mps"] = clyde_mps
        test = rules.level is not None and rules.level >= TEST_LEVEL
        source: Any = self._maps.get(rules.map, f"{GENERATED}:test" if test else GENERATED)
        if rules.level is not None:
            changes |= {"start_level": rules.level, "num_levels": 1}
        arguments = EnvArguments(source, preset=rules.preset, ghosts=rules.ghosts, settings=changes)
        try:
            config, policies = arguments.make_config()
            if config.time_limit_s > _LONGEST_S:
                raise ConfigError(f"time_limit_s = {config.time_limit_s}: at most {_LONGEST_S:g} s here")
            return config, arguments.make_source(config), policies
        except (ConfigError, MapError) as error:
            raise Refused(str(error)) from error

    def add_map(self, name: str, text: str, image: bytes) -> dict[str, Any]:
        if name in shipped_maps() or name == GENERATED:
            raise Refused(f"map {name!r}: a shipped map has this name")
        own = [known for known, one in self._maps.items() if not isinstance(one, str)]
        if name not in own and len(own) >= _MOST_MAPS:
            raise Refused(f"{_MOST_MAPS} maps are stored, the limit: use the name of a map that may be replaced")
        config = Config()
        try:
            loaded = read_map(name, text, image)
            if loaded.grey.size > _MOST_PIXELS:
                raise MapError(f"the image has {loaded.grey.size} pixels, at most {_MOST_PIXELS}")
            pellets = generate_pellets(loaded, config.pellets)
            report = check_map(loaded, pellets.position, pellets.ids, config)
            map_assets(loaded, config)
        except ValueError as error:
            raise Refused(f"the map {name} cannot be played on: {error}") from error
        self._maps[name] = loaded
        return {"map": name, "words": report.render()}
