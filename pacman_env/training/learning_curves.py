"""Measure how fast stock learners learn, one curve per configuration and seed: ``pacman-env learning-curves``.

The learner is Stable-Baselines3's PPO or sb3-contrib's MaskablePPO, with its defaults on combinations of observation
and decisions, or with the tuned values of ``baselines.yaml``. At intervals the model plays the same test rounds, which
the policies ``nearest`` and ``random_pellet`` play too.
"""

import argparse
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import gymnasium
import msgspec
import numpy as np
import sb3_contrib
import stable_baselines3
import torch
from matplotlib.figure import Figure
from numpy.typing import NDArray
from sb3_contrib.common.maskable.evaluation import evaluate_policy as evaluate_masked
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecNormalize

from pacman_env import __version__
from pacman_env.command_line.command import Parser, run_command, whole_number
from pacman_env.envs.arguments import EnvArguments
from pacman_env.episodes.rollout import play
from pacman_env.executors.choice import local
from pacman_env.files import prepare, replaced, write_json
from pacman_env.training.baselines import FILE, LEARNERS, Baseline, Environment, check, load_baselines, point, shares

_KINDS: dict[str, dict[str, Any]] = {
    "planner": {},
    "features": {"observation": ("features", "flat")},
    # Stable-Baselines3 scales pictures itself.
    "grid": {"observation": ("features", "grid"), "settings": {"observation.normalize": False}},
}
#: Learners with their defaults, by observation and decision times.
COMBINATIONS = {
    f"{kind}/{decide}": Baseline(
        environment=Environment(
            flat=True, **{**given, "settings": {**given.get("settings", {}), "decisions.when": decide}}
        ),
        policy="MultiInputPolicy" if kind == "grid" else "MlpPolicy",
    )
    for kind, given in _KINDS.items()
    for decide in ("event", "tick")
}
_RULES = ("nearest", "random_pellet")
_TEST_GAMES = 8  # games in parallel
_TEST_SEED = 1_000_000  # seed of the test rounds
Point = dict[str, Any]  # point of a curve: figures after some decisions


class _Tests(BaseCallback):
    """Play the test rounds at intervals between updates, and after the last update."""

    def __init__(self, baseline: Baseline, rounds: int, note: Callable[[Point], None]) -> None:
        super().__init__()
        self._baseline, self._rounds, self._note = baseline, rounds, note
        self._test = baseline.wrapped(baseline.make_games(baseline.test, _TEST_GAMES), training=False)
        self._began, self._tested = time.perf_counter(), 0
        #: End, share of pellets and number of caught ghosts by the seed of the round.
        self.played: dict[int, tuple[int, float, int]] = {}

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        if self.num_timesteps - self._tested >= max(self._baseline.every, 1):
            self._play()

    def _on_training_end(self) -> None:
        if self.num_timesteps > self._tested:
            self._play()

    def _play(self) -> None:
        """Play the test rounds, always the same, with the best actions."""
        learning_s = time.perf_counter() - self._began
        self._tested, self.played = self.num_timesteps, {}
        normalizer = self.model.get_vec_normalize_env()
        if normalizer is not None and isinstance(self._test, VecNormalize):
            self._test.obs_rms = normalizer.obs_rms
        self._test.seed(_TEST_SEED)
        evaluate = evaluate_masked if self._baseline.learner == "maskable_ppo" else evaluate_policy
        evaluate(self.model, self._test, n_eval_episodes=self._rounds, callback=self._end_of_a_round)
        results = np.array([*self.played.values()]).T
        self._note(point(self.model, self.num_timesteps, learning_s, shares(*results)))
        self._began = time.perf_counter() - learning_s

    def _end_of_a_round(self, now: dict[str, Any], _: dict[str, Any]) -> None:
        if now["done"]:
            info = now["info"]
            share = info["collected"] / info["spawned"]
            self.played[info["round_seed"]] = info["outcome"], share, info["ghosts_caught"]


