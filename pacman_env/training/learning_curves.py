"""How fast stock learners learn PacManBotFlat-v0, one curve per combination: ``pacman-env learning-curves``.

Stable-Baselines3's PPO or sb3-contrib's MaskablePPO with their own defaults, eight games at once. After every update
the model plays the same rounds, which the policies ``nearest`` and ``random`` have played too.
"""

import argparse
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import sb3_contrib
import stable_baselines3
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray
from sb3_contrib.common.maskable.evaluation import evaluate_policy as evaluate_masked
from stable_baselines3.common.evaluation import evaluate_policy

from pacman_env import __version__
from pacman_env.cli.command import Parser, run_command, whole_number
from pacman_env.envs.arguments import EnvArguments
from pacman_env.envs.outcome import OUTCOMES
from pacman_env.episodes.rollout import play
from pacman_env.episodes.statistics import wilson
from pacman_env.files import prepare, replaced, write_json
from pacman_env.game.execution import COMPLETE
from pacman_env.sb3 import PacManBotVecEnv

_KINDS: dict[str, tuple[dict[str, Any], str]] = {
    "planner": ({}, "MlpPolicy"),
    "features": ({"observation": ("features", "flat")}, "MlpPolicy"),
    # Stable-Baselines3 scales pictures itself.
    "grid": ({"observation": ("features", "grid"), "settings": {"observation.normalize": False}}, "MultiInputPolicy"),
}
#: By name: the arguments of the environment, and the policy of the learner.
COMBINATIONS = {
    f"{kind}/{decide}": ({**given, "settings": {**given.get("settings", {}), "decisions.when": decide}}, policy)
    for kind, (given, policy) in _KINDS.items()
    for decide in ("event", "tick")
}
LEARNERS = {"maskable_ppo": (sb3_contrib.MaskablePPO, evaluate_masked), "ppo": (stable_baselines3.PPO, evaluate_policy)}
GAMES = 8  # at once
_TEST_SEED = 1_000_000  # of the games that are played to see how good a model is


def environment(combination: str, map_name: str) -> PacManBotVecEnv:
    if combination not in COMBINATIONS:
        raise ValueError(f"combination {combination!r}: choose among {' '.join(COMBINATIONS)}")
    return PacManBotVecEnv(GAMES, flat=True, map=map_name, **COMBINATIONS[combination][0])


def rounds_played(model: Any, learner: str, test: PacManBotVecEnv, rounds: int) -> dict[int, bool]:
    """By the seed of a round, whether the model completed it with its likeliest actions; the same rounds always."""
    played: dict[int, bool] = {}

    def note(now: dict[str, Any], _: dict[str, Any]) -> None:
        if now["done"]:
            played[now["info"]["round_seed"]] = OUTCOMES[now["info"]["outcome"]] == "complete"

    test.seed(_TEST_SEED)
    LEARNERS[learner][1](model, test, n_eval_episodes=rounds, callback=note)
    return played


def curve(combination: str, options: argparse.Namespace, seed: int) -> Iterator[tuple[dict[str, Any], dict[int, bool]]]:
    """After every update: figures for the file, and rounds of the test."""
    env, test = environment(combination, options.map), environment(combination, options.test)
    steps = {"n_steps": options.n_steps} if options.n_steps else {}
    make = LEARNERS[options.learner][0]
    model = make(COMBINATIONS[combination][1], env, seed=seed, device="cpu", **steps)
    spent = 0.0
    while model.num_timesteps < options.decisions:
        began = time.perf_counter()
        model.learn(1, reset_num_timesteps=False)  # up to the next update
        spent += time.perf_counter() - began
        returns = [episode["r"] for episode in model.ep_info_buffer or ()]
        played = rounds_played(model, options.learner, test, options.rounds)
        won = sum(played.values())
        point = {
            "decisions": model.num_timesteps,
            "return": float(np.mean(returns)) if returns else float("nan"),
            "completed": won / len(played),
            "interval": wilson(won, len(played)),
            "learning_s": spent,
        }
        yield point, played


