"""Train planner and Clyde against each other in turns: ``pacman-env adversary``.

Arguments, the sequence of rounds, the planner's opponents, the table of completion for each pair, and the record.
"""

import dataclasses
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray

from pacman_env import __version__
from pacman_env.command_line.command import Parser
from pacman_env.command_line.options import add_options, parse_options
from pacman_env.config.validation import AtLeastOne, Checked, Count, NotNegative, Share, require
from pacman_env.episodes.statistics import wilson
from pacman_env.executors.base import Executor
from pacman_env.files import write_json
from pacman_env.game.ghosts import POLICY, WANDER
from pacman_env.policies.base import Policy
from pacman_env.policies.learned import LearnedPlanner
from pacman_env.policies.metadata import read_planner
from pacman_env.policies.opponents import BehaviourOpponent, Opponents
from pacman_env.policies.registry import make_policy
from pacman_env.sim.core.ghosts import BEHAVIOUR_NAMES
from pacman_env.training.arguments import FOLDER, load_hyperparameters
from pacman_env.training.arguments import Arguments as GameArguments
from pacman_env.training.checkpoint import facts_path, load_network, read_facts, restore
from pacman_env.training.collector import Collector
from pacman_env.training.export import export_planner, network_of
from pacman_env.training.fragments import use_device
from pacman_env.training.games import Part, facts_of, make_ghost_parts, make_parts
from pacman_env.training.held_out import HeldOut
from pacman_env.training.lineups import LEARNED
from pacman_env.training.ppo import PPO, imitate
from pacman_env.training.train import progress_bar, run_training

_PROG = "pacman-env adversary"
RULES = ("lookahead", "clyde_aware")
_PLANNER, _CLYDE = 0, 1  # streams of random numbers


@dataclass(frozen=True)
class AdversaryArguments(Checked):
    """Train a planner and a Clyde against each other, in turns, or measure a trained planner."""

    start: Path | None = None
    """Planner to start with: an ONNX file, or a checkpoint such as best.zip; without: imitation of lookahead."""
    out: Path = Path("results/adversary")
    """Folder of the run: record.json, planner-K.onnx, clyde-K.onnx."""
    seed: Count = 0
    """Seed of everything random."""
    rounds: AtLeastOne = 3
    """Rounds; in each, a Clyde learns against the planner, then the planner against all Clydes."""
    clyde_decisions: AtLeastOne = 196608
    """Decisions of Clyde per round."""
    planner_decisions: Count = 524288
    """Decisions of the planner per round; 0: it stays unchanged, and only Clydes learn."""
    imitation: Count = 131072
    """Decisions of lookahead to imitate if there is no planner to start with."""
    wander: Share = 0.4
    """Share of the planner's training rounds against the original Clyde."""
    games: AtLeastOne = 128
    """Games of the planner in parallel."""
    clyde_games: AtLeastOne = 32
    """Games of Clyde in parallel."""
    levels: AtLeastOne = 96
    """Generated houses per round."""
    clyde_speed: tuple[NotNegative, NotNegative] | None = None
    """Range of Clyde's speed, m/s, for each game in training and table; without: as in pacman_env.training.train."""
    learning_rate: tuple[NotNegative, NotNegative] = (3e-4, 5e-5)
    """Learning rate of the planner, at the start and at the end of each round."""
    clyde_learning_rate: tuple[NotNegative, NotNegative] = (1e-3, 1e-4)
    """Learning rate of Clyde, at the start and at the end of each round."""
    evaluation: AtLeastOne = 256
    """Games on validation levels for every pair in the table."""
    measure: Path | None = None
    """Do not train: print the table of this planner."""
    clyde: Path | None = None
    """Learned Clyde to play against with --measure, in addition to the built-in ones."""
    threads: Count = 2
    """Threads that compute an update, step games and play rounds; 0: one per core."""
    progress: bool = True
    """Show a progress bar."""

    def __post_init__(self) -> None:
        super().__post_init__()
        require(self.clyde is None or self.measure is not None, "clyde", self.clyde, "is for --measure")


QUICK = AdversaryArguments(
    out=Path("results/adversary-quick"),
    rounds=1,
    clyde_decisions=32768,
    planner_decisions=65536,
    imitation=32768,
    games=64,
    levels=32,
    evaluation=64,
)


def main(argv: Sequence[str] | None = None) -> int:
    return run_training(_PROG, argv, parse, _run)


def _run(arguments: AdversaryArguments, executor: Executor) -> None:
    use_device("cpu")
    if arguments.measure is None:
        Alternation(arguments, executor).run()
    else:
        table = CompletionTable(_games(arguments, _PLANNER), arguments.evaluation, executor)
        print(robustness(arguments.measure, arguments.clyde, table).render())


def parse(argv: Sequence[str]) -> AdversaryArguments:
    default = QUICK if "--quick" in argv else AdversaryArguments()
    return parse_options(make_parser(default), argv, default)


def make_parser(default: AdversaryArguments | None = None) -> Parser:
    parser = Parser(prog=_PROG, description=AdversaryArguments.__doc__, allow_abbrev=False)
    parser.add_argument("--quick", action="store_true", help="two minutes on two cores")
    add_options(parser, default or AdversaryArguments())
    return parser


