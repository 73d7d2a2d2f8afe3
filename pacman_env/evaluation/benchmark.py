"""Measure the speed of the environments as learners use them: ``pacman-env benchmark``.

Each row of the table is an environment id, created as learners do: by ``gymnasium.make``, by ``gymnasium.make_vec``
with the native vector environment, or as the wrapper for Stable-Baselines3. Rates are decisions and simulated seconds
per second of processor time of this process, in one thread, resets included. The time to choose actions counts only
for ``ppo``; random actions are drawn among the allowed ones. The row of bare Chipmunk only steps the bodies of 64 games
among the same walls. All rows are measured in turns, and the table shows the median over the rounds.
"""

import argparse
import gc
import json
import os
import platform
import re
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from datetime import date
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

# This file also runs as a script on the code of another checkout (benchmarks/versions.py), so it imports little.
import pacman_env
from pacman_env.command_line.command import Parser, count, finite_number, run_command
from pacman_env.files import prepare, write_json
from pacman_env.policies.registry import make_policy
from pacman_env.sim.maps import level_source
from pacman_env.world.navigation.physics import bare_stepper

HELD = 20  # ticks for which a random action is repeated, about as long as a planner pursues a goal
ROUNDS = 9
BARE = "bare Chipmunk, 64 bodies"
TRAINED = 65_536  # decisions of the short training
#: Number of houses to prepare before a row on generated houses; 0 for older versions without prepared houses.
HOUSES: int = getattr(level_source, "TRAIN_SET", 0)
Rates = tuple[float, float]  # decisions and simulated seconds per second of processor time


@dataclass(frozen=True)
class BenchmarkRow:
    """A row of the table: an environment, the number of its games, and the policy."""

    env: str
    made: str  # "make", "make_vec" or "sb3"
    games: int
    policy: str = "random"
    arguments: dict[str, Any] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Return the name that the table shows and ``--only`` searches."""
        more = "".join(f", {value}" for value in self.arguments.values())
        return f"{self.env}{more}, {self.made}, N = {self.games}, {self.policy}"


_BOT, _FLAT, _GENERATED = "PacManBot-v1", "PacManBotFlat-v1", "PacManBotFlatGenerated-v1"
ROWS = (
    BenchmarkRow(_BOT, "make", 1),
    BenchmarkRow(_BOT, "make_vec", 64),
    BenchmarkRow(_BOT, "make_vec", 1024),
    BenchmarkRow(_BOT, "sb3", 64),
    BenchmarkRow(_BOT, "make_vec", 64, arguments={"observation": "planner"}),
    BenchmarkRow(_BOT, "make_vec", 64, policy="ppo"),
    BenchmarkRow(_FLAT, "make", 1),
    BenchmarkRow(_FLAT, "make_vec", 64),
    BenchmarkRow(_FLAT, "sb3", 64),
    BenchmarkRow(_FLAT, "make_vec", 64, policy="ppo"),
    BenchmarkRow(_GENERATED, "make", 1),
    BenchmarkRow(_GENERATED, "make_vec", 64),
    BenchmarkRow(_GENERATED, "sb3", 64),
)


class BenchmarkPlayer:
    """Plays the environment of a row; ``game`` is this package's environment without wrappers."""

    def __init__(self, row: BenchmarkRow, map_source: str) -> None:
        spec = f"pacman_env/{row.env}"
        arguments: dict[str, Any] = {**row.arguments}
        if row.env != _GENERATED:
            arguments["map"] = map_source
        if row.made == "make":
            self.env: Any = gym.make(spec, **arguments)
        else:
            native: dict[str, Any] = {"num_envs": row.games, "vectorization_mode": "vector_entry_point"}
            mode: dict[str, Any] = {"autoreset_mode": AutoresetMode.SAME_STEP} if row.made == "sb3" else {}
            self.env = gym.make_vec(spec, **native, **mode, **arguments)
        self.game: Any = self.env.unwrapped
        self.row, self.rng, self._number = row, np.random.default_rng(0), 0
        self._held = 1 if "Flat" in row.env else HELD
        self._over = np.zeros(row.games, np.bool_)
        self._actions = np.zeros(row.games, np.int64)
        self._policy = None if row.policy == "random" else make_policy(row.policy)
        if row.made == "sb3":
            from pacman_env.sb3 import PacManBotVecEnv

            self.env = PacManBotVecEnv(self.game)
            self.env.seed(0)
            self.env.reset()
        else:
            self.env.reset(seed=0)
        if self._policy is not None:
            self._policy.reset(~self._over, self.game.config)

    def rates(self, seconds: float) -> Rates:
        """Play for about ``seconds`` of processor time and return the rates."""
        spent, decisions, simulated = 0.0, 0, 0.0
        waits = self.row.made == "make_vec"  # NEXT_STEP: the step after an end is a reset, not a decision
        while spent < seconds or decisions == 0:
            playing = ~self._over if waits else np.ones_like(self._over)
            if self._policy is None and self._number % self._held == 0:
                self._draw()
            began = time.process_time()
            if self._policy is not None:
                self._actions = self.game.action_of(self._policy.select(self.game.situation))
            elapsed, self._over = self._step()
            spent += time.process_time() - began
            if self._policy is not None and self._over.any():
                self._policy.reset(self._over, self.game.config)
            self._number += 1
            decisions += int(playing.sum())
            simulated += playing.sum() * self.game.config.execution.tick_s if elapsed is None else float(elapsed.sum())
        return decisions / spent, simulated / spent

    def _draw(self) -> None:
        masks = np.atleast_2d(self.game.action_masks())
        self._actions = (self.rng.random(masks.shape) * masks).argmax(axis=1)

    def _step(self) -> tuple[NDArray[np.float64] | None, NDArray[np.bool_]]:
        """Step; return the duration of each game's decision (s; None: a tick) and whether its episode ended."""
        if self.row.made == "sb3":
            _, _, over, rows = self.env.step(self._actions)
            return np.array([row["elapsed_s"] for row in rows]) if "elapsed_s" in rows[0] else None, over
        action = int(self._actions[0]) if self.row.made == "make" else self._actions
        _, _, terminated, truncated, info = self.env.step(action)
        over = np.atleast_1d(np.logical_or(terminated, truncated))
        if self.row.made == "make" and over[0]:
            self.env.reset()
        return np.atleast_1d(info["elapsed_s"]) if "elapsed_s" in info else None, over


