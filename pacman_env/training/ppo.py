"""Train a planner: ``pacman-env train``. Arguments, the segments in order, their record, the report at the end.

A segment begins with new games and with random numbers of its own, drawn from the run's seed and the segment's
number. So an interrupted run continues from its last checkpoint with the same curve, bit for bit.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import dataclasses
import functools
import json
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.logger import configure
from tqdm import tqdm

from pacman_env import __version__
from pacman_env.cli.command import Parser, guarded
from pacman_env.cli.options import parse_options
from pacman_env.config import Config
from pacman_env.episodes.rollout import episode_seeds, play_in
from pacman_env.episodes.statistics import paired_difference, wilson
from pacman_env.files import write_json
from pacman_env.game.execution import COMPLETE
from pacman_env.game.ghosts import POLICY
from pacman_env.policies.base import Policy
from pacman_env.sim.core.batch import GameBatch
from pacman_env.sim.maps.assets import MapAssets
from pacman_env.sim.maps.level_source import TEST_LEVEL, GeneratedMaps
from pacman_env.training import checkpoint
from pacman_env.training.arguments import FOLDER, Arguments, load_hyperparameters
from pacman_env.training.export import export_planner
from pacman_env.training.facts import facts_of
from pacman_env.training.games import VALIDATION_LEVEL, clyde_limit, dropped, game_config, lineup_speeds, make_games
from pacman_env.training.league import League, Record
from pacman_env.training.learner import Learner, imitate, use_device
from pacman_env.training.lineups import LEARNED, behaviours, teacher_name

AfterSegment = Callable[[dict[str, Any]], None]
_HELD_OUT = 128  # levels that rounds for validation, and for the report, are drawn from
_BATCH = 128  # rounds at once
_RULES = ("clyde_aware", "lookahead", "nearest")
_PROG = "pacman-env train"


def main(argv: Sequence[str] | None = None) -> int:
    return guarded(_PROG, lambda: run(parse(sys.argv[1:] if argv is None else argv)), "train")


def parse(argv: Sequence[str]) -> Arguments:
    """Arguments over the hyperparameters of a file's section; raises ValueError if the file or a value does not fit."""
    first = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    first.add_argument("--quick", action="store_true", help="about a minute on two cores")
    file = FOLDER / "PacManBot-v0.yaml"
    first.add_argument("--config", type=Path, default=file, help=f"hyperparameters ({file.name})")
    chosen, rest = first.parse_known_args(argv)
    scratch = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    scratch.add_argument("--imitation")
    nothing_imitated = scratch.parse_known_args(rest)[0].imitation == "0"
    section = ("scratch" if nothing_imitated else "quick") if chosen.quick else "headline"
    default = Arguments(hyper=load_hyperparameters(chosen.config, section))
    if chosen.quick:
        default = dataclasses.replace(default, out=Path("results/ppo-quick"))
    parser = Parser(prog=_PROG, description=Arguments.__doc__, parents=[first], allow_abbrev=False)
    return parse_options(parser, argv, default)


def run(arguments: Arguments) -> None:
    started = time.perf_counter()
    folder, model = train(arguments)
    planner = _planner(arguments, model)
    pool = folder.league.pool(arguments.hyper.segments - 1, folder.against_league())
    print(_report(arguments, planner, pool, time.perf_counter() - started))
    out = arguments.out / "planner.onnx"
    export_planner(planner.network, out, checkpoint.read_facts(checkpoint.facts_path(folder.last)))
    print(f"written: {out} (as a policy: pacman-env compare --policies {out})")