class Alternation:
    def __init__(self, arguments: AdversaryArguments, executor: Executor) -> None:
        self.arguments, self.folder, self._began = arguments, arguments.out, time.perf_counter()
        self._executor = executor
        self.record = self.folder / "record.json"
        if self.record.exists():
            raise ValueError(f"{self.folder}: there is a run already; give another --out")
        self.folder.mkdir(parents=True, exist_ok=True)
        self.table = CompletionTable(_games(arguments, _PLANNER), arguments.evaluation, executor)
        self.rounds: list[dict[str, Any]] = []
        clyde = PPO(_games(arguments, _CLYDE).hyper, _seeds(arguments, _CLYDE, 1)[0], threads=arguments.threads)
        planner, trained_before = starting_model(arguments, executor)
        self._models, self._decisions = [planner, clyde], [trained_before, 0]

    def run(self) -> None:
        arguments = self.arguments
        decisions = arguments.rounds * (arguments.clyde_decisions + arguments.planner_decisions)
        self._export(_PLANNER, "planner-0")
        self.table.play("planner-0", BEHAVIOUR_NAMES)
        with progress_bar(decisions, arguments.progress) as bar:
            for number in range(1, arguments.rounds + 1):
                self._round(number, bar)
                bar.write(f"round {number}\n\n{self.table.render()}\n", file=sys.stderr)
        newest, clydes = f"planner-{arguments.rounds}", [f"clyde-{k}" for k in range(1, arguments.rounds + 1)]
        self.table.play(newest, clydes)
        self._write()
        print(f"seed {arguments.seed}, {time.perf_counter() - self._began:.0f} s\n\n{self.table.render()}\n")
        print(f"written: {self.record}, {self._path(newest)}, {self._path(clydes[-1])}")

    def _round(self, number: int, bar: Any) -> None:
        opponent, clyde, planner = f"planner-{number - 1}", f"clyde-{number}", f"planner-{number}"
        robot = LearnedPlanner(self._path(opponent))
        clyde_parts = make_ghost_parts(_games(self.arguments, _CLYDE), number - 1, robot)
        clyde_seconds = self._learn(_CLYDE, number, clyde_parts, bar)
        self._export(_CLYDE, clyde)
        clydes = [LearnedPlanner(self._path(f"clyde-{k}")) for k in range(1, number + 1)]
        planner_seconds = 0.0
        if self.arguments.planner_decisions > 0:
            pool = make_pool(clydes, self.arguments.wander)
            parts = make_parts(_games(self.arguments, _PLANNER, LEARNED), number, pool)
            planner_seconds = self._learn(_PLANNER, number, parts, bar)
        self._export(_PLANNER, planner)
        self.table.play(opponent, [clyde])
        for policy in (planner, *RULES):
            self.table.play(policy, [*BEHAVIOUR_NAMES, clyde])
        self.rounds.append(
            {
                "round": number,
                "clyde_decisions": self._decisions[_CLYDE],
                "clyde_seconds": round(clyde_seconds, 1),
                "planner_decisions": self._decisions[_PLANNER],
                "planner_seconds": round(planner_seconds, 1),
            }
        )
        # Export again, with the results.
        shares = self.table.shares()
        self._export(_PLANNER, planner, {f"completed_{rival}": share for rival, share in shares[planner].items()})
        self._export(_CLYDE, clyde, {f"completed_{name}": shares[name][clyde] for name in (opponent, planner, *RULES)})
        self._write()

    def _learn(self, side: int, number: int, parts: list[Part], bar: Any) -> float:
        """Train one side with PPO in its games; return the duration, s."""
        model, (torch_seed, games_seed) = self._models[side], _seeds(self.arguments, side, number)
        torch.manual_seed(torch_seed)
        model.decisions = 0  # in this round: the schedules start again
        began = time.perf_counter()
        games = Collector(parts, self._executor)
        model.learn(games, model.hyper.decisions, games_seed, bar)
        self._decisions[side] += model.decisions
        return time.perf_counter() - began

    def _path(self, name: str) -> Path:
        return self.folder / f"{name}.onnx"

    def _export(self, side: int, name: str, metrics: dict[str, float] | None = None) -> None:
        facts = facts_of(_games(self.arguments, side), self._decisions[side], metrics or {})
        if self._decisions[_CLYDE] > 0:  # from the second half of the first round on
            ghosts = (*BEHAVIOUR_NAMES, POLICY) if side == _PLANNER else (POLICY,)
            facts = msgspec.structs.replace(facts, training=msgspec.structs.replace(facts.training, ghosts=ghosts))
        export_planner(self._models[side].network, self._path(name), facts)
        self.table.files[name] = self._path(name)

    def _write(self) -> None:
        content = {
            "version": __version__,
            "arguments": dataclasses.asdict(self.arguments),
            "rounds": self.rounds,
            "completed": self.table.shares(),
        }
        write_json(self.record, content)