def keep_houses() -> None:
    """Start a round in each house of the training set, so that all houses are in the cache."""
    env = BenchmarkPlayer(BenchmarkRow(_GENERATED, "make_vec", 64), "").env
    for first in range(0, HOUSES, 64):
        env.reset(options={"level": (first + np.arange(64)) % HOUSES})


def bare_rates(map_source: str) -> Callable[[float], Rates]:
    """Return a function that measures physics alone: 64 robots in one Chipmunk space, stepped from Python."""
    env: Any = BenchmarkPlayer(BenchmarkRow(_BOT, "make_vec", 64), map_source).game
    robot, config, substeps = env.config.robot, env.config, env.batch.substeps
    step = bare_stepper(
        env.batch.assets.grid.walls,
        env.batch.bodies[:, :2].copy(),
        radius_m=robot.radius_m,
        mass_kg=robot.mass_kg,
        step_s=config.physics_step_s,
        speed_mps=robot.speed_mps,
    )

    def rates(seconds: float) -> Rates:
        began, decisions = time.process_time(), 0
        while decisions == 0 or time.process_time() - began < seconds:
            step(HELD * substeps)
            decisions += 64 * HELD
        rate = decisions / (time.process_time() - began)
        return rate, rate * config.execution.tick_s

    return rates


def measured(rows: Sequence[BenchmarkRow], map_source: str, rounds: int, seconds: float) -> dict[str, Any]:
    """Return the medians, or the reason for skipping, by row; each row plays ``seconds`` in total."""
    if any(row.env == _GENERATED for row in rows) and HOUSES:
        keep_houses()
    figures: dict[str, Any] = {}
    players: dict[str, Callable[[float], Rates]] = {BARE: bare_rates(map_source)}
    for row in rows:
        try:
            players[row.name] = BenchmarkPlayer(row, map_source).rates
        except ModuleNotFoundError as error:
            if str(error.name).startswith("pacman_env"):
                raise
            figures[row.name] = {"skipped": f"{error.name} is not installed"}
    for rates in players.values():  # compiles kernels and fills the caches
        rates(min(seconds, 1.0))
    gc.collect()
    turns = np.array([[rates(seconds / rounds) for rates in players.values()] for _ in range(rounds)])
    of_bare = np.median(turns[:, :, 1] / turns[:, :1, 1], axis=0)
    for k, name in enumerate(players):
        decisions, simulated = np.median(turns[:, k], axis=0).tolist()
        low, high = turns[:, k, 0].min(), turns[:, k, 0].max()
        rate = {"decisions_per_s": decisions, "range": [float(low), float(high)], "simulated_s_per_s": simulated}
        figures[name] = {**rate, "of_bare": float(of_bare[k])}
    return {name: figures[name] for name in (BARE, *(row.name for row in rows))}


def _child(*command: str, **variables: str) -> tuple[float, float]:
    """Run Python on this package and return its wall and processor seconds; raises ValueError if it fails."""
    environment = {**os.environ, "PYTHONPATH": str(Path(pacman_env.__file__).parents[1]), **variables}
    start = os.times()
    done = subprocess.run([sys.executable, *command], env=environment, capture_output=True, text=True)
    if done.returncode != 0:
        raise ValueError(f"{command}: {done.stderr.strip()}")
    end = os.times()
    cpu_s = end.children_user + end.children_system - start.children_user - start.children_system
    return end.elapsed - start.elapsed, cpu_s


