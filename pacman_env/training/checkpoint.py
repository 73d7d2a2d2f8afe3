"""Trained planners as Stable-Baselines3 saves them: the zip, the facts beside it, and both as a policy.

Such a zip holds pickled objects too, which would run any code when they are loaded: nothing here loads them, tensors
and plain JSON are enough. What a planner becomes without torch is in ``export``.
"""

from __future__ import annotations

import io
import json
import zipfile
from pathlib import Path
from typing import Any

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray

from pacman_env.config import make_config
from pacman_env.config.validation import Number
from pacman_env.files import replaced
from pacman_env.policies.base import BasePolicy
from pacman_env.policies.metadata import Training, dump, parse
from pacman_env.sim.observation.planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES, planner_features
from pacman_env.sim.observation.situation import Situation
from pacman_env.training.network import FORBIDDEN, EntityNetwork


class Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Facts about a planner that only its training knows."""

    robot_speed_mps: Number  # with which its features were built
    training: Training
    metrics: dict[str, Number]


def facts_path(checkpoint: Path) -> Path:
    """``runs/ppo.facts.json`` for ``runs/ppo.zip``."""
    return checkpoint.with_suffix(".facts.json")


def write_facts(path: Path, facts: Facts) -> None:
    """Write them, whole or not at all.

    Raises:
        ValueError: a field of another type, found before anything is written.
    """
    text = dump(facts, path)
    with replaced(path) as temporary:
        temporary.write_text(text)


def read_facts(path: Path) -> Facts:
    """Read what ``write_facts`` wrote.

    Raises:
        ValueError: there is no such file, or something else in it.
    """
    try:
        text = path.read_bytes()
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from None
    return parse(Facts, text, path)


def read_tensors(path: Path, name: str) -> dict[str, Any]:
    """One part of a checkpoint, ``policy`` or ``policy.optimizer``; nothing but tensors and numbers is read."""
    with zipfile.ZipFile(path) as archive:
        content: dict[str, Any] = torch.load(
            io.BytesIO(archive.read(f"{name}.pth")), weights_only=True, map_location="cpu"
        )
    return content


def load_network(path: Path) -> EntityNetwork:
    """The network of a MaskablePPO zip, trained with :class:`.policy.EntityPolicy`; no code in the file is run.

    Raises:
        ValueError: no such file, or no planner for this version's features.
    """
    if not path.is_file():
        raise ValueError(f"{path}: no such file")
    try:
        state = {name.removeprefix("network."): tensor for name, tensor in read_tensors(path, "policy").items()}
        with zipfile.ZipFile(path) as archive:
            sizes = json.loads(archive.read("data"))["policy_kwargs"]
        width, inputs = state["encode_candidate.weight"].shape
        own = len(state["shown"])
        network = EntityNetwork(own, inputs - own, width, dropped_kinds=sizes.get("dropped_kinds", ()))
        network.load_state_dict(state)
    except Exception as error:  # whatever a file may hold that is no checkpoint
        raise ValueError(f"{path}: no planner that can be loaded: {error}") from None
    check_sizes(network, path)
    return network.eval()


def check_sizes(network: EntityNetwork, path: Path) -> None:
    """Refuse a network for other features.

    Raises:
        ValueError: it reads another number of them.
    """
    own = network.candidate_features
    found, expected = (own, network.encode_candidate.in_features - own), (len(CANDIDATE_FEATURES), len(GLOBAL_FEATURES))
    if found != expected:
        raise ValueError(f"{path}: reads {found} candidate and global features, this version has {expected}")


class TorchPlanner(BasePolicy):
    """A network as a policy, run by torch; what is deployed is its export.

    Args:
        name: as results show it.
        network: on the CPU.
        robot_speed_mps: with which the features are built.
    """

    def __init__(self, name: str, network: EntityNetwork, robot_speed_mps: float) -> None:
        self.name, self.network, self.robot_speed_mps = name, network, robot_speed_mps

    def scores(self, situation: Situation) -> NDArray[np.float64]:
        """(N, C) logits, -inf for what may not be chosen.

        Raises:
            ValueError: the situation has no maps.
        """
        candidates, whole = planner_features(situation, self.robot_speed_mps)
        with torch.no_grad():
            logits, _ = self.network.packed(*(torch.tensor(a) for a in (candidates, whole, situation.mask)))
        found = logits.numpy().astype(np.float64)
        return np.where(found > FORBIDDEN / 10, found, -np.inf)


def load_planner(path: Path) -> TorchPlanner:
    """The policy of a checkpoint, with the robot's speed of its facts or, without them, the measured one.

    Raises:
        ValueError: no such file, or no planner for this version's features.
    """
    network = load_network(path)
    facts = facts_path(path)
    speed = read_facts(facts).robot_speed_mps if facts.exists() else make_config("robot").robot.speed_mps
    return TorchPlanner(path.stem, network, speed)
