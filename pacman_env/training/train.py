"""Train a planner: ``pacman-env train``. Arguments, the sequence of segments, the final report.

A segment starts with new games and its own random numbers, drawn from the run's seed and the segment's number. An
interrupted run therefore continues from its last checkpoint with the same curve, bit for bit.
"""

from __future__ import annotations

import argparse
import contextlib
import copy
import dataclasses
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3.common.logger import configure
from tqdm import tqdm

from pacman_env.command_line.command import Parser, guarded
from pacman_env.command_line.options import add_options, parse_options
from pacman_env.episodes.statistics import paired_difference, wilson
from pacman_env.executors.executor import Executor, InThreads
from pacman_env.policies.base import Policy
from pacman_env.training import checkpoint
from pacman_env.training.collector import Collector
from pacman_env.training.export import export_planner
from pacman_env.training.fragments import use_device
from pacman_env.training.held_out import HeldOut
from pacman_env.training.lineups import teacher_name
from pacman_env.training.ppo import PPO, imitate
from pacman_env.training.run_arguments import FOLDER, Arguments, load_hyperparameters
from pacman_env.training.run_folder import Run
from pacman_env.training.training_games import clyde_limit, dropped, game_config, make_parts

AfterSegment = Callable[[dict[str, Any]], None]
_RULES = ("clyde_aware", "lookahead", "nearest")
_PROG = "pacman-env train"


def main(argv: Sequence[str] | None = None) -> int:
    def begin() -> None:
        arguments = parse(sys.argv[1:] if argv is None else argv)
        with InThreads(arguments.threads) as executor:
            run(arguments, executor)

    return guarded(_PROG, begin, "train")


def parse(argv: Sequence[str]) -> Arguments:
    """Parse arguments on top of a file's hyperparameters; raises ValueError if the file or a value is invalid."""
    default = _default(argv)
    return parse_options(make_parser(default), argv, default)


def make_parser(default: Arguments | None = None) -> Parser:
    parser = Parser(prog=_PROG, description=Arguments.__doc__, parents=[_sections()], allow_abbrev=False)
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
    chosen, rest = _sections().parse_known_args(argv)
    scratch = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    scratch.add_argument("--imitation")
    nothing_imitated = scratch.parse_known_args(rest)[0].imitation == "0"
    section = ("scratch" if nothing_imitated else "quick") if chosen.quick else "headline"
    default = Arguments(hyper=load_hyperparameters(chosen.config, section))
    if chosen.quick:
        default = dataclasses.replace(default, out=Path("results/ppo-quick"))
    return default


def run(arguments: Arguments, executor: Executor) -> None:
    started = time.perf_counter()
    folder, model = train(arguments, executor=executor)
    planner = planner_of(arguments, model)
    pool = folder.league.pool(arguments.hyper.segments - 1, folder.against_league())
    print(_report(arguments, executor, planner, pool, time.perf_counter() - started))
    out = arguments.out / "planner.onnx"
    export_planner(planner.network, out, checkpoint.read_facts(checkpoint.facts_path(folder.last)))
    print(f"written: {out} (as a policy: pacman-env compare --policies {out})")


def train(
    arguments: Arguments, after_segment: AfterSegment = lambda record: None, executor: Executor | None = None
) -> tuple[Run, PPO]:
    """Train all remaining segments; return the run's folder and the final model.

    ``after_segment`` is called with the record of each segment, earlier ones included; its exceptions end the training.
    ``executor`` plays the games; None: threads of this process.
    """
    if executor is None:
        with InThreads(arguments.threads) as threads:
            return train(arguments, after_segment, threads)
    device = use_device(arguments.device)
    folder = Run(arguments)
    hyper, first = arguments.hyper, len(folder.segments)
    kind: dict[str, Any] = {"unit": "decision", "unit_scale": True, "mininterval": 1.0, "file": sys.stderr}
    kind |= {"initial": first * hyper.segment, "disable": not arguments.progress}
    bar: tqdm[Any] = tqdm(total=hyper.segments * hyper.segment, **kind)
    for record in folder.segments:
        after_segment(record)
    with bar:
        model = PPO(hyper, arguments.seed, device, arguments.threads, **dropped(arguments))
        if first > 0:
            checkpoint.restore(folder.checkpoint(first - 1), model.network, model.optimizer)
        model.logger = configure(str(arguments.out), ["tensorboard"])
        with contextlib.closing(model.logger):
            validation = HeldOut(arguments, arguments.evaluation, executor)
            for segment in range(first, hyper.segments):
                _segment(folder, segment, model, validation, executor, bar)
                after_segment(folder.segments[-1])
    return folder, model


