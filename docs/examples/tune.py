"""Search for hyperparameters of PPO with Optuna: ``python docs/examples/tune.py --trials 30``.

Every trial is a short training, judged by its completed validation rounds; a trial below the median of earlier trials
is pruned. ``best.yaml`` contains the best values for ``pacman-env train --config``. Repeat the command to add trials
to the study. It needs the extra `train` and Optuna.
"""

import argparse
import dataclasses
from pathlib import Path

import optuna
import yaml

from pacman_env.training.arguments import FOLDER, Arguments, Hyperparameters, load_hyperparameters
from pacman_env.training.ppo import train


def propose(trial: optuna.Trial, section: Hyperparameters) -> Hyperparameters:
    """Return the section with proposed values; rates decrease in the same proportion as in the section."""
    first, last = section.learning_rate
    rate = trial.suggest_float("learning_rate", 1e-4, 3e-3, log=True)
    entropy = trial.suggest_float("ent_coef", 5e-4, 2e-2, log=True)
    return dataclasses.replace(
        section,
        learning_rate=(rate, rate * last / first),
        ent_coef=(entropy, entropy * section.ent_coef[1] / section.ent_coef[0]),
        n_epochs=trial.suggest_int("n_epochs", 1, 6),
        width=trial.suggest_categorical("width", (32, 48, 64, 96)),
        gamma=1.0 - trial.suggest_float("discount", 5e-4, 2e-2, log=True),
        gae_lambda=trial.suggest_float("gae_lambda", 0.9, 0.99),
        clip_range=trial.suggest_float("clip_range", 0.1, 0.3),
        batch_size=trial.suggest_categorical("batch_size", (1024, 2048, 4096, 8192)),
        reward_scale=trial.suggest_float("reward_scale", 0.05, 0.5, log=True),
        imitation=round(section.imitation * trial.suggest_categorical("imitation", (0.0, 0.5, 1.0, 2.0))),
    )


def main() -> None:
    """Run the trials and write the best values."""
    parser = argparse.ArgumentParser(description=__doc__)
    add = parser.add_argument
    add("--out", type=Path, default=Path("results/tune"), help="folder of the study (results/tune)")
    add("--config", type=Path, default=FOLDER / "PacManBot-v2.yaml", help="where the search starts")
    add("--trials", type=int, default=30, help="number of trials (30)")
    add("--decisions", type=int, default=819_200, help="decisions of PPO per trial (819200)")
    add("--evaluation", type=int, default=256, help="validation rounds after each quarter (256)")
    options = parser.parse_args()
    section = load_hyperparameters(options.config, "headline")
    segment = -(-options.decisions // 4 // section.rollout) * section.rollout
    section = dataclasses.replace(section, decisions=4 * segment, segment=segment)

    def judge(trial: optuna.Trial) -> float:
        def report(record: dict) -> None:
            trial.report(record["completed"], record["segment"])
            if trial.should_prune():
                raise optuna.TrialPruned

        out = options.out / f"trial-{trial.number}"
        run, _ = train(Arguments(propose(trial, section), out, evaluation=options.evaluation), report)
        return run.segments[-1]["completed"]

    options.out.mkdir(parents=True, exist_ok=True)
    study = optuna.create_study(
        storage=f"sqlite:///{options.out}/study.db",
        study_name="ppo",
        load_if_exists=True,
        direction="maximize",
        sampler=optuna.samplers.TPESampler(n_startup_trials=5),
        pruner=optuna.pruners.MedianPruner(n_startup_trials=5, n_warmup_steps=1),
    )
    study.optimize(judge, options.trials, catch=FloatingPointError)
    best = dataclasses.asdict(propose(optuna.trial.FixedTrial(study.best_params), section))
    plain = {name: list(value) if isinstance(value, tuple) else value for name, value in best.items()}
    path = options.out / "best.yaml"
    path.write_text(yaml.safe_dump({"headline": plain}, sort_keys=False))
    print(f"{study.best_value:.1%} of validation rounds completed; written: {path}")


if __name__ == "__main__":
    main()
