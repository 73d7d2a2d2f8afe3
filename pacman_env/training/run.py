"""One training run: segments of PPO with a checkpoint after each, and its record.

A segment begins with new games and with random numbers of its own, drawn from the run's seed and the segment's
number. So an interrupted run continues from its last checkpoint with the same curve, bit for bit. Only tensors and JSON
of a checkpoint are read; nothing is unpickled.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
from sb3_contrib import MaskablePPO
from stable_baselines3.common.callbacks import BaseCallback
from tqdm import tqdm

from pacman_env import __version__
from pacman_env.files import replaced, write_json
from pacman_env.policies.metadata import Training
from pacman_env.training.arguments import Arguments, Hyperparameters
from pacman_env.training.checkpoint import Facts, facts_path, read_tensors, write_facts
from pacman_env.training.games import VALIDATION_LEVEL, game_config


class Run:
    """A run in a folder: ``run.json``, ``last.zip``, ``best.zip`` and TensorBoard's files."""

    def __init__(self, arguments: Arguments) -> None:
        """Make the folder, or with ``resume`` read what is there.

        Raises:
            ValueError: there is a run already, or none to go on with, or it was started with other arguments.
        """
        self.arguments = arguments
        self.folder = arguments.out
        self.segments: list[dict[str, Any]] = []
        self.record = self.folder / "run.json"
        self.best, self.last = self.folder / "best.zip", self.folder / "last.zip"
        if arguments.resume:
            self._read()
        elif self.record.exists():
            raise ValueError(f"{self.folder}: there is a run already; give --resume or another --out")
        self.folder.mkdir(parents=True, exist_ok=True)

    def _read(self) -> None:
        try:
            known = json.loads(self.record.read_text())
            before = known["arguments"]
            self.segments = list(known["segments"])
            numbers = [(segment["segment"], float(segment["completed"])) for segment in self.segments]
            if [number for number, _ in numbers] != list(range(len(numbers))):
                raise ValueError("its segments are not in order")
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ValueError(f"{self.record}: no run to go on with: {error}") from None
        check_same(self.record, before, _plain(self.arguments))

    def checkpoint(self, segment: int) -> Path:
        """Of the state after a segment, until the next one is written."""
        return self.folder / f"segment-{segment}.zip"

    def write(self, model: MaskablePPO, result: dict[str, Any]) -> None:
        """A finished segment: its checkpoint first, then the record that names it."""
        segment = result["segment"]
        before = max((old["completed"] for old in self.segments), default=-1.0)
        self.segments.append(result)
        self._save(model, self.checkpoint(segment))
        self._save(model, self.last)
        if result["completed"] >= before:
            self._save(model, self.best)
        content = {"version": __version__, "arguments": _plain(self.arguments), "segments": self.segments}
        write_json(self.record, content)
        self.checkpoint(segment - 1).unlink(missing_ok=True)
        facts_path(self.checkpoint(segment - 1)).unlink(missing_ok=True)

    def _save(self, model: MaskablePPO, path: Path) -> None:
        with replaced(path) as temporary, temporary.open("wb") as file:
            model.save(file)
        last = self.segments[-1]
        numbers = {name: float(value) for name, value in last.items() if isinstance(value, (int, float))}
        write_facts(facts_path(path), facts_of(self.arguments, int(model.num_timesteps), numbers))


def _plain(arguments: Arguments) -> dict[str, Any]:
    """The arguments that decide the curve, as JSON has them."""
    plain = json.loads(json.dumps(dataclasses.asdict(arguments), default=str))
    for name in ("out", "resume", "progress", "threads"):
        del plain[name]
    return dict(plain)


def check_same(record: Path, before: Any, ours: dict[str, Any]) -> None:
    """Refuse to go on with what was started with other values, nested ones included.

    Raises:
        ValueError: names the first field that differs.
    """
    for name, value in ours.items():
        known = before.get(name) if isinstance(before, dict) else None
        if isinstance(value, dict):
            check_same(record, known, value)
        elif known != value:
            raise ValueError(f"{record}: was started with {name} = {known}, not {value}")


def facts_of(arguments: Arguments, decisions: int, metrics: dict[str, float]) -> Facts:
    """The facts about a network after so many decisions of a training."""
    training = Training(
        clyde_speeds_mps=arguments.hyper.clyde_speed,
        robot_speeds_mps=arguments.hyper.robot_speed,
        levels=f"generated:train below {VALIDATION_LEVEL}",
        preset=arguments.preset,
        execution=arguments.execution,
        decisions=decisions,
        seed=arguments.seed,
    )
    return Facts(game_config(arguments).robot.speed_mps, training, metrics)


def restore(model: MaskablePPO, path: Path) -> None:
    """Network and optimizer from a checkpoint, as tensors alone.

    Raises:
        ValueError: the file cannot be read, or holds another network.
    """
    try:
        weights, optimizer = read_tensors(path, "policy"), read_tensors(path, "policy.optimizer")
        model.policy.load_state_dict(weights)
        model.policy.optimizer.load_state_dict(optimizer)
    except Exception as error:  # a torn or foreign file may fail anywhere
        raise ValueError(f"{path}: cannot be restored: {error}") from None


def progress_bar(decisions: int, shown: bool, done: int = 0) -> tqdm[Any]:
    """A bar over all decisions of a training, on stderr."""
    kind: dict[str, Any] = {"unit": "decision", "unit_scale": True, "mininterval": 1.0, "file": sys.stderr}
    return tqdm(total=decisions, initial=done, disable=not shown, **kind)


class LearningRate:
    """By the decisions taken so far; Stable-Baselines3's own progress begins anew with each segment."""

    def __init__(self, pair: tuple[float, float]) -> None:
        self.pair, self.progress = pair, 0.0

    def __call__(self, _: float) -> float:
        return _between(self.pair, self.progress)


class TrainingCallback(BaseCallback):
    """Schedules over the whole run, shares of endings for the log, the progress bar."""

    def __init__(self, hyper: Hyperparameters, rate: LearningRate, bar: Any) -> None:
        super().__init__()
        self._hyper, self._rate, self._bar = hyper, rate, bar
        self._ended: list[tuple[bool, bool]] = []

    def _on_step(self) -> bool:
        for i in np.flatnonzero(self.locals["dones"]):
            outcome = self.locals["infos"][i]["outcome"]
            self._ended.append((outcome == "complete", outcome == "timeout"))
        self._bar.update(len(self.locals["dones"]))
        return True

    def _on_rollout_end(self) -> None:
        hyper = self._hyper
        progress = hyper.progress(self.num_timesteps)
        self._rate.progress = progress
        self.model.ent_coef = _between(hyper.ent_coef, progress)  # type: ignore[attr-defined]
        if self._ended:
            complete, timeout = np.mean(self._ended, axis=0)
            self.logger.record("rollout/completed", float(complete))
            self.logger.record("rollout/timed_out", float(timeout))
            self._bar.set_postfix(completed=f"{complete:.1%}", timeout=f"{timeout:.1%}", refresh=False)
            del self._ended[: max(len(self._ended) - 1000, 0)]


def _between(pair: tuple[float, float], progress: float) -> float:
    return pair[0] + (pair[1] - pair[0]) * progress