def baselines(map_name: str, seeds: NDArray[np.uint64]) -> dict[str, float]:
    arguments = EnvArguments(map=map_name)
    config, _ = arguments.make_config()
    source = arguments.make_source(config)
    played = {name: play(source, config, name, seeds)[0] for name in ("nearest", "random")}
    return {name: float((records["end"] == COMPLETE).mean()) for name, records in played.items()}


def run(options: argparse.Namespace) -> dict[str, Any]:
    torch.set_num_threads(1)  # networks this small are fastest on one core
    for combination in options.combinations:
        environment(combination, options.map).close()  # an error before the first has learned
    libraries = (gymnasium, stable_baselines3, sb3_contrib, torch)
    figures: dict[str, Any] = {
        "version": __version__,
        "libraries": {library.__name__: library.__version__ for library in libraries},
        "settings": {key: value for key, value in vars(options).items() if key not in ("json", "plot", "quick")},
        "curves": [],
    }
    for combination in options.combinations:
        for seed in options.seeds:
            entry: dict[str, Any] = {"combination": combination, "seed": seed, "points": []}
            figures["curves"].append(entry)
            for point, played in curve(combination, options, seed):
                if "baselines" not in figures:
                    figures["baselines"] = baselines(options.test, np.array([*played], dtype=np.uint64))
                entry["points"].append(point)
                done = f"{point['decisions']} decisions, {100 * point['completed']:.1f} %"
                print(f"{combination} seed {seed}: {done}", flush=True)
                write_json(options.json, figures)
    return figures


def draw(figures: dict[str, Any], path: Path) -> None:
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    axes = figure.add_subplot()
    names = dict.fromkeys(entry["combination"] for entry in figures["curves"])
    colours = {name: f"C{k}" for k, name in enumerate(names)}
    for entry in figures["curves"]:
        name, points = entry["combination"], entry["points"]
        label = name if entry["seed"] == figures["settings"]["seeds"][0] else None
        x, y = [point["decisions"] for point in points], [100 * point["completed"] for point in points]
        axes.plot(x, y, color=colours[name], marker=".", label=label)
    for name, share in figures["baselines"].items():
        axes.axhline(100 * share, color="grey", linestyle="--" if name == "nearest" else ":", label=name)
    settings = figures["settings"]
    axes.set(xlabel="decisions", ylabel="rounds completed, %", ylim=(0, 100), xlim=(0, None))
    axes.set_title(f"{settings['learner']}, {settings['map']}, tested on {settings['test']}; {figures['version']}")
    axes.legend(fontsize="small")
    with replaced(path) as temporary:
        figure.savefig(temporary, format="png", dpi=120)


def main(argv: Sequence[str] | None = None) -> int:
    parser = Parser(prog="pacman-env learning-curves", description=__doc__)
    add = parser.add_argument
    add("--combinations", nargs="+", default=["planner/event"], metavar="NAME", help=" ".join(COMBINATIONS))
    add("--learner", choices=[*LEARNERS], default="maskable_ppo")
    add("--map", default="generated", metavar="FILE_OR_NAME", help="to learn on (%(default)s)")
    add("--test", default="generated:test", metavar="FILE_OR_NAME", help="to play on (%(default)s)")
    add("--decisions", type=whole_number(1), default=200_000, metavar="N", help="(%(default)s)")
    add("--seeds", type=whole_number(0), nargs="+", default=[0], metavar="S", help="of learners (0)")
    add("--rounds", type=whole_number(1), default=100, metavar="N", help="after each update (100)")
    add("--n-steps", type=whole_number(2), metavar="N", help="decisions per game and update (SB3's own)")
    add("--json", type=Path, default=Path("results/learning_curves.json"), metavar="OUT")
    add("--plot", type=Path, default=Path("results/learning_curves.png"), metavar="OUT")
    add("--quick", action="store_true", help="everything in short: 256 decisions, 8 rounds")
    return run_command(parser, argv, _report, "train")


def _report(options: argparse.Namespace) -> None:
    if options.quick:
        options.decisions, options.rounds, options.n_steps = 256, 8, 16
    for path in (options.json, options.plot):
        prepare(path)
    figures = run(options)
    draw(figures, options.plot)
    print(*(f"{name}: {100 * share:.1f} %" for name, share in figures["baselines"].items()), sep="\n")
    print(f"written: {options.json} and {options.plot}")