def references(map_name: str, preset: str, seeds: NDArray[np.uint64]) -> dict[str, Point]:
    """Return the results of the reference policies in the rounds ``seeds``, with goals and the settings of a preset."""
    arguments = EnvArguments(map=map_name, preset=preset)
    config, _ = arguments.make_config()
    source = arguments.make_source(config)
    result = {}
    for name in _RULES:
        records, _ = play(source, config, name, seeds)
        result[name] = shares(records["end"], records["collected"] / records["spawned"], records["ghosts_caught"])
    return result


def curve(name: str, baseline: Baseline, seed: int, rounds: int) -> dict[str, Any]:
    """Train one learner; return the points of its curve and the reference policies' results in the same test rounds."""
    points: list[Point] = []

    def note(new: Point) -> None:
        points.append(new)
        done = f"{100 * new['completed']:.1f} % of the rounds, {100 * new['pellets']:.1f} % of the pellets"
        done += f", a ghost caught in {100 * new['ghost_caught']:.1f} %" if new["ghost_caught"] else ""
        print(f"{name} seed {seed}: {new['decisions']} decisions, {done}", flush=True)

    entry: dict[str, Any] = {"name": name, "seed": seed, "points": points}
    model = baseline.make_model(baseline.make_games(baseline.environment.map, baseline.games), seed)
    tests = _Tests(baseline, rounds, note)
    model.learn(baseline.decisions, callback=tests)
    seeds = np.array([*tests.played], dtype=np.uint64)
    return entry | {"references": references(baseline.test, baseline.environment.preset, seeds)}


def chosen(options: argparse.Namespace) -> dict[str, Baseline]:
    """Return the selected baselines by name, with fields replaced by the given options."""
    baselines = COMBINATIONS if options.baselines is None else load_baselines(options.config)
    names = options.combinations if options.baselines is None else options.baselines or [*baselines]
    kind = "combination" if options.baselines is None else "baseline"
    for name in names:
        if name not in baselines:
            raise ValueError(f"{kind} {name!r}: choose among {' '.join(baselines)}")
    fields = {name: getattr(options, name) for name in ("learner", "decisions", "test")}
    changes = {name: value for name, value in fields.items() if value is not None}
    selected = {name: _changed(baselines[name], changes, options) for name in names}
    for name, baseline in selected.items():
        check(name, baseline)
    return selected


def _changed(baseline: Baseline, changes: dict[str, Any], options: argparse.Namespace) -> Baseline:
    replace = msgspec.structs.replace
    environment, hyper = baseline.environment, baseline.hyperparameters
    if options.map is not None:
        environment = replace(environment, map=options.map)
    if options.quick:
        environment = replace(environment, settings={**environment.settings, "time_limit_s": 60.0})
    if options.n_steps is not None:
        batch = min(hyper.batch_size, options.n_steps * baseline.games)
        hyper = replace(hyper, n_steps=options.n_steps, batch_size=batch)
    return replace(baseline, environment=environment, hyperparameters=hyper, **changes)


def entries(chosen: dict[str, Baseline], options: argparse.Namespace) -> Iterator[list[dict[str, Any]]]:
    """Yield all finished curves after each one, in the order of configurations and seeds."""
    tasks = [(name, one, seed, options.rounds) for name, one in chosen.items() for seed in options.seeds]
    curves: dict[int, dict[str, Any]] = {}
    with local(options.workers) as executor:
        for done in executor.run(_curve, tasks):
            curves[done.number] = done.result()
            yield [curves[number] for number in sorted(curves)]


def _curve(task: tuple[str, Baseline, int, int]) -> dict[str, Any]:
    return curve(*task)


def run(options: argparse.Namespace) -> dict[str, Any]:
    baselines = chosen(options)
    for baseline in baselines.values():  # report errors before any training
        baseline.make_games(baseline.environment.map, 1).close()
    libraries = (gymnasium, stable_baselines3, sb3_contrib, torch)
    figures: dict[str, Any] = {
        "version": __version__,
        "libraries": {library.__name__: library.__version__ for library in libraries},
        "settings": {key: value for key, value in vars(options).items() if key not in ("json", "plot", "quick")},
        "configurations": {name: msgspec.to_builtins(baseline) for name, baseline in baselines.items()},
        "curves": [],
    }
    for curves in entries(baselines, options):
        figures["curves"] = curves
        write_json(options.json, figures)
    return figures


