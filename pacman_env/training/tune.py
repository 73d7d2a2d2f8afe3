"""Search for hyperparameters: ``pacman-env tune``. Short trainings, judged by completed validation rounds.

Every trial trains from the same seed, and its proposal depends only on earlier trials. An interrupted study therefore
continues with the same trials.
"""

import dataclasses
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import optuna
import yaml
from optuna.distributions import BaseDistribution, CategoricalDistribution, FloatDistribution, IntDistribution
from optuna.trial import FrozenTrial, TrialState, create_trial

from pacman_env.command_line.command import Parser
from pacman_env.command_line.options import add_options, parse_options
from pacman_env.config.validation import AtLeastOne, Checked, Count, located
from pacman_env.executors.base import Executor
from pacman_env.files import prepare, write_text
from pacman_env.training.arguments import FOLDER, Arguments, Hyperparameters, load_hyperparameters
from pacman_env.training.run import check_same
from pacman_env.training.train import run_training, train

#: Search space. Rates are initial values; they decrease in the same proportion as in the tuned section.
SPACE: dict[str, BaseDistribution] = {
    "learning_rate": FloatDistribution(1e-4, 3e-3, log=True),
    "ent_coef": FloatDistribution(5e-4, 2e-2, log=True),
    "n_epochs": IntDistribution(1, 6),
    "width": CategoricalDistribution((32, 48, 64, 96)),
    "discount": FloatDistribution(5e-4, 2e-2, log=True),  # 1 - gamma
    "gae_lambda": FloatDistribution(0.9, 0.99),
    "clip_range": FloatDistribution(0.1, 0.3),
    "batch_size": CategoricalDistribution((1024, 2048, 4096, 8192)),
    "reward_scale": FloatDistribution(0.05, 0.5, log=True),
    "imitation": CategoricalDistribution((0.0, 0.5, 1.0, 2.0)),  # factor of the section's value
}
_STARTUP = 5  # trials without pruning and with random proposals


@dataclass(frozen=True)
class Study(Checked):
    """Search for hyperparameters of PPO with Optuna."""

    out: Path = Path("results/tune")
    """Folder of the study: trials.jsonl, best.yaml, a training run per trial."""
    config: Path = FOLDER / "PacManBot-v1.yaml"
    """Hyperparameters to start from; values that are not searched stay unchanged."""
    section: str = "headline"
    trials: AtLeastOne = 30
    """Trials of the whole study, those before ``--resume`` included."""
    decisions: AtLeastOne = 819200
    """Decisions of PPO per trial."""
    segments: AtLeastOne = 4
    """Parts of a trial; after each, rounds are played on validation levels, and a poor trial is stopped."""
    evaluation: AtLeastOne = 256
    """Rounds on validation levels after each part."""
    seed: Count = 0
    """Seed of the proposals and of every training."""
    resume: bool = False
    """Resume the study in ``out``."""
    threads: Count = 2
    """Threads that compute an update, step games and play rounds; 0: one per core."""
    progress: bool = True
    """Show a progress bar for each trial."""


def main(argv: Sequence[str] | None = None) -> int:
    parser = make_parser()
    return run_training(parser.prog, argv, lambda given: parse_options(parser, given, Study()), _run)


def _run(study: Study, executor: Executor) -> None:
    best = search(study, executor)
    print(f"written: {best} (to train with it: pacman-env train --config {best})")


def make_parser() -> Parser:
    parser = Parser(prog="pacman-env tune", description=Study.__doc__)
    add_options(parser, Study())
    return parser


def search(settings: Study, executor: Executor | None = None) -> Path:
    """Run the remaining trials; return the file of the best hyperparameters, which is written after each trial.

    ``executor`` plays the games; None: threads of this process.
    """
    section = load_hyperparameters(settings.config, settings.section)
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    pruner = optuna.pruners.MedianPruner(n_startup_trials=_STARTUP, n_warmup_steps=1)
    study = optuna.create_study(direction="maximize", pruner=pruner)
    record = prepare(settings.out / "trials.jsonl")
    head = _plain(settings, section)
    if settings.resume:
        study.add_trials(_read(record, head))
    elif record.exists():
        raise ValueError(f"{settings.out}: there is a study already; give --resume or another --out")
    best = settings.out / "best.yaml"
    for number in range(len(study.trials), settings.trials):
        _play(settings, section, study, number, executor)
        _write(record, head, study.trials)
        _write_best(best, settings, section, study)
    if not _write_best(best, settings, section, study):
        raise ValueError(f"{record}: none of {len(study.trials)} trials could be finished")
    return best


