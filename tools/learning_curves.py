"""Train the baselines of ``baselines.yaml``, and test them in new houses: ``python -m tools.learning_curves``.

A baseline is a stock learner with its hyperparameters, or a built-in policy for comparison. Each finished run is a
file, so a later call plays only what is missing or has another configuration. All results are on docs/benchmark.md.
"""

import argparse
import json
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Literal

import msgspec
import numpy as np

from pacman_env.command_line.command import Parser, run_command, whole_number
from pacman_env.config import located
from pacman_env.config.validation import convert
from pacman_env.config.yaml_files import read_yaml
from pacman_env.envs.registration import IDS
from pacman_env.episodes.statistics import wilson
from pacman_env.files import prepare, write_text
from tools import scores
from tools.common import IMAGES, ROOT, add_names, table
from tools.figures import store
from tools.figures.views import VIEWS

PAGE = ROOT / "docs" / "benchmark.md"
RESULTS = PAGE.with_suffix("")
_FILE = ROOT / "train" / "hyperparameters" / "baselines.yaml"
_TEST_SEED = 1_000_000  # of the first test round
_LINES = {  # colour and style of the built-in policies
    "random": ("#57606a", ":"), "nearest": ("#57606a", "--"), "clyde_aware": ("#57606a", "-."),
    "lookahead": ("#2f8f4e", "--"), "ppo": ("#b38600", "-"),
}  # fmt: skip
_STYLE = {
    "svg.fonttype": "none", "svg.hashsalt": "baselines", "xtick.bottom": False, "ytick.left": False,
    "font.sans-serif": ["DejaVu Sans"], "font.size": 9, "axes.titlesize": 9,
    **dict.fromkeys(("text.color", "axes.labelcolor", "axes.titlecolor", "xtick.color", "ytick.color"), "#1b1f24"),
    **dict.fromkeys(("axes.edgecolor", "legend.edgecolor"), "#d0d7de"),
    **dict.fromkeys(("axes.facecolor", "figure.facecolor", "legend.facecolor"), "#ffffff"),
}  # fmt: skip
Record = dict[str, Any]


