"""Train the baselines of ``baselines.yaml`` and test them in new houses: ``python -m tools.learning_curves``.

Each finished run is a file, so a later call trains only what is missing or has another configuration. Afterwards the
page docs/benchmark.md and its picture show all results.
"""

import argparse
import sys
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import gymnasium
import msgspec
import numpy as np
import sb3_contrib
import stable_baselines3
import torch
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.preprocessing import is_image_space
from stable_baselines3.common.utils import LinearSchedule
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from pacman_env.command_line.command import Parser, run_command, whole_number
from pacman_env.envs.registration import IDS
from pacman_env.files import prepare, write_text
from pacman_env.sb3 import PacManBotVecEnv
from tools import baselines, reference, scores
from tools.baselines import Baseline
from tools.common import IMAGES, ROOT
from tools.figures import store

_TEST_SEED = 1_000_000  # of the first test round, whose reset has this seed
_GAMES = 100  # test games in parallel
Job = tuple[Path, str, Baseline, int]  # folder of the results, name, configuration, seed


def make_model(baseline: Baseline, seed: int) -> BaseAlgorithm:
    torch.set_num_threads(1)  # networks this small are fastest on one core
    env_id = f"pacman_env/{baseline.id}"
    env: VecEnv = PacManBotVecEnv(baseline.games, **{**IDS[env_id].kwargs, **baseline.arguments})
    values = {"learning_rate": [3e-4, 3e-4], **baseline.hyperparameters, "seed": seed, "device": "cpu"}
    values["learning_rate"] = LinearSchedule(*values["learning_rate"], 1.0)
    if baseline.normalize:
        spaces = getattr(env.observation_space, "spaces", None)
        keys = spaces and [key for key, space in spaces.items() if not is_image_space(space)]
        env = VecNormalize(env, gamma=values.get("gamma", 0.99), norm_obs_keys=keys)
    learner = getattr(sb3_contrib, baseline.learner, None) or getattr(stable_baselines3, baseline.learner)
    return learner(baseline.policy, env, **values)


def test(model: BaseAlgorithm, baseline: Baseline, map_name: str, rounds: int) -> dict[str, Any]:
    """Play the test rounds with the best actions, always the same rounds."""
    normalizer, state = model.get_vec_normalize_env(), None

    def choose(envs: Any, observation: Any, started: Any) -> Any:
        nonlocal state
        seen = normalizer.normalize_obs(observation) if normalizer else observation
        masks = {"action_masks": envs.action_masks()} if baseline.learner == "MaskablePPO" else {}
        actions, state = model.predict(seen, state, started, deterministic=True, **masks)
        return actions

    return played(baseline, map_name, choose, rounds)


def played(baseline: Baseline, map_name: str, player: str | scores.Chooser, rounds: int) -> dict[str, Any]:
    """Return the mean return, and a digit for each round: 1 if it was completed."""
    result: dict[str, list[Any]] = {"rounds": [], "return": []}
    for first in range(_TEST_SEED, _TEST_SEED + rounds, _GAMES):
        seeds = range(first, min(first + _GAMES, _TEST_SEED + rounds))
        part = scores.play(f"pacman_env/{baseline.id}", player, seeds, **baseline.test(map_name))
        for key, values in result.items():
            values += part[key]
    return {"won": "".join(map(str, result["rounds"])), "return": round(float(np.mean(result["return"])), 3)}


class _Curve(BaseCallback):
    """Play the test rounds at intervals between updates, and measure their processor time."""

    def __init__(self, baseline: Baseline) -> None:
        super().__init__()
        self._baseline, self.points, self.tests_s = baseline, list[list[float]](), 0.0

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        if self.num_timesteps >= len(self.points) * self._baseline.decisions / self._baseline.points:
            self.add(self._baseline.tests[0], self._baseline.rounds)

    def add(self, map_name: str, rounds: int) -> dict[str, Any]:
        """Play rounds on a map and, if it is the map of the curve, add a point."""
        start = time.process_time()
        result = test(self.model, self._baseline, map_name, rounds)
        self.tests_s += time.process_time() - start
        if map_name == self._baseline.tests[0]:
            share = round(result["won"].count("1") / rounds, 4)
            self.points.append([self.num_timesteps, share, result["return"]])
            print(f"  {self.num_timesteps:9,} decisions: {100 * share:5.1f} %, {result['return']:6.2f}", flush=True)
        return result