def train(arguments: Arguments, after_segment: AfterSegment = lambda record: None) -> tuple[Run, Learner]:
    """All segments that are left; the run's folder and the model as the last one left it.

    ``after_segment`` is called with the record of each segment, also of those before; what it raises ends the training.
    """
    device = use_device(arguments.device)
    folder = Run(arguments)
    hyper, begun = arguments.hyper, len(folder.segments)
    bar = progress_bar(hyper.segments * hyper.segment, arguments.progress, begun * hyper.segment)
    for record in folder.segments:
        after_segment(record)
    with bar:
        model = Learner(hyper, arguments.seed, device, arguments.threads, **dropped(arguments))
        if begun > 0:
            checkpoint.restore(folder.checkpoint(begun - 1), model.network, model.optimizer)
        model.logger = configure(str(arguments.out), ["tensorboard"])
        with contextlib.closing(model.logger):
            validation = HeldOut(arguments, arguments.evaluation)
            for segment in range(begun, hyper.segments):
                _segment(folder, segment, model, validation, bar)
                after_segment(folder.segments[-1])
    return folder, model


def _segment(folder: Run, segment: int, model: Learner, validation: HeldOut, bar: Any) -> None:
    arguments, hyper = folder.arguments, model.hyper
    seeds = np.random.SeedSequence(arguments.seed, spawn_key=(segment,)).generate_state(3).tolist()
    began = time.perf_counter()
    if folder.league.is_due(segment):
        folder.league.train(segment, _planner(arguments, model))
    pool = functools.partial(folder.league.pool, segment, folder.against_league())
    again = folder.segments[-1]["again"] if folder.segments else {}
    with contextlib.closing(make_games(arguments, segment, pool, again)) as games:
        torch.manual_seed(seeds[0])
        imitation = {}
        if segment == 0 and hyper.imitation > 0:
            imitation = imitate(model, games, hyper.imitation, games_seed=seeds[1], seed=seeds[2])
            imitation["imitated"] = validation.shares(validation.completed(_planner(arguments, model), pool()))[0]
            rules = " and ".join(dict.fromkeys(map(teacher_name, hyper.lineups)))
            bar.write(f"{rules} imitated: {imitation['imitated']:.1%} of validation rounds completed")
        model.decisions = segment * hyper.segment
        learning = time.perf_counter()
        model.learn(games, hyper.segment, seeds[1], bar)
        ended = time.perf_counter()
        again = games.counts.best()
    completed = validation.completed(_planner(arguments, model), pool())
    share, each = validation.shares(completed)
    met = validation.learned()
    speed = hyper.segment / (ended - learning)
    result = {
        "segment": segment,
        "decisions": model.decisions,
        "completed": share,
        "completed_against": each,
        "against_league": folder.league.record(segment, validation.seeds[met], completed[met], pool()),
        "again": again,
        "clyde_limit_mps": clyde_limit(arguments, segment),
        "seconds": round(ended - began, 1),
        "decisions_per_s": round(speed),
    }
    folder.write(model, result | imitation)
    model.logger.record("validation/completed", share)
    parts = ""
    if len(each) > 1:
        for lineup, part in each.items():
            model.logger.record(f"validation/completed_{lineup.replace(',', '_')}", part)
        parts = f" ({'; '.join(f'{lineup} {part:.1%}' for lineup, part in each.items())})"
    model.logger.dump(model.decisions)
    bar.write(f"{model.decisions} decisions: {share:.1%} of validation rounds completed{parts} ({speed:.0f}/s)")


def _planner(arguments: Arguments, model: Learner) -> checkpoint.TorchPlanner:
    return checkpoint.TorchPlanner("ppo", copy.deepcopy(model.network).cpu(), game_config(arguments).robot.speed_mps)