def starting_model(arguments: AdversaryArguments, executor: Executor) -> tuple[PPO, int]:
    """Return the planner to start with and the number of decisions of its training so far."""
    game, path = _games(arguments, _PLANNER), arguments.start
    torch_seed, games_seed = _seeds(arguments, _PLANNER, 0)
    make = partial(PPO, game.hyper, torch_seed, threads=arguments.threads)
    if path is None:
        model = make()
        if arguments.imitation > 0:
            games = Collector(make_parts(game, 0), executor)
            imitate(model, games, arguments.imitation, games_seed=games_seed, seed=torch_seed)
        return model, 0
    if path.suffix.lower() == ".onnx":
        network = network_of(path)
        hidden = tuple(np.flatnonzero(network.shown.numpy() == 0).tolist())
        model = make(width=network.width, dropped_features=hidden, dropped_kinds=network.dropped_kinds)
        model.network.load_state_dict(network.state_dict())
        return model, read_planner(path)[0].training.decisions
    model = make(width=load_network(path).width)
    restore(path, model.network, model.optimizer)
    facts = facts_path(path)
    return model, read_facts(facts).training.decisions if facts.exists() else 0


def _games(arguments: AdversaryArguments, side: int, ghost: str = WANDER) -> GameArguments:
    """Return the arguments of a side's games and training; ``ghost`` is the behaviour of the planner's opponent."""
    hyper = load_hyperparameters(FOLDER / "PacManBot-v1.yaml", "headline")
    if side == _CLYDE:
        games, decisions, rate = arguments.clyde_games, arguments.clyde_decisions, arguments.clyde_learning_rate
    else:
        games, decisions, rate = arguments.games, arguments.planner_decisions, arguments.learning_rate
    rollout = games * hyper.n_steps
    hyper = dataclasses.replace(
        hyper,
        games=games,
        decisions=max(decisions, 1),
        segment=rollout,
        batch_size=rollout // 2,
        learning_rate=rate,
        levels=arguments.levels,
        clyde_speed=arguments.clyde_speed or hyper.clyde_speed,
        ghosts=(ghost,),
    )
    return GameArguments(hyper=hyper, seed=arguments.seed, threads=arguments.threads)


def _seeds(arguments: AdversaryArguments, side: int, number: int) -> list[int]:
    """Return the seeds of a side in a round: for torch and for the games."""
    return np.random.SeedSequence(arguments.seed, spawn_key=(number, side)).generate_state(2).tolist()


def make_pool(learned: Sequence[Policy], wander: float) -> Opponents:
    """Return a pool that wanders with this share; the rules and the learned Clydes share the other rounds equally."""
    others: list[Policy] = [BehaviourOpponent("chase"), BehaviourOpponent("arcade"), *learned]
    return Opponents([BehaviourOpponent("wander"), *others], [wander, *[(1.0 - wander) / len(others)] * len(others)])


class CompletionTable:
    """Shares of validation rounds that policies complete against Clydes; every pair plays once."""

    def __init__(self, arguments: GameArguments, rounds: int, executor: Executor) -> None:
        self._arguments, self._rounds, self._executor = arguments, rounds, executor
        self.files: dict[str, Path] = {}  # files of planners and learned Clydes by name
        self.completed: dict[str, dict[str, NDArray[np.bool_]]] = {}  # results by policy, then by Clyde

    def play(self, policy: str, clydes: Sequence[str]) -> None:
        row = self.completed.setdefault(policy, {})
        for clyde in clydes:
            if clyde not in row:
                robot = make_policy(str(self.files.get(policy, policy)))
                learned = make_policy(str(self.files[clyde])) if clyde in self.files else None
                ghosts = (clyde,) if learned is None else (LEARNED,)
                held_out = HeldOut(self._arguments, self._rounds, self._executor, ghosts=ghosts)
                row[clyde] = held_out.completed(robot, learned)

    def shares(self) -> dict[str, dict[str, float]]:
        completed = self.completed.items()
        return {policy: {clyde: float(ended.mean()) for clyde, ended in row.items()} for policy, row in completed}

    def render(self) -> str:
        """Return the table as Markdown with Wilson's intervals; pairs that did not play are empty."""
        clydes = list(dict.fromkeys(clyde for row in self.completed.values() for clyde in row))
        lines = [f"| completed of {self._rounds} | {' | '.join(clydes)} |", "|---" * (len(clydes) + 1) + "|"]
        for policy, row in self.completed.items():
            cells = [""] * len(clydes)
            for clyde, ended in row.items():
                low, high = wilson(int(ended.sum()), len(ended))
                cells[clydes.index(clyde)] = f"{ended.mean():.1%} [{low:.0%}, {high:.0%}]"
            lines.append(f"| {policy} | {' | '.join(cells)} |")
        return "\n".join(lines)


def robustness(planner: Path, clyde: Path | None, table: CompletionTable) -> CompletionTable:
    """Play one planner and the rules for the table of a model card; ``clyde`` is an additional learned Clyde."""
    table.files |= {"planner": planner} | ({} if clyde is None else {"clyde": clyde})
    for policy in ("planner", *RULES):
        table.play(policy, BEHAVIOUR_NAMES if clyde is None else (*BEHAVIOUR_NAMES, "clyde"))
    return table
