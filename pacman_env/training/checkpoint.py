"""Checkpoints of planners: the zip of the network, its file of facts, both loaded as a policy, and a run's folder.

A checkpoint has the layout of Stable-Baselines3's zips, which earlier versions wrote. Those zips also contain pickled
objects, which could run any code. Therefore only tensors and plain JSON are read.
"""

import dataclasses
import hashlib
import io
import json
import zipfile
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray

from .. import __version__
from ..config import make_config
from ..config.validation import Number, located
from ..files import replaced, write_json, write_text
from ..observations.planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES, planner_features
from ..observations.situation import Situation
from ..policies.base import BasePolicy
from ..policies.metadata import Training, dump, read
from .arguments import Arguments
from .games import VALIDATION_LEVEL, game_config
from .network import FORBIDDEN, EntityNetwork

_PREFIX = "network."  # prefix of the weights' names
_NEEDED = ("decisions", "against_league", "again")  # fields of segment records that are needed to resume


class Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Facts about a planner that only the training knows, and that the weights do not contain."""

    robot_speed_mps: Number  # speed with which the features were built
    training: Training
    metrics: dict[str, Number]


def facts_of(arguments: Arguments, decisions: int, metrics: dict[str, float]) -> Facts:
    """Return the facts of a network after ``decisions`` decisions; ``metrics`` by name."""
    training = Training(
        clyde_speeds_mps=arguments.hyper.clyde_speed,
        robot_speeds_mps=arguments.hyper.robot_speed,
        levels=f"generated:train below {VALIDATION_LEVEL}",
        preset=arguments.preset,
        execution=arguments.execution,
        decisions=decisions,
        seed=arguments.seed,
        ghosts=arguments.hyper.ghosts,
    )
    return Facts(game_config(arguments).robot.speed_mps, training, metrics)


def facts_path(checkpoint: Path) -> Path:
    """Return the path of a checkpoint's facts: ``runs/ppo.facts.json`` for ``runs/ppo.zip``."""
    return checkpoint.with_suffix(".facts.json")


def write_facts(path: Path, facts: Facts) -> None:
    write_text(path, dump(facts, path))


def read_facts(path: Path) -> Facts:
    return read(Facts, path)


def save_checkpoint(path: Path, network: EntityNetwork, optimizer: torch.optim.Optimizer) -> None:
    weights = {_PREFIX + name: tensor for name, tensor in network.state_dict().items()}
    sizes = {"width": network.width, "dropped_kinds": network.dropped_kinds}
    with replaced(path) as temporary, zipfile.ZipFile(temporary, "w") as archive:
        archive.writestr("data", json.dumps({"policy_kwargs": sizes}))
        for name, content in (("policy", weights), ("policy.optimizer", optimizer.state_dict())):
            with archive.open(f"{name}.pth", "w") as file:
                torch.save(content, file)


def _tensors(path: Path, name: str) -> dict[str, Any]:
    """Read one part of a checkpoint, ``policy`` or ``policy.optimizer``: only tensors and numbers are read."""
    with zipfile.ZipFile(path) as archive:
        content = torch.load(io.BytesIO(archive.read(f"{name}.pth")), weights_only=True, map_location="cpu")
    return {key.removeprefix(_PREFIX): value for key, value in content.items()}


def restore(path: Path, network: EntityNetwork, optimizer: torch.optim.Optimizer) -> None:
    """Read network and optimizer from a checkpoint; raises ValueError if it is damaged or does not fit the network."""
    with located(f"{path}: cannot be restored", ValueError, Exception):  # a damaged or foreign file may fail anywhere
        weights, state = _tensors(path, "policy"), _tensors(path, "policy.optimizer")
        network.load_state_dict(weights)
        optimizer.load_state_dict(state)


def load_network(path: Path) -> EntityNetwork:
    """Return the network of a checkpoint; raises ValueError unless it fits this version's features."""
    if not path.is_file():
        raise ValueError(f"{path}: no such file")
    text = f"{path}: no checkpoint of 'pacman-env train' (a model of Stable-Baselines3 would unpickle; export it with "
    text += "pacman_env.sb3.export)"
    with located(text, ValueError, Exception):  # a damaged or foreign file may fail anywhere
        state = _tensors(path, "policy")
        with zipfile.ZipFile(path) as archive:
            sizes = json.loads(archive.read("data"))["policy_kwargs"]
        width, inputs = state["encode_candidate.weight"].shape
        own = len(state["shown"])
        network = EntityNetwork(own, inputs - own, width, dropped_kinds=sizes.get("dropped_kinds", ()))
        network.load_state_dict(state)
    check_sizes(network, path)
    return network.eval()