def _report(arguments: Arguments, planner: checkpoint.TorchPlanner, learned: Policy, seconds: float) -> str:
    hyper = arguments.hyper
    lines = [f"{hyper.segments * hyper.segment} decisions, seed {arguments.seed}, {seconds:.0f} s"]
    if arguments.evaluation == 0:
        return lines[0]
    test = HeldOut(arguments, arguments.evaluation, test=True)
    compared: dict[str, str | Policy] = {planner.name: planner, **{rule: rule for rule in _RULES}}
    played = {name: test.completed(policy, learned) for name, policy in compared.items()}
    low, high = hyper.clyde_speed
    lines += [f"{len(test.seeds)} rounds on test levels, Clyde {low}-{high} m/s:", ""]
    several = len(test.rows) > 1
    parts = {"all": slice(None), **test.rows} if several else test.rows
    lines += [f"| {'ghosts | ' * several}policy | completed | ppo minus it, paired |", "|---" * (3 + several) + "|"]
    for lineup, rows in parts.items():
        ours = played[planner.name][rows]
        for name, ended in ((name, ended[rows]) for name, ended in played.items()):
            first, last = wilson(int(ended.sum()), len(ended))
            difference, (low, high) = paired_difference(ours, ended)
            against = "" if name == planner.name else f"{difference:+.1%} [{low:+.1%}, {high:+.1%}]"
            place = f"{lineup} | " if several else ""
            lines.append(f"| {place}{name} | {ended.mean():.1%} [{first:.1%}, {last:.1%}] | {against} |")
    return "\n".join(lines)


class _KeptLevels(GeneratedMaps):
    """Levels that stay prepared, for one batch after the other."""

    def __init__(self, config: Config, start_level: int, num_levels: int) -> None:
        super().__init__(config, start_level, num_levels)
        self._kept: dict[int, MapAssets] = {}

    def prepare(self, level: int) -> MapAssets:
        if level not in self._kept:
            self._kept[level] = super().prepare(level)
        return self._kept[level]