def first_start(map_source: str) -> dict[str, Any]:
    """Measure processes that create, reset and step each id, with an empty cache and with the cache that results."""
    figures = {}
    for env in (_BOT, _FLAT):
        code = f"import gymnasium, pacman_env; env = gymnasium.make('pacman_env/{env}', map={map_source!r})"
        code += "; env.reset(seed=0); env.step(0)"
        with tempfile.TemporaryDirectory() as cache:
            for when in ("empty cache", "warm"):
                wall_s, cpu_s = _child("-c", code, PACMAN_ENV_CACHE=cache)
                figures[f"start to first step, {env}, {when}"] = {"wall_s": wall_s, "cpu_s": cpu_s}
    return figures


def training() -> dict[str, Any]:
    """Measure a shortened ``train --quick``: seconds of the command, and PPO's decisions per second of wall time."""
    with tempfile.TemporaryDirectory() as folder:
        code = "import sys; from pacman_env.training.train import main; sys.exit(main(sys.argv[1:]))"
        options = ["--quick", "--imitation", "8192", "--decisions", str(TRAINED), "--segment", str(TRAINED)]
        wall_s, cpu_s = _child("-c", code, *options, "--evaluation", "16", "--out", f"{folder}/run")
        (segment,) = json.loads(Path(folder, "run", "run.json").read_text())["segments"]
    row = {"wall_s": wall_s, "cpu_s": cpu_s, "decisions_per_s": segment["decisions_per_s"]}
    return {f"train --quick --decisions {TRAINED}": row}


def machine() -> dict[str, Any]:
    """Return the properties of the machine and the versions on which the figures depend."""
    cpus = Path("/proc/cpuinfo")
    names = re.findall(r"model name\s*: (.+)", cpus.read_text()) if cpus.exists() else []
    processor = names[0] if names else platform.processor() or platform.machine()
    versions = {"version": pacman_env.__version__, "python": platform.python_version()}
    return {**versions, "processor": processor, "cores": os.cpu_count(), "date": date.today().isoformat()}


def main(argv: Sequence[str] | None = None) -> int:
    given = sys.argv[1:] if argv is None else argv
    return run_command(make_parser(), argv, lambda arguments: _report(arguments, " ".join(given)))


def make_parser() -> Parser:
    parser = Parser(prog="pacman-env benchmark", description=__doc__)
    parser.add_argument("--map", default="house", help="name or YAML file of the fixed map (%(default)s)")
    parser.add_argument("--rounds", type=count(), default=ROUNDS, help="measurements of each row (%(default)s)")
    seconds = finite_number(0, 3600)
    parser.add_argument("--seconds", type=seconds, default=6.0, help="processor time per row (%(default)s)")
    parser.add_argument("--only", default="", metavar="TEXT", help="measure only rows whose name contains TEXT")
    parser.add_argument("--first-start", action="store_true", help="also measure starts with an empty cache (2 min)")
    parser.add_argument("--training", action="store_true", help="also measure a short training (needs the extra train)")
    parser.add_argument("--json", type=Path, help="write the results to this file")
    return parser


def _report(arguments: argparse.Namespace, given: str) -> None:
    if arguments.json:
        prepare(arguments.json)
    rows = [row for row in ROWS if arguments.only in row.name]
    figures = {**machine(), "map": arguments.map, "command": f"pacman-env benchmark {given}".strip()}
    figures["rows"] = measured(rows, arguments.map, arguments.rounds, arguments.seconds)
    if arguments.first_start:
        figures["rows"] |= first_start(arguments.map)
    if arguments.training:
        figures["rows"] |= training()
    print(*table(figures), sep="\n")
    if arguments.json:
        write_json(arguments.json, figures)


def table(figures: dict[str, Any]) -> list[str]:
    """Return the lines of a Markdown table of all rows, below a line about machine, versions and command."""
    about = "pacman_env {version}, Python {python}, {cores} x {processor}, {date}, map {map}: `{command}`"
    lines = [about.format(**figures), "", "| What | decisions/s | simulated s/s | of bare | wall s | CPU s |"]
    lines.append("|---|---|---|---|---|---|")
    shown = {"decisions_per_s": ",.0f", "simulated_s_per_s": ",.0f", "of_bare": ".3f", "wall_s": ".1f", "cpu_s": ".1f"}
    for name, row in figures["rows"].items():
        cells = [format(row[key], form) if key in row else "" for key, form in shown.items()]
        lines.append(f"| {name} | " + " | ".join([row["skipped"], *cells[1:]] if "skipped" in row else cells) + " |")
    return lines


if __name__ == "__main__":
    sys.exit(main())