def train(job: Job) -> None:
    """Train a baseline with a seed and store its curve and last tests, unless they are stored."""
    folder, name, baseline, seed = job
    file, record = baselines.stored(folder, f"{name}-{seed}", baseline)
    if record is None:
        print(f"{name}, seed {seed}", flush=True)
        start, curve, model = time.process_time(), _Curve(baseline), make_model(baseline, seed)
        model.learn(baseline.decisions, callback=curve)
        training_s = time.process_time() - start - curve.tests_s
        tests = {each: curve.add(each, baseline.last_rounds) for each in baseline.tests}
        values = {"seed": seed, "training_s": round(training_s), "tests_s": round(curve.tests_s), "tests": tests}
        _write(file, name, (baseline,), **values, points=curve.points)


def play_references(job: Job) -> None:
    """Play and store the test rounds of a baseline with the reference policies, unless they are stored."""
    folder, _, baseline, _ = job
    for map_name in baseline.tests:
        name, rounds = baseline.test_name(map_name), baseline.last_rounds
        file, record = baselines.stored(folder, name, name, rounds)
        if record is None:
            print(f"{name}: reference policies", flush=True)
            drives = IDS[f"pacman_env/{baseline.id}"].kwargs.get("action") == "velocity"
            policies = [*baselines.LINES][: 1 if drives else None]
            shown = {policy: played(baseline, map_name, policy, rounds) for policy in policies}
            _write(file, "", (name, rounds), policies=shown)


def _write(file: Path, name: str, configuration: tuple[Any, ...], **values: Any) -> None:
    record = store.record(f"python -m tools.learning_curves {name}".strip(), ("engine", "features", "settings"), None)
    record |= {"hash": baselines.hash_of(*configuration), "configuration": msgspec.to_builtins(configuration)}
    versions = {module.__name__: module.__version__ for module in (torch, stable_baselines3, sb3_contrib, gymnasium)}
    write_text(prepare(file), store.text({**record, "libraries": versions, **values}, 1) + "\n")


def jobs(options: argparse.Namespace) -> list[Job]:
    """Return the runs in order: the first seed of each baseline, then the second one, and so on."""
    known = baselines.read()
    if unknown := [name for name in options.names if name not in known]:
        raise ValueError(f"names = {unknown[0]!r}: must be among {' '.join(known)}")
    chosen = {name: one for name, one in known.items() if name in options.names or (one.seeds and not options.names)}
    if options.quick:
        chosen = {name: _short(one) for name, one in chosen.items()}
    seeds = options.seeds or range(max(one.seeds for one in chosen.values()))
    return [
        (options.out, name, one, seed)
        for seed in seeds
        for name, one in chosen.items()
        if options.seeds or seed < one.seeds
    ]


def _short(one: Baseline) -> Baseline:
    arguments = {**one.arguments, "settings": {**one.arguments.get("settings", {}), "time_limit_s": 20.0}}
    small = {"n_steps": 16, "batch_size": 64, "learning_starts": 32}
    hyper = {key: small.get(key, value) for key, value in one.hyperparameters.items()}
    changes = {"decisions": 512, "points": 2, "rounds": 4, "last_rounds": 8, "seeds": 1}
    return msgspec.structs.replace(one, arguments=arguments, hyperparameters=hyper, **changes)


def _run(options: argparse.Namespace) -> None:
    if options.quick and options.out == baselines.RESULTS:
        options.out = ROOT / "results" / "benchmark"
    if not options.page:
        apply: Any = map if options.workers == 1 else ProcessPoolExecutor(options.workers, get_context("spawn")).map
        for _ in apply(_job, jobs(options)):
            pass
    if options.out == baselines.RESULTS:
        page = ROOT / "docs" / "benchmark.md"
        write_text(page, reference.fill(page.read_text(encoding="utf-8")))
        baselines.draw(IMAGES / "baselines.svg")


def _job(job: Job) -> None:
    play_references(job)
    train(job)


def main(argv: Sequence[str] | None = None) -> int:
    parser = Parser(prog="python -m tools.learning_curves", description=__doc__)
    add = parser.add_argument
    add("names", nargs="*", metavar="NAME", help=f"of {baselines.FILE.name} (all of the benchmark)")
    add("--seeds", type=whole_number(0), nargs="+", metavar="S", help="of learners (all of the benchmark)")
    add("--workers", type=whole_number(1), default=1, metavar="N", help="processes, each with a learner (1)")
    add("--out", type=Path, default=baselines.RESULTS, metavar="FOLDER", help="of the results (docs/benchmark)")
    add("--quick", action="store_true", help="everything in short, to see that it works")
    add("--page", action="store_true", help="train nothing, write the stored results into page and picture")
    return run_command(parser, argv, _run, "train")


if __name__ == "__main__":
    sys.exit(main())