def draw(figures: dict[str, Any], path: Path) -> None:
    """Draw a diagram for each configuration: a curve for each seed, a horizontal line for each reference policy."""
    curves = figures["curves"]
    names = list(dict.fromkeys(entry["name"] for entry in curves))
    columns = min(len(names), 3)
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(max(4.0 * columns, 7), 0.5 + 3.5 * rows), layout="constrained")
    for number, name in enumerate(names, 1):
        axes, baseline = figure.add_subplot(rows, columns, number), figures["configurations"][name]
        for entry in (entry for entry in curves if entry["name"] == name):
            x = [point["decisions"] for point in entry["points"]]
            y = [100 * point["completed"] for point in entry["points"]]
            (line,) = axes.plot(x, y, marker=".", label=f"seed {entry['seed']}")
            low, high = (100 * np.array([point["completed_interval"] for point in entry["points"]])).T
            axes.fill_between(x, low, high, color=line.get_color(), alpha=0.15)
        for rule, reached in entry["references"].items():
            axes.axhline(
                100 * reached["completed"], color="grey", linestyle="--" if rule == "nearest" else ":", label=rule
            )
        axes.set(xlabel="decisions", ylabel="rounds completed, %", ylim=(0, 100), xlim=(0, None))
        axes.set_title(f"{name}: {baseline['learner']}, tested on {baseline['test']}", fontsize="medium")
        axes.legend(fontsize="small")
    figure.suptitle(f"pacman_env {figures['version']}")
    with replaced(path) as temporary:
        figure.savefig(temporary, format="png", dpi=120)


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(make_parser(), argv, _report, "train")


def make_parser() -> Parser:
    parser = Parser(prog="pacman-env learning-curves", description=__doc__)
    add = parser.add_argument
    group = parser.add_mutually_exclusive_group()
    group.add_argument(
        "--combinations", nargs="+", default=["planner/event"], metavar="NAME", help=" ".join(COMBINATIONS)
    )
    group.add_argument(
        "--baselines", nargs="*", metavar="NAME", help="of the file --config; without a name all of them"
    )
    add("--config", type=Path, default=FILE, metavar="YAML", help=f"the baselines ({FILE.name})")
    add("--learner", choices=[*LEARNERS], help="in place of maskable_ppo, or the baseline's")
    add("--map", metavar="FILE_OR_NAME", help="to learn on, in place of generated, or the baseline's")
    add("--test", metavar="FILE_OR_NAME", help="to play on, in place of generated:test, or the baseline's")
    add("--decisions", type=whole_number(1), metavar="N", help="in place of 200000, or the baseline's")
    add("--seeds", type=whole_number(0), nargs="+", default=[0], metavar="S", help="of learners (0)")
    add("--rounds", type=whole_number(1), default=100, metavar="N", help="for each point of a curve (100)")
    add("--n-steps", type=whole_number(2), metavar="N", help="decisions per game and update (SB3's own)")
    add("--workers", type=whole_number(1), default=1, metavar="N", help="processes, each with a learner (1)")
    add("--json", type=Path, default=Path("results/learning_curves.json"), metavar="OUT")
    add("--plot", type=Path, default=Path("results/learning_curves.png"), metavar="OUT")
    add("--quick", action="store_true", help="everything in short: 256 decisions, 8 rounds of a minute")
    return parser


def _report(options: argparse.Namespace) -> None:
    if options.quick:
        options.decisions, options.rounds, options.n_steps = 256, 8, 16
    for path in (options.json, options.plot):
        prepare(path)
    figures = run(options)
    draw(figures, options.plot)
    for entry in figures["curves"]:
        reached = {f"seed {entry['seed']}": entry["points"][-1], **entry["references"]}
        print(f"{entry['name']}:", *(f"{who} {100 * one['completed']:.1f} %" for who, one in reached.items()))
    print(f"written: {options.json} and {options.plot}")
