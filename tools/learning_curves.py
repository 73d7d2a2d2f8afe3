"""Measure how fast stock learners learn, one curve per configuration and seed: ``python -m tools.learning_curves``.

The configurations of ``baselines.yaml`` are Stable-Baselines3's PPO or sb3-contrib's MaskablePPO, with defaults or with
tuned values. At intervals the model plays the same test rounds, which ``nearest`` and ``random_pellet`` play too.
"""

import argparse
import sys
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np
import torch
from matplotlib.figure import Figure
from sb3_contrib import MaskablePPO
from sb3_contrib.common.maskable.evaluation import evaluate_policy as evaluate_masked
from stable_baselines3 import PPO
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.preprocessing import is_image_space
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from pacman_env import __version__
from pacman_env.command_line.command import Parser, run_command, whole_number
from pacman_env.config import located
from pacman_env.config.validation import convert
from pacman_env.config.yaml_files import read_yaml
from pacman_env.envs.arguments import EnvArguments
from pacman_env.episodes.rollout import play
from pacman_env.episodes.statistics import wilson
from pacman_env.files import prepare, write_json
from pacman_env.game.ends import COMPLETE
from pacman_env.sb3 import PacManBotVecEnv
from tools.common import ROOT

FILE = ROOT / "train" / "hyperparameters" / "baselines.yaml"
_LEARNERS: dict[str, Any] = {"maskable_ppo": (MaskablePPO, evaluate_masked), "ppo": (PPO, evaluate_policy)}
_TEST_GAMES, _TEST_SEED = 8, 1_000_000  # games in parallel; seed of the test rounds
Curve = dict[str, Any]


