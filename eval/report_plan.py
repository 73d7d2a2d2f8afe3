"""What a report is to play: policies, tasks, speeds and variants, and the jobs that follow from them.

Nothing is played here; the command line's words become configurations, and configurations become jobs.
"""

from __future__ import annotations

import itertools
import re
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eval.report_runs import Job, Task
from pacman_env.config import Config, ConfigError, make_config
from pacman_env.settings import parse_settings

_NEXT_SETTING = re.compile(r"[;,\s]+(?=[\w.]+=)")  # a comma inside a value is no separator


@dataclass(frozen=True)
class Entry:
    """A policy that takes part; the label is its name on the page."""

    label: str
    spec: str


@dataclass(frozen=True)
class Variant:
    """The same rounds under changed settings."""

    name: str
    settings: str  # as given
    config: Config


class Cell(NamedTuple):
    """One policy's rounds on one task."""

    part: str  # ROUNDS, ENDLESS or a variant's name
    task: str
    policy: str
    speed: float  # Clyde's in round 1, m/s


ROUNDS, ENDLESS_GAMES = "rounds", "endless games"


@dataclass(frozen=True)
class Plan:
    """All that decides the numbers of a report."""

    tasks: tuple[Task, ...]
    policies: tuple[Entry, ...]
    baseline: str  # its label
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
        """Clyde's, of everything but the curve, m/s."""
        return self.config.clyde.speed_mps

    @property
    def challenger(self) -> Entry | None:
        """The first policy that is not the baseline; the two are looked at round by round."""
        return next((entry for entry in self.policies if entry.label != self.baseline), None)

    def entry(self, label: str) -> Entry:
        """A policy by its label."""
        return next(entry for entry in self.policies if entry.label == label)


def entries(specs: Sequence[str]) -> tuple[Entry, ...]:
    """Policies without repetition; a file goes by its stem, or by its whole path where that is not enough."""
    specs = list(dict.fromkeys(specs))
    short = [Path(spec).stem if spec.endswith(".onnx") else spec for spec in specs]
    return tuple(Entry(name if short.count(name) == 1 else spec, spec) for name, spec in zip(short, specs, strict=True))


def parse_variant(text: str, preset: str, execution: str, settings: Sequence[str]) -> Variant:
    """A variant from ``NAME=SETTINGS``.

    Settings are fields of the configuration, or ``preset`` and ``execution``; they are parted by commas, semicolons or
    blanks.

    Raises:
        ConfigError: no name, no settings, or one that is wrong.
    """
    name, equals, given = text.partition("=")
    name = name.strip()
    if not name or not equals or "=" not in given:
        raise ConfigError(f"--variant {text!r}: must be NAME=SETTINGS, such as calm=clyde.speed_mps=0.1")
    if name in (ROUNDS, ENDLESS_GAMES):
        raise ConfigError(f"--variant {name}: the report calls other rounds so")
    words, changes = {"preset": preset, "execution": execution}, []
    for setting in _NEXT_SETTING.split(given.strip()):
        field, _, value = setting.partition("=")
        if field in words:
            words[field] = value
        else:
            changes.append(setting)
    try:
        merged = parse_settings(settings) | parse_settings(changes)
        config = make_config(words["preset"], words["execution"], **merged)
    except ConfigError as error:
        raise ConfigError(f"--variant {name}: {error}") from None
    return Variant(name, given.strip(), config)


def check_single_rounds(config: Config, where: str = "") -> None:
    """What the report adds by itself, or cannot measure, must not be set.

    Raises:
        ConfigError: endless games, velocities, or ghosts that wait to be told.
    """
    for name, value, wrong in (
        ("action", config.action, config.action != "goal"),
        ("endless", config.endless, config.endless),
        ("clyde.ghosts", config.clyde.ghosts, "policy" in config.clyde.ghosts),
    ):
        if wrong:
            raise ConfigError(f"{where}{name} = {value!r}: policies that name goals are compared over single rounds")


def jobs(plan: Plan) -> dict[Cell, Job]:
    """Everything to be played, each thing once; those of a task follow one another, so that its map is at hand."""
    result = {}
    for task in plan.tasks:
        speeds = dict.fromkeys((plan.speed, *plan.speeds))
        parts = [(ROUNDS, plan.config.with_fields(**{"clyde.speed_mps": v}), plan.seeds) for v in speeds]
        if len(plan.endless_seeds):
            parts.append((ENDLESS_GAMES, plan.config.with_fields(endless=True), plan.endless_seeds))
        parts += [(variant.name, variant.config, plan.seeds) for variant in plan.variants]
        for (part, config, seeds), entry in itertools.product(parts, plan.policies):
            result[Cell(part, task.name, entry.label, config.clyde.speed_mps)] = Job(task, config, entry.spec, seeds)
    return result


def replay_command(plan: Plan, task: Task, seed: int) -> str:
    """The command that shows a round of the first policy and the baseline side by side."""
    pair = [entry.spec for entry in (plan.challenger, plan.entry(plan.baseline)) if entry is not None]
    words = ["python", "-m", "eval.replay", str(seed)]
    if task.levels:
        words += ["--levels", task.source.partition(":")[2], "--num-levels", str(task.levels)]
    else:
        words += ["--map", task.source]
    words += ["--policies", *pair, "--clyde-speed", f"{plan.speed:g}"]
    words += [] if plan.preset == "robot" else ["--preset", plan.preset]
    words += [] if plan.execution == "robust" else ["--execution", plan.execution]
    for setting in plan.settings:
        words += ["--set", setting]
    return shlex.join(words)
