"""Plan a report: derive the matchups to play from policies, maps, speeds and variants."""

import itertools
import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config, ConfigError, located, make_config, parse_settings
from pacman_env.evaluation.rounds.play import Matchup
from pacman_env.evaluation.rounds.scenarios import Levels, Scenario, check_goals

_NEXT_SETTING = re.compile(r"[;,\s]+(?=[\w.]+=)")  # a comma inside a value is no separator


@dataclass(frozen=True)
class Variant:
    name: str
    settings: str  # as given
    config: Config


class RoundsKey(NamedTuple):
    part: str  # ROUNDS, ENDLESS_GAMES or a variant's name
    map: str
    policy: str
    speed: float  # Clyde's in round 1, m/s


ROUNDS, ENDLESS_GAMES = "rounds", "endless games"


@dataclass(frozen=True)
class ReportPlan:
    maps: dict[str, Scenario]  # by name
    policies: dict[str, str]  # specs by name
    baseline: str  # name of the baseline
    preset: str
    execution: str
    settings: tuple[str, ...]
    config: Config
    speeds: tuple[float, ...]
    variants: tuple[Variant, ...]
    seed: int
    seeds: NDArray[np.uint64]
    endless_seeds: NDArray[np.uint64]

    @property
    def speed(self) -> float:
        """Return the speed of Clyde in all parts except the curve, m/s."""
        return self.config.clyde.speed_mps

    @property
    def parts(self) -> list[tuple[str, Config, NDArray[np.uint64]]]:
        """Return name, configuration and seeds of each part, which every policy plays on every map."""
        speeds = dict.fromkeys((self.speed, *self.speeds))
        parts = [(ROUNDS, self.config.with_fields(**{"clyde.speed_mps": v}), self.seeds) for v in speeds]
        if len(self.endless_seeds):
            parts.append((ENDLESS_GAMES, self.config.with_fields(endless=True), self.endless_seeds))
        return [*parts, *((variant.name, variant.config, self.seeds) for variant in self.variants)]

    @property
    def challenger(self) -> str | None:
        """Return the first policy that is not the baseline; the two are compared round by round."""
        return next((name for name in self.policies if name != self.baseline), None)


def parse_variant(text: str, preset: str, execution: str, settings: Sequence[str]) -> Variant:
    """Parse ``NAME=SETTINGS``: fields, ``preset`` and ``execution``, separated by commas, semicolons or blanks."""
    name, equals, given = text.partition("=")
    name = name.strip()
    if not name or not equals or "=" not in given:
        raise ConfigError(f"--variant {text!r}: must be NAME=SETTINGS, such as calm=clyde.speed_mps=0.1")
    if name in (ROUNDS, ENDLESS_GAMES):
        raise ConfigError(f"--variant {name}: the report uses this name for other rounds")
    base, changes = {"preset": preset, "execution": execution}, []
    for setting in _NEXT_SETTING.split(given.strip()):
        field, _, value = setting.partition("=")
        if field in base:
            base[field] = value
        else:
            changes.append(setting)
    with located(f"--variant {name}"):
        merged = parse_settings(settings) | parse_settings(changes)
        config = make_config(base["preset"], base["execution"], **merged)
    return Variant(name, given.strip(), config)


def check_single_rounds(config: Config) -> None:
    """Raise ConfigError for endless games, which the report adds itself, and for games that it cannot measure."""
    check_goals(config)
    if config.endless:
        raise ConfigError("endless = True: must be False; --endless N plays endless games")


def matchups(plan: ReportPlan) -> dict[RoundsKey, Matchup]:
    """Return all matchups by cell; matchups on one map are adjacent, so that the map stays in the cache."""
    result = {}
    for (name, scenario), (part, config, seeds) in itertools.product(plan.maps.items(), plan.parts):
        for policy, spec in plan.policies.items():
            result[RoundsKey(part, name, policy, config.clyde.speed_mps)] = Matchup(scenario, config, spec, seeds)
    return result


def replay_command(plan: ReportPlan, map_name: str, seed: int) -> str:
    pair = [plan.policies[name] for name in (plan.challenger, plan.baseline) if name is not None]
    scenario = plan.maps[map_name]
    command = ["pacman-env", "replay", str(seed)]
    if isinstance(scenario, Levels):
        command += ["--levels", scenario.split, "--num-levels", str(scenario.count)]
        command += [] if scenario.start is None else ["--start-level", str(scenario.start)]
    else:
        command += ["--map", scenario]
    command += ["--policies", *pair, "--clyde-speed", repr(plan.speed)]
    command += [] if plan.preset == "robot" else ["--preset", plan.preset]
    command += [] if plan.execution == "robust" else ["--execution", plan.execution]
    for setting in plan.settings:
        command += ["--set", setting]
    return shlex.join(command)
