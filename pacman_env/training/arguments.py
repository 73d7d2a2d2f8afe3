"""Arguments of a training: hyperparameters from a section of a YAML file, and options that can override them."""

import argparse
import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from msgspec import Meta

from ..command_line.command import Parser
from ..command_line.options import add_options, parse_options
from ..config.validation import AtLeastOne, Checked, Count, NotNegative, Number, Share, convert, kinds, located, require
from ..config.yaml_files import read_yaml
from ..files import shipped
from .lineups import LEARNED, LEAST_NODES, checked, read, searches, sub_batches

Part = Literal["refuges", "hold", "paths", "prediction"]
FOLDER = shipped("training/hyperparameters", "train/hyperparameters")


@dataclass(frozen=True)
class Hyperparameters(Checked):
    """Tunable values. Pairs are the values at the start and at the end of a cycle, linear in between."""

    decisions: AtLeastOne
    """Decisions of PPO in all games together; 0.5 s of a game each, more with ``decide: event``."""
    cycles: AtLeastOne
    """Cycles of learning rate and entropy coefficient; both go from their first to their last value in each cycle."""
    segment: AtLeastOne
    """Decisions between two checkpoints; a multiple of ``games`` x ``n_steps``."""
    games: AtLeastOne
    """Games that run in parallel."""
    n_steps: AtLeastOne
    """Decisions of each game per rollout."""
    batch_size: AtLeastOne
    """Decisions in a minibatch."""
    n_epochs: AtLeastOne
    """Epochs over a rollout in an update."""
    learning_rate: tuple[NotNegative, NotNegative]
    """Step size at the start and at the end of a cycle, linear in between."""
    ent_coef: tuple[NotNegative, NotNegative]
    """Entropy coefficient, against early certainty, at the start and at the end of a cycle, linear in between."""
    gamma: Share
    """Discount per decision; decisions of 0.5 s: half after 346 s at 0.999, after 173 s at 0.998."""
    gae_lambda: Share
    """Lambda of GAE, bias against variance of advantages."""
    clip_range: NotNegative
    """Clip range of the probability ratio in an update."""
    vf_coef: NotNegative
    """Coefficient of the value loss."""
    max_grad_norm: NotNegative
    """Largest norm of the gradient."""
    width: AtLeastOne
    """Width of each hidden layer."""
    reward_scale: NotNegative
    """Factor of rewards, so that values are of the order of one."""
    timeout: Number
    """Reward at the time limit, not scaled; -10, as for death, if a robot may survive without collecting."""
    levels: AtLeastOne
    """Generated houses per segment."""
    clyde_speed: tuple[NotNegative, NotNegative]
    """Lowest and highest speed of Clyde, m/s; drawn for each round."""
    robot_speed: tuple[NotNegative, NotNegative]
    """Lowest and highest speed of the robot, m/s; drawn for each round."""
    ghosts: Annotated[tuple[str, ...], Meta(min_length=1)]
    """Line-ups that share the games, such as wander "arcade,chase@0.1-0.3"."""
    league_every: Count
    """Segments between two Clydes that join the league; 0: no league."""
    imitation: Count
    """Decisions of a rule to imitate first; 0: none, PPO starts from random weights or from ``--start``."""
    teacher_nodes: AtLeastOne
    """Segments that ``search`` plays for an imitated decision, at least 221; not used if all ghosts wander."""
    decide: Literal["tick", "event"]
    """When the planner decides in training: tick, every 0.5 s, or event, when something happened."""

    def __post_init__(self) -> None:
        super().__post_init__()
        rollout, batch = f"games * n_steps = {self.rollout}", self.batch_size
        require(self.segment % self.rollout == 0, "segment", self.segment, f"must be a multiple of {rollout}")
        # Advantages are divided by their standard deviation within a minibatch.
        require(batch > 1 != self.rollout % batch, "batch_size", batch, f"leaves a minibatch of 1 of {rollout}")
        object.__setattr__(self, "ghosts", tuple(checked(one, f"ghosts[{k}]") for k, one in enumerate(self.ghosts)))
        if len(self.lineups) > 1:
            sub_batches(self.ghosts, self.games, self.levels)  # raises ConfigError if the games cannot be divided
        learned = any(LEARNED in read(one).behaviours for one in self.lineups)
        require(self.league_every > 0 or not learned, "league_every", 0, f"must be at least 1 with a ghost {LEARNED!r}")
        nodes, least = self.teacher_nodes, LEAST_NODES if any(map(searches, self.lineups)) else 0
        require(nodes >= least, "teacher_nodes", nodes, f"must be at least {least}")

    @property
    def lineups(self) -> tuple[str, ...]:
        """Return the line-ups of ``ghosts`` without repetition."""
        return tuple(dict.fromkeys(self.ghosts))

    @property
    def rollout(self) -> int:
        """Return the number of decisions in a rollout."""
        return self.games * self.n_steps

    def progress(self, decisions: int) -> float:
        """Return the progress within a cycle, above 0 and at most 1; no decisions count as the end of a cycle."""
        parts = min(decisions, self.decisions) * self.cycles  # whole numbers, so that nothing is rounded
        return ((parts - 1) % self.decisions + 1) / self.decisions

    @property
    def segments(self) -> int:
        """Return the number of segments that are needed for at least ``decisions`` decisions in total."""
        return -(-self.decisions // self.segment)


@dataclass(frozen=True)
class Arguments(Checked):
    """Train a planner with PPO on generated houses."""

    hyper: Hyperparameters
    out: Path = Path("results/ppo")
    """Folder of the run: checkpoints, planner.onnx, run.json, TensorBoard's files."""
    start: Path | None = None
    """Planner (.onnx, or checkpoint .zip) whose weights PPO starts from, instead of imitation."""
    value_decisions: Count = 0
    """First decisions of PPO, in which it fits only the values and keeps the policy."""
    seed: Annotated[int, Meta(ge=0, lt=2**32)] = 0
    """Seed of everything random."""
    resume: bool = False
    """Resume the run in ``out``."""
    preset: str = "robot"
    """Preset of the configuration; for an unknown name, the error lists all."""
    execution: str = "robust"
    """Execution of goals: robust or as_built."""
    randomize: bool = False
    """Draw also localization errors, Nav2's delay and aborts for each round."""
    curriculum: bool = False
    """Start with slow Clydes; the highest speed grows over the first half of the run."""
    without: tuple[Part, ...] = ()
    """Ablations: candidates or features that the network does not use."""
    threads: Count = 2
    """Threads that compute an update, step games and play rounds; 0: one per core."""
    device: str = "cpu"
    """Device of the network: cpu, or a graphics processor such as cuda or cuda:1."""
    evaluation: Count = 256
    """Rounds on validation levels at the end of each segment, and on test levels at the end; 0: none."""
    progress: bool = True
    """Show a progress bar."""

    def __post_init__(self) -> None:
        super().__post_init__()
        rounds, lineups = self.evaluation, len(self.hyper.lineups)
        rule = f"must be 0 or at least the {lineups} line-ups in ghosts"
        require(rounds == 0 or rounds >= lineups, "evaluation", rounds, rule)
        imitation = self.hyper.imitation
        require(self.start is None or imitation == 0, "imitation", imitation, "must be 0 with a planner to start from")


def parse(argv: Sequence[str]) -> Arguments:
    """Parse arguments on top of a file's hyperparameters; raises ValueError if the file or a value is invalid."""
    default = _default(argv)
    return parse_options(make_parser(default), argv, default)


def make_parser(default: Arguments | None = None) -> Parser:
    parser = Parser(prog="pacman-env train", description=Arguments.__doc__, parents=[_sections()], allow_abbrev=False)
    add_options(parser, default or _default(()))
    return parser


def _sections() -> argparse.ArgumentParser:
    """Return a parser of ``--quick`` and ``--config``, which decide the defaults of the other options."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--quick", action="store_true", help="one to two minutes on two cores")
    file = FOLDER / "PacManBot-v2.yaml"
    parser.add_argument("--config", type=Path, default=file, help=f"hyperparameters ({file.name})")
    return parser


def _default(argv: Sequence[str]) -> Arguments:
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False, parents=[_sections()])
    parser.add_argument("--imitation")
    parser.add_argument("--start")
    chosen, _ = parser.parse_known_args(argv)
    section = "fine_tune" if chosen.start else "headline"
    if chosen.quick:
        section = "scratch" if chosen.imitation == "0" and not chosen.start else "quick"
    hyper = load_hyperparameters(chosen.config, section)
    if chosen.start:
        hyper = dataclasses.replace(hyper, imitation=0)
    return Arguments(hyper, Path("results/ppo-quick")) if chosen.quick else Arguments(hyper)


def load_hyperparameters(path: Path, section: str) -> Hyperparameters:
    """Read a section of a YAML file; raises ValueError, with file and section, if it is invalid."""
    content = read_yaml(path)
    values = content.get(section) if isinstance(content, dict) else None
    if not isinstance(values, dict):
        raise ValueError(f"{path}: no section {section!r}")
    return from_values(values, f"{path}: {section}")


def from_values(values: dict[str, Any], where: str) -> Hyperparameters:
    fields, whole = kinds(Hyperparameters), (AtLeastOne, Count)
    with located(where, ValueError, ValueError):
        if set(values) != set(fields):
            unknown, missing = sorted(map(str, set(values) - set(fields))), sorted(set(fields) - set(values))
            raise ValueError(f"unknown {unknown}, missing {missing}")
        # A number may be in quotes.
        return Hyperparameters(**{n: convert(values[n], kind, n, strict=kind in whole) for n, kind in fields.items()})