class Baseline(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Configuration of a training with a stock learner."""

    environment: dict[str, Any] = {}  # arguments of PacManBotVecEnv
    learner: Literal["maskable_ppo", "ppo"] = "maskable_ppo"
    policy: Literal["MlpPolicy", "MultiInputPolicy"] = "MlpPolicy"
    games: int = 8  # games in parallel
    decisions: int = 200_000
    every: int = 0  # decisions between two points of the curve; 0: one update
    normalize: bool = False  # normalize observations and rewards by running mean and deviation
    test: str = "generated:test"  # map of the test rounds
    hyperparameters: dict[str, Any] = {}  # of the learner; learning_rate: at the start and at the end

    def wrapped(self, map_name: str, games: int, training: bool = True) -> VecEnv:
        """Return games on a map with the wrapper for the learner."""
        settings = {"observation.numeric_info": True, **self.environment.get("settings", {})}
        arguments = {"flat": True, **self.environment, "map": map_name, "settings": settings}
        env: VecEnv = PacManBotVecEnv(games, **arguments)
        if self.normalize:
            spaces = getattr(env.observation_space, "spaces", None)
            keys = spaces and [key for key, space in spaces.items() if not is_image_space(space)]
            gamma = self.hyperparameters.get("gamma", 0.99)
            env = VecNormalize(env, training, norm_reward=training, gamma=gamma, norm_obs_keys=keys)
        return env

    def make_model(self, seed: int) -> BaseAlgorithm:
        torch.set_num_threads(1)  # networks this small are fastest on one core
        values = {"learning_rate": [3e-4, 3e-4], **self.hyperparameters, "seed": seed, "device": "cpu"}
        values["learning_rate"] = LinearSchedule(values["learning_rate"][0], values["learning_rate"][1], 1.0)
        values["policy_kwargs"] = {key: values.pop(key) for key in ("net_arch", "log_std_init") if key in values}
        return _LEARNERS[self.learner][0](self.policy, self.wrapped(self.environment["map"], self.games), **values)


class _Tests(BaseCallback):
    """Play the test rounds at intervals between updates, and after the last update."""

    def __init__(self, name: str, baseline: Baseline, rounds: int) -> None:
        super().__init__()
        self._name, self._baseline, self._rounds = name, baseline, rounds
        self._test = baseline.wrapped(baseline.test, _TEST_GAMES, training=False)
        self._tested, self.points = 0, list[dict[str, Any]]()
        self.won: dict[int, bool] = {}  # by the seed of the round

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        if self.num_timesteps - self._tested >= max(self._baseline.every, 1):
            self._on_training_end()

    def _on_training_end(self) -> None:
        """Play the test rounds, always the same, with the best actions."""
        self._tested, self.won = self.num_timesteps, {}
        if isinstance(self._test, VecNormalize) and (normalizer := self.model.get_vec_normalize_env()):
            self._test.obs_rms = normalizer.obs_rms
        self._test.seed(_TEST_SEED)
        evaluate = _LEARNERS[self._baseline.learner][1]
        evaluate(self.model, self._test, n_eval_episodes=self._rounds, callback=self._end_of_a_round)
        self.points.append({"decisions": self.num_timesteps, **(reached := completed([*self.won.values()]))})
        print(f"{self._name}: {self.num_timesteps} decisions, {100 * reached['completed']:.1f} %", flush=True)

    def _end_of_a_round(self, now: dict[str, Any], _: dict[str, Any]) -> None:
        if now["done"]:
            self.won[now["info"]["round_seed"]] = now["info"]["outcome"] == COMPLETE


def completed(won: Any) -> dict[str, Any]:
    return {"completed": float(np.mean(won)), "completed_interval": wilson(int(np.sum(won)), len(won))}


def curve(task: tuple[str, Baseline, int, int]) -> Curve:
    """Train one learner; return the points of its curve and the reference policies' results in the same test rounds."""
    name, baseline, seed, rounds = task
    tests = _Tests(f"{name} seed {seed}", baseline, rounds)
    baseline.make_model(seed).learn(baseline.decisions, callback=tests)
    arguments = EnvArguments(map=baseline.test, preset=baseline.environment.get("preset", "robot"))
    config, _ = arguments.make_config()
    seeds, source = np.array([*tests.won], dtype=np.uint64), arguments.make_source(config)
    rules = "nearest", "random_pellet"
    references = {rule: completed(play(source, config, rule, seeds)[0]["end"] == COMPLETE) for rule in rules}
    return {"name": name, "seed": seed, "points": tests.points, "references": references}


def chosen(options: argparse.Namespace) -> dict[str, Baseline]:
    """Return the selected configurations by name, with fields replaced by the given options."""
    with located(FILE, ValueError):
        known = {name: convert(values, Baseline, name) for name, values in read_yaml(FILE).items()}
    if unknown := [name for name in options.names if name not in known]:
        raise ValueError(f"{unknown[0]!r}: choose among {' '.join(known)}")
    changes = {key: getattr(options, key) for key in ("decisions", "test") if getattr(options, key) is not None}
    result = {}
    for name in options.names:
        environment, hyper = {**known[name].environment}, {**known[name].hyperparameters}
        environment["map"] = options.map or environment.get("map", "generated")
        if options.quick:
            environment["settings"] = {**environment.get("settings", {}), "time_limit_s": 60.0}
            hyper |= {"n_steps": 16, "batch_size": 64}
        result[name] = msgspec.structs.replace(known[name], environment=environment, hyperparameters=hyper, **changes)
    return result


def draw(curves: Sequence[Curve], path: Path) -> None:
    """Draw a diagram for each configuration: a curve for each seed, a horizontal line for each reference policy."""
    names = list(dict.fromkeys(one["name"] for one in curves))
    figure = Figure(figsize=(7, 3.5 * len(names)), layout="constrained")
    for number, name in enumerate(names, 1):
        axes = figure.add_subplot(len(names), 1, number)
        for one in (one for one in curves if one["name"] == name):
            x, y = zip(*((point["decisions"], 100 * point["completed"]) for point in one["points"]), strict=True)
            axes.plot(x, y, marker=".", label=f"seed {one['seed']}")
            low, high = 100 * np.array([point["completed_interval"] for point in one["points"]]).T
            axes.fill_between(x, low, high, alpha=0.15)
            for rule, reached in one["references"].items():
                axes.axhline(100 * reached["completed"], color="grey", linestyle="--" if rule == "nearest" else ":")
        axes.set(title=name, xlabel="decisions", ylabel="rounds completed, %", ylim=(0, 100), xlim=(0, None))
        axes.legend(fontsize="small")
    figure.savefig(path, format="png", dpi=120)


def main(argv: Sequence[str] | None = None) -> int:
    parser = Parser(prog="python -m tools.learning_curves", description=__doc__)
    add = parser.add_argument
    add("names", nargs="*", default=["planner/event"], metavar="NAME", help=f"of {FILE.name} (planner/event)")
    add("--map", metavar="FILE_OR_NAME", help="to learn on, in place of generated")
    add("--test", metavar="FILE_OR_NAME", help="to play on, in place of generated:test")
    add("--decisions", type=whole_number(1), metavar="N", help="in place of 200000, or the baseline's")
    add("--seeds", type=whole_number(0), nargs="+", default=[0], metavar="S", help="of learners (0)")
    add("--rounds", type=whole_number(1), default=100, metavar="N", help="for each point of a curve (100)")
    add("--workers", type=whole_number(1), default=1, metavar="N", help="processes, each with a learner (1)")
    out = Path("results/learning_curves")
    add("--out", type=Path, default=out, help="name of the .json and the .png (%(default)s)")
    add("--quick", action="store_true", help="everything in short: 256 decisions, 8 rounds of a minute")
    return run_command(parser, argv, _report, "train")


def _report(options: argparse.Namespace) -> None:
    if options.quick:
        options.decisions, options.rounds = 256, 8
    file, selected = prepare(options.out.with_suffix(".json")), chosen(options)
    tasks = [(name, one, seed, options.rounds) for name, one in selected.items() for seed in options.seeds]
    apply: Any = map if options.workers == 1 else ProcessPoolExecutor(options.workers, get_context("spawn")).map
    curves = list(apply(curve, tasks))
    write_json(file, {"version": __version__, "configurations": msgspec.to_builtins(selected), "curves": curves})
    draw(curves, file.with_suffix(".png"))


if __name__ == "__main__":
    sys.exit(main())