def _segment(folder: Run, segment: int, model: PPO, validation: HeldOut, executor: Executor, bar: Any) -> None:
    arguments, hyper = folder.arguments, model.hyper
    seeds = np.random.SeedSequence(arguments.seed, spawn_key=(segment,)).generate_state(3).tolist()
    began = time.perf_counter()
    if folder.league.is_due(segment):
        folder.league.train(segment, planner_of(arguments, model), executor)
    pool = folder.league.pool(segment, folder.against_league())
    repeats = folder.segments[-1]["again"] if folder.segments else {}
    parts = make_parts(arguments, segment, pool, repeats)
    games = Collector(parts, executor)
    torch.manual_seed(seeds[0])
    imitation = {}
    if segment == 0 and hyper.imitation > 0:
        imitation = imitate(model, games, hyper.imitation, games_seed=seeds[1], seed=seeds[2])
        imitation["imitated"] = validation.shares(validation.completed(planner_of(arguments, model), pool))[0]
        rules = " and ".join(dict.fromkeys(map(teacher_name, hyper.lineups)))
        bar.write(f"{rules} imitated: {imitation['imitated']:.1%} of validation rounds completed")
    model.decisions = segment * hyper.segment
    learning = time.perf_counter()
    model.learn(games, hyper.segment, seeds[1], bar)
    ended = time.perf_counter()
    repeats = games.counts.best()
    completed = validation.completed(planner_of(arguments, model), pool)
    share, each = validation.shares(completed)
    of_league = validation.learned()
    speed = hyper.segment / (ended - learning)
    result = {
        "segment": segment,
        "decisions": model.decisions,
        "completed": share,
        "completed_against": each,
        "against_league": folder.league.record(segment, validation.seeds[of_league], completed[of_league], pool),
        "again": repeats,
        "clyde_limit_mps": clyde_limit(arguments, segment),
        "seconds": round(ended - began, 1),
        "decisions_per_s": round(speed),
    }
    folder.write(model, result | imitation)
    model.logger.record("validation/completed", share)
    shown = ""
    if len(each) > 1:
        for lineup, part in each.items():
            model.logger.record(f"validation/completed_{lineup.replace(',', '_')}", part)
        shown = f" ({'; '.join(f'{lineup} {part:.1%}' for lineup, part in each.items())})"
    model.logger.dump(model.decisions)
    bar.write(f"{model.decisions} decisions: {share:.1%} of validation rounds completed{shown} ({speed:.0f}/s)")


def planner_of(arguments: Arguments, model: PPO) -> checkpoint.TorchPlanner:
    """Return a copy of the current network as a policy."""
    return checkpoint.TorchPlanner("ppo", copy.deepcopy(model.network).cpu(), game_config(arguments).robot.speed_mps)


def _report(
    arguments: Arguments, executor: Executor, planner: checkpoint.TorchPlanner, learned: Policy, seconds: float
) -> str:
    hyper = arguments.hyper
    lines = [f"{hyper.segments * hyper.segment} decisions, seed {arguments.seed}, {seconds:.0f} s"]
    if arguments.evaluation == 0:
        return lines[0]
    test = HeldOut(arguments, arguments.evaluation, executor, test=True)
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