def check_sizes(network: EntityNetwork, path: Path) -> None:
    own = network.candidate_features
    sizes, expected = (own, network.encode_candidate.in_features - own), (len(CANDIDATE_FEATURES), len(GLOBAL_FEATURES))
    if sizes != expected:
        raise ValueError(f"{path}: reads {sizes} candidate and global features, this version has {expected}")


class TorchPlanner(BasePolicy):
    """A network on the CPU as a policy, for training; deployed planners are exports."""

    def __init__(self, name: str, network: EntityNetwork, robot_speed_mps: float) -> None:
        self.name, self.network, self.robot_speed_mps = name, network, robot_speed_mps

    def scores(self, situation: Situation) -> NDArray[np.float64]:
        """Return the logits (N, C) of the candidates in N situations, -inf for forbidden candidates."""
        candidates, whole = planner_features(situation, self.robot_speed_mps)
        with torch.inference_mode():
            logits, _ = self.network(*map(torch.tensor, (candidates, whole, situation.mask)))
        scores = logits.numpy().astype(np.float64)
        return np.where(scores > FORBIDDEN / 10, scores, -np.inf)


def load_planner(path: Path) -> TorchPlanner:
    """Return the policy of a checkpoint, for the robot's speed in its facts (without facts: the measured speed)."""
    network = load_network(path)
    facts = facts_path(path)
    speed = read_facts(facts).robot_speed_mps if facts.exists() else make_config("robot").robot.speed_mps
    return TorchPlanner(path.stem, network, speed)


class Run:
    """Folder of a run: ``run.json``, ``last.zip``, ``best.zip`` and TensorBoard's files."""

    def __init__(self, arguments: Arguments) -> None:
        self.arguments, self.folder = arguments, arguments.out
        self._written = _plain(arguments)  # read once: the planner to start from may disappear later
        self.segments: list[dict[str, Any]] = []
        self.record = self.folder / "run.json"
        self.best, self.last = self.folder / "best.zip", self.folder / "last.zip"
        if arguments.resume:
            self._read()
        elif self.record.exists():
            raise ValueError(f"{self.folder}: there is a run already; give --resume or another --out")
        self.folder.mkdir(parents=True, exist_ok=True)

    def _read(self) -> None:
        with located(f"{self.record}: no run to resume", ValueError, (OSError, ValueError, KeyError, TypeError)):
            content = json.loads(self.record.read_text())
            theirs = {**content["arguments"]["hyper"], **content["arguments"]}
            self.segments = list(content["segments"])
            for number, segment in enumerate(self.segments):
                if segment["segment"] != number:
                    raise ValueError("its segments are not in order")
                float(segment["completed"])
                if missing := [name for name in _NEEDED if name not in segment]:
                    raise ValueError(f"segment {number} of another version, without {missing[0]!r}")
        ours = dict(self._written)
        for name, value in {**ours.pop("hyper"), **ours}.items():
            if name not in theirs:
                raise ValueError(f"{self.record}: no run to resume: of another version, without {name!r}")
            if theirs[name] != value:
                raise ValueError(f"{self.record}: was started with {name} = {theirs[name]}, not {value}")

    def against_league(self) -> dict[str, tuple[int, int]]:
        """Return the league's record in the last segment."""
        return self.segments[-1]["against_league"] if self.segments else {}

    def checkpoint(self, segment: int) -> Path:
        """Return the file of the state after a segment; it is deleted when the next one is written."""
        return self.folder / f"segment-{segment}.zip"

    def write(self, network: EntityNetwork, optimizer: torch.optim.Optimizer, result: dict[str, Any]) -> None:
        """Write the checkpoints of a segment and then its record ``result``."""
        segment = result["segment"]
        best = max((old["completed"] for old in self.segments), default=-1.0)
        self.segments.append(result)
        numbers = {name: float(value) for name, value in result.items() if isinstance(value, (int, float))}
        if not self.arguments.evaluation:
            del numbers["completed"]  # 0 of no rounds
        facts = facts_of(self.arguments, result["decisions"], numbers)
        for path in (self.checkpoint(segment), self.last, *([self.best] if result["completed"] >= best else [])):
            save_checkpoint(path, network, optimizer)
            write_facts(facts_path(path), facts)
        content = {"version": __version__, "arguments": self._written, "segments": self.segments}
        write_json(self.record, content)
        for path in (self.checkpoint(segment - 1), facts_path(self.checkpoint(segment - 1))):
            path.unlink(missing_ok=True)


def _plain(arguments: Arguments) -> dict[str, Any]:
    """Return the arguments that decide the curve, as plain JSON data; ``start`` is the hash of its file."""
    plain: dict[str, Any] = json.loads(json.dumps(dataclasses.asdict(arguments), default=str))
    for name in ("out", "resume", "progress", "threads"):
        del plain[name]
    if arguments.start is not None:
        plain["start"] = hashlib.sha256(arguments.start.read_bytes()).hexdigest()
    return plain
