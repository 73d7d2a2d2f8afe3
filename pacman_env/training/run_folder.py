"""Folder of a run: the record of its segments, and its checkpoints."""

import dataclasses
import json
from pathlib import Path
from typing import Any

from pacman_env import __version__
from pacman_env.config.validation import located
from pacman_env.files import write_json
from pacman_env.training import checkpoint
from pacman_env.training.league import League, Record
from pacman_env.training.ppo import PPO
from pacman_env.training.run_arguments import Arguments
from pacman_env.training.training_games import facts_of

_NEEDED = ("decisions", "against_league", "again")  # fields of segment records that are needed to resume


class Run:
    """Folder of a run: ``run.json``, ``last.zip``, ``best.zip`` and TensorBoard's files."""

    def __init__(self, arguments: Arguments) -> None:
        self.arguments = arguments
        self.folder = arguments.out
        self.segments: list[dict[str, Any]] = []
        self.record = self.folder / "run.json"
        self.league = League(arguments, self.folder)
        self.best, self.last = self.folder / "best.zip", self.folder / "last.zip"
        if arguments.resume:
            self._read()
        elif self.record.exists():
            raise ValueError(f"{self.folder}: there is a run already; give --resume or another --out")
        self.folder.mkdir(parents=True, exist_ok=True)

    def _read(self) -> None:
        with located(f"{self.record}: no run to resume", ValueError, (OSError, ValueError, KeyError, TypeError)):
            content = json.loads(self.record.read_text())
            arguments = content["arguments"]
            self.segments = list(content["segments"])
            numbers = [(segment["segment"], float(segment["completed"])) for segment in self.segments]
            if [number for number, _ in numbers] != list(range(len(numbers))):
                raise ValueError("its segments are not in order")
            for segment in self.segments:
                if missing := [name for name in _NEEDED if name not in segment]:
                    raise ValueError(f"segment {segment['segment']} of another version, without {missing[0]!r}")
        check_same(self.record, arguments, plain(self.arguments))

    def against_league(self) -> Record:
        """Return the league's record in the last segment."""
        return self.segments[-1]["against_league"] if self.segments else {}

    def checkpoint(self, segment: int) -> Path:
        """Return the file of the state after a segment; it is deleted when the next one is written."""
        return self.folder / f"segment-{segment}.zip"

    def write(self, model: PPO, result: dict[str, Any]) -> None:
        segment = result["segment"]
        best = max((old["completed"] for old in self.segments), default=-1.0)
        self.segments.append(result)
        self._save(model, self.checkpoint(segment))
        self._save(model, self.last)
        if result["completed"] >= best:
            self._save(model, self.best)
        content = {"version": __version__, "arguments": plain(self.arguments), "segments": self.segments}
        write_json(self.record, content)
        self.checkpoint(segment - 1).unlink(missing_ok=True)
        checkpoint.facts_path(self.checkpoint(segment - 1)).unlink(missing_ok=True)

    def _save(self, model: PPO, path: Path) -> None:
        checkpoint.save_checkpoint(path, model.network, model.optimizer)
        last = self.segments[-1]
        numbers = {name: float(value) for name, value in last.items() if isinstance(value, (int, float))}
        checkpoint.write_facts(checkpoint.facts_path(path), facts_of(self.arguments, model.decisions, numbers))


def plain(arguments: Arguments) -> dict[str, Any]:
    """Return the arguments that decide the curve, as plain JSON data."""
    plain = json.loads(json.dumps(dataclasses.asdict(arguments), default=str))
    for name in ("out", "resume", "progress", "threads"):
        del plain[name]
    return dict(plain)


def check_same(record: Path, theirs: Any, ours: dict[str, Any]) -> None:
    """Raise ValueError with the first field, nested fields included, that differs from ``ours``."""
    for name, value in ours.items():
        other = theirs.get(name) if isinstance(theirs, dict) else None
        if isinstance(value, dict):
            check_same(record, other, value)
        elif other != value:
            raise ValueError(f"{record}: was started with {name} = {other}, not {value}")