class HeldOut:
    """Validation or test rounds, as in training with a decision each tick; levels stay prepared between evaluations.

    The rounds are shared evenly over ``ghosts``, different line-ups: by default those of the training.
    """

    def __init__(
        self, arguments: Arguments, rounds: int, *, test: bool = False, ghosts: Sequence[str] | None = None
    ) -> None:
        lineups = arguments.hyper.lineups if ghosts is None else ghosts
        self._config = game_config(arguments).with_fields(**{"decisions.when": "tick"})
        self._arguments, self._test, self._threads = arguments, test, arguments.threads
        self.seeds = episode_seeds(arguments.seed if test else VALIDATION_LEVEL, rounds)
        ends = [rounds * k // len(lineups) for k in range(len(lineups) + 1)]
        #: Which of the rounds are played against each line-up.
        self.rows = {lineup: slice(*ends[k : k + 2]) for k, lineup in enumerate(lineups)}

    @functools.cached_property
    def _levels(self) -> GeneratedMaps:
        first = TEST_LEVEL if self._test else VALIDATION_LEVEL
        return _KeptLevels(self._config, first, _HELD_OUT)

    def completed(self, policy: str | Policy, learned: Policy | None = None) -> NDArray[np.bool_]:
        """(E,) the rounds that were completed; ``learned`` moves the ghosts of that name."""
        found = np.zeros(len(self.seeds), dtype=np.bool_)
        for lineup, rows in self.rows.items() if len(found) else ():
            names = behaviours(lineup)
            ghosts = {} if learned is None else {k: learned for k, name in enumerate(names) if name == LEARNED}
            changes: dict[str, Any] = {
                "clyde.ghosts": tuple(POLICY if k in ghosts else name for k, name in enumerate(names))
            }
            changes |= {"randomize.clyde_speed_mps": lineup_speeds(self._arguments, lineup)}
            config = self._config.with_fields(**changes)
            games = GameBatch(self._levels, config, min(_BATCH, rows.stop - rows.start), self._threads)
            records, _ = play_in(games, policy, self.seeds[rows], ghosts=ghosts, timed=False)
            found[rows] = records["end"] == COMPLETE
        return found

    def shares(self, completed: NDArray[np.bool_]) -> tuple[float, dict[str, float]]:
        """Of the rounds (E,) that were completed: of all, and of those against each line-up; 0 without rounds."""
        if len(self.seeds) == 0:
            return 0.0, dict.fromkeys(self.rows, 0.0)
        return float(completed.mean()), {lineup: float(completed[rows].mean()) for lineup, rows in self.rows.items()}

    def learned(self) -> NDArray[np.int64]:
        """Numbers of the rounds in which a ghost is moved by a member of the league."""
        numbers = np.arange(len(self.seeds))
        parts = [numbers[rows] for lineup, rows in self.rows.items() if LEARNED in behaviours(lineup)]
        return np.concatenate([*parts, numbers[:0]])


class Run:
    """A run in a folder: ``run.json``, ``last.zip``, ``best.zip`` and TensorBoard's files."""

    def __init__(self, arguments: Arguments) -> None:
        self.arguments = arguments
        self.folder = arguments.out
        self.segments: list[dict[str, Any]] = []
        self.record = self.folder / "run.json"
        self.league = League(arguments, self.folder)
        self.best, self.last = self.folder / "best.zip", self.folder / "last.zip"
        if arguments.resume:
            self._read()
        elif self.record.exists():
            raise ValueError(f"{self.folder}: there is a run already; give --resume or another --out")
        self.folder.mkdir(parents=True, exist_ok=True)

    def _read(self) -> None:
        try:
            known = json.loads(self.record.read_text())
            before = known["arguments"]
            self.segments = list(known["segments"])
            numbers = [(segment["segment"], float(segment["completed"])) for segment in self.segments]
            if [number for number, _ in numbers] != list(range(len(numbers))):
                raise ValueError("its segments are not in order")
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ValueError(f"{self.record}: no run to resume: {error}") from None
        check_same(self.record, before, _plain(self.arguments))

    def against_league(self) -> Record:
        """Of the last segment."""
        return self.segments[-1]["against_league"] if self.segments else {}

    def checkpoint(self, segment: int) -> Path:
        """The file of the state after a segment, until the next one is written."""
        return self.folder / f"segment-{segment}.zip"

    def write(self, model: Learner, result: dict[str, Any]) -> None:
        segment = result["segment"]
        before = max((old["completed"] for old in self.segments), default=-1.0)
        self.segments.append(result)
        self._save(model, self.checkpoint(segment))
        self._save(model, self.last)
        if result["completed"] >= before:
            self._save(model, self.best)
        content = {"version": __version__, "arguments": _plain(self.arguments), "segments": self.segments}
        write_json(self.record, content)
        self.checkpoint(segment - 1).unlink(missing_ok=True)
        checkpoint.facts_path(self.checkpoint(segment - 1)).unlink(missing_ok=True)

    def _save(self, model: Learner, path: Path) -> None:
        checkpoint.save_checkpoint(path, model.network, model.optimizer)
        last = self.segments[-1]
        numbers = {name: float(value) for name, value in last.items() if isinstance(value, (int, float))}
        checkpoint.write_facts(checkpoint.facts_path(path), facts_of(self.arguments, model.decisions, numbers))


def _plain(arguments: Arguments) -> dict[str, Any]:
    """The arguments that decide the curve, as JSON has them."""
    plain = json.loads(json.dumps(dataclasses.asdict(arguments), default=str))
    for name in ("out", "resume", "progress", "threads"):
        del plain[name]
    return dict(plain)


def check_same(record: Path, before: Any, ours: dict[str, Any]) -> None:
    """Raise ValueError with the first field, nested ones included, that differs from ``ours``."""
    for name, value in ours.items():
        known = before.get(name) if isinstance(before, dict) else None
        if isinstance(value, dict):
            check_same(record, known, value)
        elif known != value:
            raise ValueError(f"{record}: was started with {name} = {known}, not {value}")


def progress_bar(decisions: int, shown: bool, done: int = 0) -> tqdm[Any]:
    kind: dict[str, Any] = {"unit": "decision", "unit_scale": True, "mininterval": 1.0, "file": sys.stderr}
    return tqdm(total=decisions, initial=done, disable=not shown, **kind)


if __name__ == "__main__":
    sys.exit(main())
