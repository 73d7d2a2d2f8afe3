"""Networks and planner files that the tests share: random from a seed, no training."""

from pathlib import Path
from typing import Any

import torch

from pacman_env.observations.planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES
from pacman_env.policies.metadata import Training
from pacman_env.training.checkpoint import Facts
from pacman_env.training.export import export_planner
from pacman_env.training.network import FORBIDDEN, EntityNetwork

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


def plain(
    network: EntityNetwork, candidates: torch.Tensor, whole: torch.Tensor, mask: torch.Tensor
) -> tuple[torch.Tensor, torch.Tensor]:
    """The network's definition written plainly, nothing arranged for speed."""
    for kind in network.dropped_kinds:
        mask = mask & (candidates[:, :, kind] < 0.5)
    each = whole[:, None].expand(-1, candidates.shape[1], -1)
    encoded = network.encode_candidate(torch.cat([candidates * network.shown, each], dim=2)).relu()
    encoded = network.encode(encoded).relu()
    allowed = encoded * mask[:, :, None]
    mean = allowed.sum(dim=1) / mask.sum(dim=1, keepdim=True).clamp(min=1)
    pooled = torch.cat([mean, allowed.amax(dim=1)], dim=1)  # encodings are at least 0
    each = pooled[:, None].expand(-1, candidates.shape[1], -1)
    logits = network.judge(network.judge_candidate(torch.cat([encoded, each], dim=2)).relu())[:, :, 0]
    values = network.critic(torch.cat([pooled, whole], dim=1))[:, 0]
    return torch.where(mask, logits, torch.full_like(logits, FORBIDDEN)), values


def random_planner(folder: Path, name: str = "mine", seed: int = 0, **arguments: Any) -> Path:
    """The ONNX file of a random network, with its metadata, in ``folder``."""
    path = folder / f"{name}.onnx"
    export_planner(random_network(seed, **arguments), path, FACTS)
    return path
