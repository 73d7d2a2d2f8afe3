"""Arguments of a training run: hyperparameters come from YAML per environment, the command line may replace each."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import yaml

Part = Literal["refuges", "hold", "paths", "futures"]
FOLDER = Path(__file__).with_name("hyperparameters")


@dataclass(frozen=True)
class Hyperparameters:
    """What is tuned. Pairs are the values at the beginning and at the end, linear in between."""

    decisions: int
    """Decisions of PPO in all games together."""
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
        for name in ("decisions", "segment", "games", "n_steps", "batch_size", "n_epochs", "width", "levels"):
            value = getattr(self, name)
            if not isinstance(value, int) or value < 1:
                raise ValueError(f"{name} = {value!r}: must be a whole number of at least 1")
        if self.imitation < 0:
            raise ValueError(f"imitation = {self.imitation}: must be at least 0")
        for name in ("learning_rate", "ent_coef", "clyde_speed", "robot_speed"):
            value = getattr(self, name)
            if len(value) != 2 or min(value) < 0:
                raise ValueError(f"{name} = {value!r}: must be two numbers of at least 0")
        if self.segment % self.rollout:
            raise ValueError(f"segment = {self.segment}: must be a multiple of games * n_steps = {self.rollout}")

    @property
    def rollout(self) -> int:
        """Decisions between two updates."""
        return self.games * self.n_steps

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
    """Of torch."""
    evaluation: int = 256
    """Rounds on validation levels at the end of each segment, and on test levels at the end; 0: none."""
    progress: bool = True
    """Show a progress bar."""


def load_hyperparameters(path: Path, section: str) -> Hyperparameters:
    """Read a section of a YAML file.

    Raises:
        ValueError: the file or the section does not fit, said with names.
    """
    try:
        content = yaml.safe_load(path.read_text())
    except (OSError, yaml.YAMLError) as error:
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
        unknown, missing = sorted(set(values) - names), sorted(names - set(values))
        raise ValueError(f"{where}: unknown {unknown}, missing {missing}")
    kinds = {field.name: str(field.type) for field in dataclasses.fields(Hyperparameters)}
    try:
        return Hyperparameters(**{name: _value(kinds[name], value) for name, value in values.items()})
    except (TypeError, ValueError) as error:
        raise ValueError(f"{where}: {error}") from None


def _value(kind: str, value: Any) -> Any:
    if kind == "int":
        if not isinstance(value, int) or isinstance(value, bool):
            raise ValueError(f"{value!r} is no whole number")
        return value
    if kind == "float":
        return float(value)
    return tuple(float(v) for v in value)
