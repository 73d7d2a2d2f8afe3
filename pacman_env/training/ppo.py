"""Train a planner: ``pacman-env train``. Arguments, the segments in order, the report at the end."""

from __future__ import annotations

import argparse
import contextlib
import copy
import dataclasses
import functools
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from stable_baselines3.common.logger import configure

from pacman_env.cli.command import Parser, guarded
from pacman_env.cli.options import parse_options
from pacman_env.episodes.rollout import episode_seeds, play_in
from pacman_env.episodes.statistics import paired_difference, wilson
from pacman_env.game.execution import COMPLETE
from pacman_env.policies.base import Policy
from pacman_env.sim.core.batch import GameBatch
from pacman_env.sim.maps.generated import GeneratedMaps
from pacman_env.training.arguments import FOLDER, Arguments, load_hyperparameters
from pacman_env.training.checkpoint import TorchPlanner, facts_path, read_facts, restore
from pacman_env.training.export import export_planner
from pacman_env.training.games import VALIDATION_LEVEL, clyde_limit, dropped, game_config, make_games
from pacman_env.training.imitation import imitate
from pacman_env.training.learner import Learner, use_device
from pacman_env.training.run import Run, progress_bar

AfterSegment = Callable[[dict[str, Any]], None]
_HELD_OUT = 128  # levels that rounds for validation, and for the report, are drawn from
_BATCH = 128  # rounds at once
_RULES = ("clyde_aware", "lookahead")
_PROG = "pacman-env train"


def main(argv: Sequence[str] | None = None) -> int:
    return guarded(_PROG, lambda: run(parse(sys.argv[1:] if argv is None else argv)), "train")


def parse(argv: Sequence[str]) -> Arguments:
    """Arguments over the hyperparameters of a file's section; raises ValueError if the file or a value does not fit."""
    first = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    first.add_argument("--quick", action="store_true", help="about a minute on two cores")
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
    """All segments that are left, then planner.onnx of the last one, and the report."""
    started = time.perf_counter()
    folder, model = train(arguments)
    planner = _planner(arguments, model)
    print(_report(arguments, planner, time.perf_counter() - started))
    out = arguments.out / "planner.onnx"
    export_planner(planner.network, out, read_facts(facts_path(folder.last)))
    print(f"written: {out} (as a policy: pacman-env compare --policies {out})")


def train(arguments: Arguments, after_segment: AfterSegment = lambda record: None) -> tuple[Run, Learner]:
    """All segments that are left; the run's folder and the model as the last one left it.

    ``after_segment`` is called with the record of each segment, those before a resumed run included; what
    it raises ends the training. Raises ValueError if the run's folder does not fit.
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
            restore(folder.checkpoint(begun - 1), model.network, model.optimizer)
        model.logger = configure(str(arguments.out), ["tensorboard"])
        with contextlib.closing(model.logger):
            validation = _HeldOut(arguments, test=False)
            for segment in range(begun, hyper.segments):
                _segment(folder, segment, model, validation, bar)
                after_segment(folder.segments[-1])
    return folder, model


def _segment(folder: Run, segment: int, model: Learner, validation: _HeldOut, bar: Any) -> None:
    """Learn in the games of a segment, validate, write down."""
    arguments, hyper = folder.arguments, model.hyper
    seeds = np.random.SeedSequence(arguments.seed, spawn_key=(segment,)).generate_state(3).tolist()
    began = time.perf_counter()
    with contextlib.closing(make_games(arguments, segment)) as games:
        torch.manual_seed(seeds[0])
        imitation = {}
        if segment == 0 and hyper.imitation > 0:
            imitation = imitate(model, games, hyper.imitation, games_seed=seeds[1], seed=seeds[2])
            imitation["imitated"] = validation.share(_planner(arguments, model))
            bar.write(f"lookahead imitated: {imitation['imitated']:.1%} of validation rounds completed")
        model.decisions = segment * hyper.segment
        learning = time.perf_counter()
        model.learn(games, hyper.segment, seeds[1], bar)
        ended = time.perf_counter()
    share = validation.share(_planner(arguments, model))
    speed = hyper.segment / (ended - learning)
    result = {
        "segment": segment,
        "decisions": model.decisions,
        "completed": share,
        "clyde_limit_mps": clyde_limit(arguments, segment),
        "seconds": round(ended - began, 1),
        "decisions_per_s": round(speed),
    }
    folder.write(model, result | imitation)
    model.logger.record("validation/completed", share)
    model.logger.dump(model.decisions)
    bar.write(f"{model.decisions} decisions: {share:.1%} of validation rounds completed ({speed:.0f}/s)")


def _planner(arguments: Arguments, model: Learner) -> TorchPlanner:
    return TorchPlanner("ppo", copy.deepcopy(model.network).cpu(), game_config(arguments).robot.speed_mps)


class _HeldOut:
    """Rounds in which planners are evaluated: games as in training on other levels, with a decision each tick.

    The levels stay prepared from one evaluation to the next.
    """

    def __init__(self, arguments: Arguments, test: bool) -> None:
        self._config = game_config(arguments).with_fields(**{"decisions.when": "tick"})
        self._test, self._threads = test, arguments.threads
        self.seeds = episode_seeds(arguments.seed if test else VALIDATION_LEVEL, arguments.evaluation)

    @functools.cached_property
    def _games(self) -> GameBatch:
        config = self._config
        validation = GeneratedMaps(config, VALIDATION_LEVEL, _HELD_OUT)
        source = GeneratedMaps.named("generated:test", config, None, _HELD_OUT) if self._test else validation
        return GameBatch(source, config, min(_BATCH, len(self.seeds)), self._threads)

    def completed(self, policy: str | Policy) -> NDArray[np.bool_]:
        """(E,) the rounds that were completed."""
        return np.asarray(play_in(self._games, policy, self.seeds, timed=False)[0]["end"] == COMPLETE)

    def share(self, policy: str | Policy) -> float:
        """Of the rounds that were completed; 0 without rounds."""
        return float(self.completed(policy).mean()) if len(self.seeds) > 0 else 0.0


def _report(arguments: Arguments, planner: TorchPlanner, seconds: float) -> str:
    """The planner against the rules in the same rounds on test levels, as a table."""
    hyper = arguments.hyper
    lines = [f"{hyper.segments * hyper.segment} decisions, seed {arguments.seed}, {seconds:.0f} s"]
    if arguments.evaluation == 0:
        return lines[0]
    test = _HeldOut(arguments, test=True)
    compared: dict[str, str | Policy] = {planner.name: planner, **{rule: rule for rule in _RULES}}
    played = {name: test.completed(policy) for name, policy in compared.items()}
    low, high = hyper.clyde_speed
    lines += [f"{len(test.seeds)} rounds on test levels, Clyde {low}-{high} m/s:", ""]
    lines += ["| policy | completed | ppo minus it, paired |", "|---|---|---|"]
    for name, ended in played.items():
        first, last = wilson(int(ended.sum()), len(ended))
        difference, (low, high) = paired_difference(played[planner.name], ended)
        against = "" if name == planner.name else f"{difference:+.1%} [{low:+.1%}, {high:+.1%}]"
        lines.append(f"| {name} | {ended.mean():.1%} [{first:.1%}, {last:.1%}] | {against} |")
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
