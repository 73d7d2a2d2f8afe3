"""Networks and planner files that the tests share: random from a seed, no training."""

from pathlib import Path
from typing import Any

import torch

from pacman_env.observations.planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES
from pacman_env.policies.metadata import Training
from pacman_env.training.checkpoint import Facts
from pacman_env.training.export import export_planner
from pacman_env.training.network import EntityNetwork

FACTS = Facts(
    robot_speed_mps=0.25,
    training=Training((0.2, 0.5), (0.22, 0.31), "generated:train", "robot", "robust", 1000, 7),
    metrics={"completion": 0.5},
)


def random_network(seed: int = 0, **arguments: Any) -> EntityNetwork:
    """A network whose logits and values differ as those of a trained one do."""
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        network = EntityNetwork(len(CANDIDATE_FEATURES), len(GLOBAL_FEATURES), **arguments)
        with torch.no_grad():
            network.judge.weight.mul_(100.0)
            for name, parameter in network.named_parameters():
                if name.endswith("bias"):
                    parameter.normal_(0.0, 0.1)
    return network


def random_planner(folder: Path, name: str = "mine", seed: int = 0, **arguments: Any) -> Path:
    """The ONNX file of a random network, with its metadata, in ``folder``."""
    path = folder / f"{name}.onnx"
    export_planner(random_network(seed, **arguments), path, FACTS)
    return path
