"""The learned planner's network in torch: one encoder for every candidate, pooled context, one logit each.

The order of candidates does not matter, and what may not be chosen has no influence. torch is the extra ``train``;
nothing else of the package imports this module.
"""

from __future__ import annotations

import torch
from torch import nn


def _linear(inputs: int, outputs: int, gain: float = 2**0.5) -> nn.Linear:
    layer = nn.Linear(inputs, outputs)
    nn.init.orthogonal_(layer.weight, gain)
    nn.init.zeros_(layer.bias)
    return layer


class EntityNetwork(nn.Module):
    """Logits and value of situations from their planner features."""

    def __init__(self, candidate_features: int, global_features: int, width: int = 64) -> None:
        super().__init__()
        self.encoder = nn.Sequential(
            _linear(candidate_features + global_features, width), nn.ReLU(), _linear(width, width), nn.ReLU()
        )
        self.actor = nn.Sequential(_linear(3 * width, width), nn.ReLU(), _linear(width, 1, 0.01))
        self.critic = nn.Sequential(_linear(2 * width + global_features, width), nn.ReLU(), _linear(width, 1, 1.0))

    def forward(
        self, candidates: torch.Tensor, whole: torch.Tensor, mask: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Logits (B, C), of masked candidates -1e8, and values (B,).

        ``candidates`` (B, C, F), ``whole`` (B, H), ``mask`` (B, C) bool with at least one True in each row.
        """
        count = candidates.shape[1]
        context = whole[:, None, :].expand(-1, count, -1)
        encoded = self.encoder(torch.cat([candidates, context], dim=2))
        shown = mask[:, :, None]
        mean = (encoded * shown).sum(dim=1) / shown.sum(dim=1)
        most = (encoded * shown).max(dim=1).values  # of numbers that are at least 0
        pooled = torch.cat([mean, most], dim=1)
        logits = self.actor(torch.cat([encoded, pooled[:, None, :].expand(-1, count, -1)], dim=2))[:, :, 0]
        value = self.critic(torch.cat([pooled, whole], dim=1))[:, 0]
        return torch.where(mask, logits, torch.full_like(logits, -1e8)), value
