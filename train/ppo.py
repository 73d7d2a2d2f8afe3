"""Train a planner: ``pacman-env train``. Arguments, the segments in order, the report at the end."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from sb3_contrib import MaskablePPO
from stable_baselines3.common.logger import configure
from stable_baselines3.common.utils import set_random_seed
from tqdm import tqdm

from pacman_env.cli.command import Parser, guarded
from pacman_env.cli.options import parse_options
from pacman_env.config import Config
from pacman_env.episodes.rollout import episode_seeds, play
from pacman_env.episodes.statistics import paired_difference, wilson
from pacman_env.game.execution import COMPLETE
from pacman_env.policies.base import Policy
from pacman_env.sim.maps.generated import GeneratedMaps

from .arguments import FOLDER, Arguments, load_hyperparameters
from .checkpoint import TorchPlanner, facts_path, read_facts
from .export import export_planner
from .game_workers import Worker
from .games import VALIDATION_LEVEL, TrainingGames, clyde_limit, dropped, game_config, make_games
from .imitation import imitate
from .policy import new_model
from .run import LearningRate, Run, TrainingCallback, restore

AfterSegment = Callable[[dict[str, Any]], None]
_HELD_OUT = 128  # levels that rounds for validation, and for the report, are drawn from
_BATCH = 128  # rounds at once
_RULES = ("clyde_aware", "lookahead")
_PROG = "pacman-env train"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the training; returns the exit status."""
    return guarded(_PROG, lambda: run(parse(sys.argv[1:] if argv is None else argv)), "train")


def parse(argv: Sequence[str]) -> Arguments:
    """Arguments over the hyperparameters of a file's section.

    Raises:
        ValueError: the file or a value does not fit.
        SystemExit: after ``--help`` and bad arguments.
    """
    first = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    first.add_argument("--quick", action="store_true", help="some minutes on two cores")
    first.add_argument(
        "--config", type=Path, default=FOLDER / "PacManBot-v0.yaml", help="hyperparameters (%(default)s)"
    )
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
    """All segments that are left, then planner.onnx of the last one, and the report.

    Raises:
        ValueError: the run's folder does not fit, or a value is out of range.
    """
    started = time.perf_counter()
    folder, model = train(arguments)
    planner = _planner(arguments, model)
    print(_report(arguments, planner, time.perf_counter() - started))
    out = arguments.out / "planner.onnx"
    export_planner(planner.network, out, read_facts(facts_path(folder.last)))
    print(f"written: {out} (as a policy: pacman-env compare --policies {out})")


def train(arguments: Arguments, after_segment: AfterSegment | None = None) -> tuple[Run, MaskablePPO]:
    """All segments that are left; the run's folder and the model as the last one left it.

    ``after_segment`` is called with the record of each segment, those that a resumed run has behind it included; what
    it raises ends the training.

    Raises:
        ValueError: the run's folder does not fit, or a value is out of range.
    """
    torch.set_num_threads(arguments.threads)
    torch.use_deterministic_algorithms(True)  # else threads add up gradients in whatever order they come
    folder = Run(arguments)
    hyper = arguments.hyper
    bar = tqdm(
        total=hyper.segments * hyper.segment,
        initial=len(folder.segments) * hyper.segment,
        unit="decision",
        unit_scale=True,
        mininterval=1.0,
        disable=not arguments.progress,
        file=sys.stderr,
    )
    after_segment = after_segment or (lambda record: None)
    for record in folder.segments:
        after_segment(record)
    rate = LearningRate(hyper.learning_rate)
    begun = len(folder.segments)
    with contextlib.ExitStack() as stack:
        stack.enter_context(bar)
        workers = [stack.enter_context(contextlib.closing(Worker())) for _ in range(arguments.threads - 1)]
        games = make_games(arguments, begun, workers=workers)
        model = new_model(hyper, games, arguments.seed, **dropped(arguments))
        model.lr_schedule = rate
        if begun > 0:
            restore(model, folder.checkpoint(begun - 1))
        model.set_logger(configure(str(arguments.out), ["tensorboard"]))
        stack.callback(model.logger.close)
        for segment in range(begun, hyper.segments):
            if segment > begun:
                games.close()
                games = make_games(arguments, segment, workers=workers)
            _segment(arguments, folder, model, games, rate, bar)
            after_segment(folder.segments[-1])
        games.close()
    return folder, model


