"""One training run: segments of PPO with a checkpoint after each, and its record.

A segment begins with new games and with random numbers of its own, drawn from the run's seed and the segment's
number. So an interrupted run continues from its last checkpoint with the same curve, bit for bit.
"""

from __future__ import annotations

import dataclasses
import json
import sys
from pathlib import Path
from typing import Any

from tqdm import tqdm

from pacman_env import __version__
from pacman_env.files import write_json
from pacman_env.policies.metadata import Training
from pacman_env.training.arguments import Arguments
from pacman_env.training.checkpoint import Facts, facts_path, save_checkpoint, write_facts
from pacman_env.training.games import VALIDATION_LEVEL, game_config
from pacman_env.training.learner import Learner


class Run:
    """A run in a folder: ``run.json``, ``last.zip``, ``best.zip`` and TensorBoard's files."""

    def __init__(self, arguments: Arguments) -> None:
        """Make the folder, or with ``resume`` read it; raises ValueError if the folder does not fit."""
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
        """The file of the state after a segment, until the next one is written."""
        return self.folder / f"segment-{segment}.zip"

    def write(self, model: Learner, result: dict[str, Any]) -> None:
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

    def _save(self, model: Learner, path: Path) -> None:
        save_checkpoint(path, model.network, model.optimizer)
        last = self.segments[-1]
        numbers = {name: float(value) for name, value in last.items() if isinstance(value, (int, float))}
        write_facts(facts_path(path), facts_of(self.arguments, model.decisions, numbers))


def _plain(arguments: Arguments) -> dict[str, Any]:
    """The arguments that decide the curve, as JSON has them."""
    plain = json.loads(json.dumps(dataclasses.asdict(arguments), default=str))
    for name in ("out", "resume", "progress", "threads"):
        del plain[name]
    return dict(plain)


def check_same(record: Path, before: Any, ours: dict[str, Any]) -> None:
    """Raise ValueError with the first field, nested ones included, that differs from ``ours``."""
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


def progress_bar(decisions: int, shown: bool, done: int = 0) -> tqdm[Any]:
    """A bar over all decisions of a training, on stderr."""
    kind: dict[str, Any] = {"unit": "decision", "unit_scale": True, "mininterval": 1.0, "file": sys.stderr}
    return tqdm(total=decisions, initial=done, disable=not shown, **kind)
