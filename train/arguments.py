"""Arguments of a training run: hyperparameters come from YAML per environment, the command line may replace each."""

from __future__ import annotations

import dataclasses
import math
import operator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import yaml

Part = Literal["refuges", "hold", "paths", "futures"]
FOLDER = Path(__file__).with_name("hyperparameters")


@dataclass(frozen=True)
class Hyperparameters:
    """What is tuned. Pairs are the values at the beginning and at the end of a cycle, linear in between."""

    decisions: int
    """Decisions of PPO in all games together."""
    cycles: int
    """So often the learning rate and the weight of entropy go from their first to their last value."""
    segment: int
    """Decisions between two checkpoints; each segment is played on houses of its own."""
    games: int
    """Games at once."""
    n_steps: int
    """Decisions per game between two updates."""
    batch_size: int
    n_epochs: int
    learning_rate: tuple[float, float]
    ent_coef: tuple[float, float]
    gamma: float
    gae_lambda: float
    clip_range: float
    vf_coef: float
    max_grad_norm: float
    width: int
    """Of every hidden layer."""
    reward_scale: float
    """Rewards are multiplied by it."""
    levels: int
    """Generated houses per segment."""
    clyde_speed: tuple[float, float]
    """m/s, drawn for each round."""
    robot_speed: tuple[float, float]
    """m/s, drawn for each round."""
    imitation: int
    """Decisions of the rule ``lookahead`` that are imitated before PPO begins; 0: PPO from random weights."""

    def __post_init__(self) -> None:
        for name in ("decisions", "cycles", "segment", "games", "n_steps", "batch_size", "n_epochs", "width", "levels"):
            _check_whole(name, getattr(self, name), 1)
        _check_whole("imitation", self.imitation, 0)
        for name in ("learning_rate", "ent_coef", "clyde_speed", "robot_speed"):
            value = getattr(self, name)
            if len(value) != 2 or not all(0 <= one < math.inf for one in value):
                raise ValueError(f"{name} = {value!r}: must be two numbers of at least 0")
        for name in ("clip_range", "vf_coef", "max_grad_norm", "reward_scale"):
            if not 0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name} = {getattr(self, name)!r}: must be a number of at least 0")
        for name in ("gamma", "gae_lambda"):
            if not 0 <= getattr(self, name) <= 1:
                raise ValueError(f"{name} = {getattr(self, name)!r}: must be a number from 0 to 1")
        if self.segment % self.rollout:
            raise ValueError(f"segment = {self.segment}: must be a multiple of games * n_steps = {self.rollout}")
        if self.batch_size == 1 or self.rollout % self.batch_size == 1:
            # advantages are divided by their deviation within a minibatch
            raise ValueError(
                f"batch_size = {self.batch_size}: leaves a minibatch of 1 of games * n_steps = {self.rollout}"
            )

    @property
    def rollout(self) -> int:
        """Decisions between two updates."""
        return self.games * self.n_steps

    def progress(self, decisions: int) -> float:
        """Within a cycle, above 0 and at most 1, when so many decisions are taken."""
        cycle = self.decisions / self.cycles
        decisions = min(decisions, self.decisions)
        return (decisions - (math.ceil(decisions / cycle) - 1) * cycle) / cycle

    @property
    def segments(self) -> int:
        """Number of segments: at least ``decisions`` are taken."""
        return -(-self.decisions // self.segment)


@dataclass(frozen=True)
class Arguments:
    """Train a planner with MaskablePPO on generated houses."""

    hyper: Hyperparameters
    out: Path = Path("results/ppo")
    """Folder of the run: checkpoints, planner.onnx, run.json, TensorBoard's files."""
    seed: int = 0
    """All that is random comes from it."""
    resume: bool = False
    """Go on with the run in ``out``."""
    preset: str = "robot"
    execution: str = "robust"
    randomize: bool = False
    """Draw localization errors, Nav2's delay and aborts for each round as well."""
    curriculum: bool = False
    """Begin with slow Clydes: his highest speed grows over the first half of the run."""
    without: tuple[Part, ...] = ()
    """Ablations: candidates or features that the network is not given."""
    threads: int = 2
    """Of torch, and processes that step games."""
    evaluation: int = 256
    """Rounds on validation levels at the end of each segment, and on test levels at the end; 0: none."""
    progress: bool = True
    """Show a progress bar."""

    def __post_init__(self) -> None:
        for name, least in (("seed", 0), ("threads", 1), ("evaluation", 0)):
            _check_whole(name, getattr(self, name), least)
        if self.seed >= 2**32:
            raise ValueError(f"seed = {self.seed}: must be below 2^32")


def _check_whole(name: str, value: object, least: int) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or value < least:
        raise ValueError(f"{name} = {value!r}: must be a whole number of at least {least}")


def load_hyperparameters(path: Path, section: str) -> Hyperparameters:
    """Read a section of a YAML file.

    Raises:
        ValueError: the file or the section does not fit, said with names.
    """
    try:
        content = yaml.safe_load(path.read_text())
    except (OSError, UnicodeDecodeError, yaml.YAMLError) as error:
        raise ValueError(f"{path}: cannot be read: {error}") from None
    values = content.get(section) if isinstance(content, dict) else None
    if not isinstance(values, dict):
        raise ValueError(f"{path}: no section {section!r}")
    return from_values(values, f"{path}: {section}")


def from_values(values: dict[str, Any], where: str) -> Hyperparameters:
    """Hyperparameters from plain data.

    Raises:
        ValueError: a name is unknown or missing, or a value is of another kind or out of range.
    """
    names = {field.name for field in dataclasses.fields(Hyperparameters)}
    if set(values) != names:
        unknown, missing = sorted(map(str, set(values) - names)), sorted(names - set(values))
        raise ValueError(f"{where}: unknown {unknown}, missing {missing}")
    kinds = {field.name: str(field.type) for field in dataclasses.fields(Hyperparameters)}
    try:
        return Hyperparameters(**{name: _value(name, kinds[name], value) for name, value in values.items()})
    except ValueError as error:
        raise ValueError(f"{where}: {error}") from None


_WORDS = {"int": "a whole number", "float": "a number", "tuple[float, float]": "two numbers"}


def _value(name: str, kind: str, value: Any) -> Any:
    try:
        if kind == "tuple[float, float]":
            first, last = value if isinstance(value, list | tuple) else ()
            return _number(first), _number(last)
        return _number(value) if kind == "float" else operator.index(_no_bool(value))
    except (TypeError, ValueError):
        raise ValueError(f"{name} = {value!r}: must be {_WORDS[kind]}") from None


def _number(value: Any) -> float:
    return float(_no_bool(value))  # YAML 1.1 reads 1e-4 as a string


def _no_bool(value: Any) -> Any:
    if isinstance(value, bool):
        raise TypeError
    return value