def _segment(
    arguments: Arguments, folder: Run, model: MaskablePPO, games: TrainingGames, rate: LearningRate, bar: Any
) -> None:
    """Learn in the games of the next segment, validate, write down."""
    hyper, segment = arguments.hyper, len(folder.segments)
    seeds = np.random.SeedSequence(arguments.seed, spawn_key=(segment,)).generate_state(3)
    began = time.perf_counter()
    model.set_env(games)  # which begin anew
    set_random_seed(int(seeds[0]))
    games.seed(int(seeds[1]))
    imitation = {}
    if segment == 0 and hyper.imitation > 0:
        imitation = imitate(model, games, "lookahead", hyper.imitation, int(seeds[2]))
        imitation["imitated"] = _validate(arguments, model)
        bar.write(f"lookahead imitated: {imitation['imitated']:.1%} of validation rounds completed")
        games.seed(int(seeds[1]))
    model.num_timesteps = segment * hyper.segment
    callback = TrainingCallback(hyper, rate, bar)
    learning = time.perf_counter()
    model.learn(hyper.segment, callback, reset_num_timesteps=False)
    ended = time.perf_counter()
    share = _validate(arguments, model)
    speed = hyper.segment / (ended - learning)
    folder.write(
        model,
        {
            "segment": segment,
            "decisions": int(model.num_timesteps),
            "completed": share,
            "clyde_limit_mps": clyde_limit(arguments, segment),
            "seconds": round(ended - began, 1),
            "decisions_per_s": round(speed),
            **imitation,
        },
    )
    model.logger.record("validation/completed", share)
    model.logger.dump(model.num_timesteps)
    bar.write(f"{model.num_timesteps} decisions: {share:.1%} of validation rounds completed ({speed:.0f}/s)")


def _planner(arguments: Arguments, model: MaskablePPO) -> TorchPlanner:
    return TorchPlanner("ppo", model.policy.network, game_config(arguments).robot.speed_mps)


def _validate(arguments: Arguments, model: MaskablePPO) -> float:
    """Share of rounds completed on levels that are never trained on, nor tested."""
    if arguments.evaluation == 0:
        return 0.0
    config = game_config(arguments)
    source = GeneratedMaps(config, VALIDATION_LEVEL, _HELD_OUT)
    seeds = episode_seeds(VALIDATION_LEVEL, arguments.evaluation)
    return float(_completed(_planner(arguments, model), source, config, seeds).mean())


def _completed(
    policy: str | Policy, source: GeneratedMaps, config: Config, seeds: NDArray[np.uint64]
) -> NDArray[np.bool_]:
    """(E,) the rounds that ended with all pellets collected and the robot at home."""
    records, _ = play(source, config, policy, seeds, batch_size=_BATCH)
    return np.asarray(records["end"] == COMPLETE)


def _report(arguments: Arguments, planner: TorchPlanner, seconds: float) -> str:
    """The planner against the rules in the same rounds on test levels, as a table."""
    hyper = arguments.hyper
    lines = [f"{hyper.segments * hyper.segment} decisions, seed {arguments.seed}, {seconds:.0f} s"]
    if arguments.evaluation == 0:
        return lines[0]
    config = game_config(arguments)
    seeds = episode_seeds(arguments.seed, arguments.evaluation)
    played = {}
    compared: dict[str, str | Policy] = {planner.name: planner, **{rule: rule for rule in _RULES}}
    for name, policy in compared.items():
        source = GeneratedMaps.named("generated:test", config, None, _HELD_OUT)
        played[name] = _completed(policy, source, config, seeds)
    low, high = hyper.clyde_speed
    lines += [f"{len(seeds)} rounds on test levels, Clyde {low}-{high} m/s:", ""]
    lines += ["| policy | completed | ppo minus it, paired |", "|---|---|---|"]
    for name, ended in played.items():
        first, last = wilson(int(ended.sum()), len(ended))
        difference, (low, high) = paired_difference(played[planner.name], ended)
        against = "" if name == planner.name else f"{difference:+.1%} [{low:+.1%}, {high:+.1%}]"
        lines.append(f"| {name} | {ended.mean():.1%} [{first:.1%}, {last:.1%}] | {against} |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