class Baseline(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Configuration of a training with a stock learner, and of its tests."""

    id: str
    arguments: dict[str, Any] = {}  # of the id
    tests: tuple[str, ...] = ("generated:test",)  # maps of the test rounds; the curve shows the first
    learner: Literal["MaskablePPO", "PPO", "QRDQN", "RecurrentPPO", "SAC", "built-in"]
    policy: str = "MlpPolicy"  # the learner's network, or the built-in policy
    games: int = 16  # games in parallel
    decisions: int = 300_000
    seeds: int = 0  # number of seeds in the benchmark
    normalize: bool = False  # normalize observations and rewards by running mean and deviation
    hyperparameters: dict[str, Any] = {}  # of the learner; learning_rate: at the start and at the end
    points: int = 10  # of the curve, before the last tests
    rounds: int = 200  # for each point
    last_rounds: int = 400  # after the training, on each map

    @property
    def facts(self) -> Record:
        """Return all fields as plain data, except the number of seeds, which changes no run."""
        every = json.loads(msgspec.json.encode(self))
        return {name: value for name, value in every.items() if name != "seeds"}

    def play(self, map_name: str, player: Any, rounds: int) -> Record:
        """Play test rounds, always the same; return the mean return, and for each round 1 if it was completed."""
        arguments = {**self.arguments, "map": map_name}
        played = scores.play_all(self.id, player, range(_TEST_SEED, _TEST_SEED + rounds), **arguments)
        return {"won": "".join(map(str, played["rounds"])), "return": round(float(np.mean(played["return"])), 3)}


def read() -> dict[str, Baseline]:
    """Return the baselines by name, in the order of their training."""
    with located(_FILE, ValueError):
        return {name: convert(values, Baseline, name) for name, values in read_yaml(_FILE).items()}


def stored(file: Path, baseline: Baseline) -> Record | None:
    """Return the record in a file if it has this configuration."""
    record = json.loads(file.read_text(encoding="utf-8")) if file.is_file() else {}
    return record if record.get("configuration") == baseline.facts else None


def run(job: tuple[Path, Baseline, int]) -> None:
    """Play a baseline, which is trained first if it learns, and store its results, unless they are stored."""
    file, baseline, seed = job
    if stored(file, baseline):
        return
    print(file.stem, flush=True)
    if baseline.learner == "built-in":
        tests = {each: baseline.play(each, baseline.policy, baseline.last_rounds) for each in baseline.tests}
        values: Record = {"tests": tests}
    else:
        values = _train(baseline, seed)
    command = f"python -m tools.learning_curves {file.stem.rpartition('-')[0]} --seeds {seed}"
    record = store.record(command, ("engine", "features", "environments", "settings"), values)
    write_text(prepare(file), store.text({**record, "seed": seed, "configuration": baseline.facts}, 0) + "\n")


class _Model:
    """A model that plays test rounds with its best actions."""

    def __init__(self, model: Any, env: Any, learner: str) -> None:
        self._model, self._env, self._masked = model, env, learner == "MaskablePPO"

    def reset(self, *_: Any) -> None:
        self._memory: Any = None  # of a recurrent network

    def act(self, envs: Any, observation: Any) -> Any:
        seen = getattr(self._env, "normalize_obs", np.asarray)(observation)
        masks = {"action_masks": envs.action_masks()} if self._masked else {}
        actions, self._memory = self._model.predict(seen, self._memory, deterministic=True, **masks)
        return actions


def _train(baseline: Baseline, seed: int) -> Record:
    """Return the points of the curve, the last tests, the processor time of both, and the versions of libraries."""
    import sb3_contrib  # here, because the table is written without this extra
    import stable_baselines3 as sb3
    import torch

    from pacman_env.sb3 import PacManBotVecEnv

    torch.set_num_threads(1)  # networks this small are fastest on one core
    env: Any = PacManBotVecEnv(baseline.games, **{**IDS[baseline.id].kwargs, **baseline.arguments})
    given = {**baseline.facts["hyperparameters"], "seed": seed, "device": "cpu"}
    if "learning_rate" in given:
        first, last = given["learning_rate"]
        given["learning_rate"] = lambda left: last + left * (first - last)
    if baseline.normalize:
        env = sb3.common.vec_env.VecNormalize(env, gamma=given.get("gamma", 0.99))
    learner = getattr(sb3_contrib, baseline.learner, None) or getattr(sb3, baseline.learner)
    model = learner(baseline.policy, env, **given)
    player, points, start, tests_s = _Model(model, env, baseline.learner), list[list[float]](), time.process_time(), 0.0

    def add_point(rounds: int) -> Record:
        nonlocal tests_s
        began = time.process_time()
        result = baseline.play(baseline.tests[0], player, rounds)
        tests_s += time.process_time() - began
        points.append([model.num_timesteps, _share(result), result["return"]])
        print(f"{model.num_timesteps:9,} decisions: {100 * _share(result):.1f} %", flush=True)
        return result

    def at_intervals(*_: Any) -> bool:
        k = len(points)
        if k < baseline.points and model.num_timesteps >= k * baseline.decisions / baseline.points:
            add_point(baseline.rounds)
        return True

    at_intervals()
    model.learn(baseline.decisions, callback=at_intervals)
    training_s = round(time.process_time() - start - tests_s)
    tests = {baseline.tests[0]: add_point(baseline.last_rounds)}
    tests |= {each: baseline.play(each, player, baseline.last_rounds) for each in baseline.tests[1:]}
    versions = {module.__name__: module.__version__ for module in (torch, sb3, sb3_contrib)}
    return {"training_s": training_s, "tests_s": round(tests_s), "tests": tests, "points": points, **versions}


def _share(played: Record) -> float:
    return float(played["won"].count("1") / len(played["won"]))


def made() -> Iterator[tuple[str, Baseline, list[Record]]]:
    """Yield the name, the configuration and the records of the finished seeds of each baseline of the benchmark."""
    for name, one in read().items():
        if one.seeds:
            found = (stored(RESULTS / f"{name}-{seed}.json", one) for seed in range(one.seeds))
            yield name, one, [record for record in found if record]


def results() -> str:
    """Return the table of all finished runs; below it the versions that made them, and the missing runs."""
    rows, missing, stamps = list[list[str]](), list[str](), Counter[str]()
    for name, one, records in made():
        missing += [f"{one.seeds - len(records)} of `{name}`"] if len(records) < one.seeds else []
        stamps.update(VIEWS["stamp"](name, {name: record}, ()) for record in records)
        counts = ["-"] * 3
        if records and one.learner != "built-in":
            speed = np.mean([one.decisions / record["values"]["training_s"] for record in records])
            counts = [f"{one.decisions:,}", f"{speed:,.0f}", str(len(records))]
        for each in one.tests if records else ():
            ends = [record["values"]["tests"][each] for record in records]
            won = [_share(end) for end in ends]
            low, high = min(won), max(won)
            if len(ends) == 1:
                low, high = wilson(ends[0]["won"].count("1"), one.last_rounds)
            share = f"{100 * np.mean(won):.1f} [{100 * low:.1f}, {100 * high:.1f}]"
            returned = f"{np.mean([end['return'] for end in ends]):.1f}"
            rows.append([f"`{one.id.removeprefix('pacman_env/')}`, `{each}`", f"`{name}`", share, returned, *counts])
    rows.sort(key=lambda row: (row[0], -float(row[2].split()[0])))
    text = table(("Test rounds", "Player", "Completed, %", "Return", "Decisions", "Decisions/s", "Seeds"), rows)
    text += f"\nFinished runs: {'; '.join(f'{count} by {stamp}' for stamp, count in stamps.items())}."
    return f"{text} Not made yet: {', '.join(missing) or 'none'}.\n"


def draw(path: Path) -> None:
    """Draw a diagram for each learner: a thin curve for each seed, their mean, and lines for built-in policies."""
    import matplotlib  # here, because scripts/docs imports this module without the extra
    from matplotlib.figure import Figure

    every = [*made()]
    learners = [entry for entry in every if entry[1].learner != "built-in"]
    with matplotlib.rc_context(_STYLE):
        rows = -(-len(learners) // 3)
        figure = Figure(figsize=(8.6, 2.3 * rows + 0.7), layout="constrained")
        grid = figure.subplots(rows, 3, sharey=True, squeeze=False).flat
        for axes, (name, one, records) in zip(grid, learners, strict=False):
            axes.set(title=f"{name} ({len(records)} of {one.seeds})", xlim=(0, one.decisions / 1000), ylim=(0, 100))
            axes.spines[["top", "right"]].set_visible(False)
            axes.locator_params(nbins=4)
            for _, other, played in every:
                if played and other.learner == "built-in" and (other.id, other.tests[0]) == (one.id, one.tests[0]):
                    colour, style = _LINES[other.policy]
                    share = 100 * _share(played[0]["values"]["tests"][one.tests[0]])
                    axes.axhline(share, color=colour, linestyle=style, linewidth=1, label=other.policy)
            curves = [np.array(record["values"]["points"]).T for record in records]
            for curve in curves:
                axes.plot(curve[0] / 1000, 100 * curve[1], color="#2f6fd0", linewidth=0.6, label="a seed")
            if curves:
                mean = np.mean(curves, axis=0)
                axes.plot(mean[0] / 1000, 100 * mean[1], color="#2f6fd0", linewidth=2, label="mean of seeds")
        shown = {label: line for axes in figure.axes for line in axes.lines if (label := str(line.get_label()))}
        figure.legend(shown.values(), shown, loc="outside upper center", ncols=7, fontsize=8)
        figure.supylabel("completed test rounds, %", fontsize=9)
        figure.supxlabel("decisions, thousands", fontsize=9)
        figure.savefig(prepare(path), format="svg", metadata={"Date": None})


def _short(one: Baseline) -> Baseline:
    settings = {**one.arguments.get("settings", {}), "time_limit_s": 20.0}
    small = {"n_steps": 16, "batch_size": 64, "learning_starts": 32}
    hyper = {key: small.get(key, value) for key, value in one.hyperparameters.items()}
    changes = {"arguments": {**one.arguments, "settings": settings}, "hyperparameters": hyper}
    return msgspec.structs.replace(one, **changes, decisions=512, points=2, rounds=4, last_rounds=8)


def _run(options: argparse.Namespace) -> None:
    known = read()
    names = options.names or [name for name, one in known.items() if one.seeds]
    chosen = {name: _short(known[name]) if options.quick else known[name] for name in names}
    seeds = options.seeds or range(max(one.seeds for one in chosen.values()))
    out = options.out or (ROOT / "results" / "benchmark" if options.quick else RESULTS)
    every = ((name, one, seed) for seed in seeds for name, one in chosen.items() if options.seeds or seed < one.seeds)
    jobs = [(out / f"{name}-{seed}.json", one, seed) for name, one, seed in every]
    apply: Any = map if options.workers == 1 else ProcessPoolExecutor(options.workers, get_context("spawn")).map
    for _ in apply(run, jobs):
        pass
    if out == RESULTS:
        from tools import reference  # here, because it imports this module

        write_text(PAGE, reference.fill(PAGE.read_text(encoding="utf-8")))
        draw(IMAGES / "baselines.svg")


def main(argv: Sequence[str] | None = None) -> int:
    parser = Parser(prog="python -m tools.learning_curves", description=__doc__)
    add_names(parser, "baseline", read())
    add = parser.add_argument
    add("--seeds", type=whole_number(0), nargs="+", metavar="S", help="of learners (all of the benchmark)")
    add("--workers", type=whole_number(1), default=1, metavar="N", help="processes, each with a learner (1)")
    add("--out", type=Path, metavar="FOLDER", help="of the results (docs/benchmark; --quick: results/benchmark)")
    add("--quick", action="store_true", help="everything in short, to see that it works")
    return run_command(parser, argv, _run, "train")


if __name__ == "__main__":
    sys.exit(main())
