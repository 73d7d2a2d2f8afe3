"""Trained planners as Stable-Baselines3 saves them: the zip, the facts beside it, and both as a policy.

Loading such a zip executes code from it: nothing here does so unless it is told that the file is trusted. What a
planner becomes without torch is in :mod:`train.export`.
"""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import torch
from numpy.typing import NDArray

from eval.files import replaced
from pacman_env.config import make_config
from pacman_env.config.validation import Number
from pacman_env.policies.base import BasePolicy
from pacman_env.policies.metadata import Training, dump, parse
from pacman_env.sim.observation.planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES, planner_features
from pacman_env.sim.observation.situation import Situation
from train.network import FORBIDDEN, EntityNetwork


class Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What only the training knows about its planner."""

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
    """What ``write_facts`` wrote.

    Raises:
        ValueError: there is no such file, or something else in it.
    """
    try:
        text = path.read_bytes()
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from None
    return parse(Facts, text, path)


def load_network(path: Path, trust: bool) -> EntityNetwork:
    """The network of a MaskablePPO zip, trained with ``train.policy.EntityPolicy``.

    Raises:
        ValueError: not trusted, no such file, or no planner for this version's features.
    """
    if not trust:
        raise ValueError(f"{path}: loading a Stable-Baselines3 file executes code from it: say that you trust it")
    if not path.is_file():
        raise ValueError(f"{path}: no such file")
    from sb3_contrib import MaskablePPO

    from train.policy import EntityPolicy

    try:
        model = MaskablePPO.load(path, device="cpu", custom_objects={"policy_class": EntityPolicy})
    except Exception as error:  # anything may go wrong while it unpickles
        raise ValueError(f"{path}: no MaskablePPO that can be loaded: {error}") from error
    network = getattr(model.policy, "network", None)
    if not isinstance(network, EntityNetwork):
        raise ValueError(f"{path}: holds {type(network).__name__}, not an EntityNetwork")
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
            logits, _ = self.network(*(torch.tensor(a) for a in (candidates, whole, situation.mask)))
        found = logits.numpy().astype(np.float64)
        return np.where(found > FORBIDDEN / 10, found, -np.inf)


def load_planner(path: Path, trust: bool) -> TorchPlanner:
    """The policy of a checkpoint, with the robot's speed of its facts or, without them, the measured one.

    Raises:
        ValueError: not trusted, no such file, or no planner for this version's features.
    """
    network = load_network(path, trust)
    facts = facts_path(path)
    speed = read_facts(facts).robot_speed_mps if facts.exists() else make_config("robot").robot.speed_mps
    return TorchPlanner(path.stem, network, speed)