def hyperparameters(section: Hyperparameters, params: dict[str, Any]) -> Hyperparameters:
    """Return a section with the values that a trial proposes, one for each name of ``SPACE``."""
    values = {name: params[name] for name in SPACE if name not in ("discount", "imitation")}
    for name in ("learning_rate", "ent_coef"):
        first, last = getattr(section, name)
        values[name] = (params[name], params[name] * (last / first if first > 0 else 1.0))
    gamma, imitation = 1.0 - params["discount"], round(section.imitation * params["imitation"])
    return dataclasses.replace(section, **values, gamma=gamma, imitation=imitation)


def _play(
    settings: Study, section: Hyperparameters, study: optuna.Study, number: int, executor: Executor | None
) -> None:
    seed = np.random.SeedSequence(settings.seed, spawn_key=(number,)).generate_state(1)[0]
    study.sampler = optuna.samplers.TPESampler(n_startup_trials=_STARTUP, seed=int(seed))
    trial = study.ask(SPACE)
    chosen = _arguments(settings, hyperparameters(section, trial.params), number)

    def judge(result: dict[str, Any]) -> None:
        trial.report(result["completed"], result["segment"])
        if trial.should_prune():
            share, decisions = result["completed"], result["decisions"]
            raise optuna.TrialPruned(f"{share:.1%} of validation rounds after {decisions} decisions")

    try:
        folder, _ = train(chosen, judge, executor)
    except optuna.TrialPruned as pruned:
        study.tell(trial, state=TrialState.PRUNED)
        result = f"given up: {pruned}"
    except FloatingPointError as error:
        study.tell(trial, state=TrialState.FAIL)
        result = f"failed: {error}"
    else:
        share = folder.segments[-1]["completed"]
        study.tell(trial, share)
        result = f"{share:.1%} of validation rounds completed"
    print(f"trial {number}: {result}")


def _arguments(settings: Study, hyper: Hyperparameters, number: int = 0) -> Arguments:
    """Return the arguments of a trial's short training in its own folder; an interrupted trial is resumed."""
    segment = max(settings.decisions // settings.segments // hyper.rollout, 1) * hyper.rollout
    hyper = dataclasses.replace(hyper, decisions=segment * settings.segments, segment=segment)
    out = settings.out / f"trial-{number}"
    same = {name: getattr(settings, name) for name in ("seed", "threads", "evaluation", "progress")}
    return Arguments(hyper, out, resume=(out / "run.json").exists(), **same)


def _plain(settings: Study, section: Hyperparameters) -> dict[str, Any]:
    values = {name: getattr(settings, name) for name in ("decisions", "segments", "evaluation", "seed")}
    return dict(json.loads(json.dumps({**values, "hyper": dataclasses.asdict(section)})))


def _write(record: Path, head: dict[str, Any], trials: list[FrozenTrial]) -> None:
    """Write the study's settings to the first line, then a line per trial."""
    lines = [json.dumps(head)]
    for trial in trials:
        shares = {str(step): share for step, share in trial.intermediate_values.items()}
        values = {"state": trial.state.name, "completed": trial.value, "params": trial.params, "segments": shares}
        lines.append(json.dumps({"trial": trial.number, **values}))
    write_text(record, "\n".join(lines) + "\n")


def _read(record: Path, head: dict[str, Any]) -> list[FrozenTrial]:
    with located(f"{record}: no study to resume", ValueError, (OSError, ValueError)):
        first, *lines = (json.loads(line) for line in record.read_text().splitlines())
    check_same(record, first, head)
    trials, wrong = [], (ValueError, KeyError, TypeError, AttributeError)
    for number, line in enumerate(lines):
        with located(f"{record}: line {number + 2}: no trial of this search", ValueError, wrong):
            if line["trial"] != number:
                raise ValueError("the trials are not in order")
            trial = create_trial(
                state=TrialState[line["state"]],
                value=line["completed"],
                params=line["params"],
                distributions=SPACE,
                intermediate_values={int(step): float(share) for step, share in line["segments"].items()},
            )
        trials.append(trial)
    return trials


def _write_best(path: Path, settings: Study, section: Hyperparameters, study: optuna.Study) -> bool:
    """Write the section with the best trial's values for ``pacman-env train``; return False if no trial finished."""
    if TrialState.COMPLETE not in {trial.state for trial in study.trials}:
        return False
    values = dataclasses.asdict(hyperparameters(section, study.best_params))
    plain = {name: list(value) if isinstance(value, tuple) else value for name, value in values.items()}
    head = f"# Trial {study.best_trial.number} of {len(study.trials)}: {study.best_value:.1%} of validation rounds"
    head += f" completed after {settings.decisions} decisions, seed {settings.seed}.\n"
    write_text(path, head + yaml.safe_dump({"headline": plain}, sort_keys=False))
    return True
