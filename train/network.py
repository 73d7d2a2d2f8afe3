"""The learned planner's network in torch: one encoder for every candidate, pooled context, one logit each.

The order of candidates does not matter, and what may not be chosen has no influence: candidates are encoded alike,
pooled by mean and maximum over those that may be chosen (Zaheer et al., "Deep Sets", 2017), and each is judged by its
own encoding beside the pool. What SB3 adds around it is in :mod:`train.policy`.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import nn
from torch.nn import functional

FORBIDDEN = -1e8  # logit of what may not be chosen, as in sb3-contrib


def _linear(inputs: int, outputs: int, gain: float = 2**0.5) -> nn.Linear:
    layer = nn.Linear(inputs, outputs)
    nn.init.orthogonal_(layer.weight, gain)
    nn.init.zeros_(layer.bias)
    return layer


class EntityNetwork(nn.Module):
    """Logits and value of situations from their planner features (``pacman_env.sim.observation.planner_features``).

    Args:
        candidate_features: F, numbers per candidate.
        global_features: H, numbers of the whole.
        width: of every hidden layer.
        dropped_features: columns of the candidates that it is not shown, for ablations.
        dropped_kinds: columns of the candidates that mark kinds it may not choose, for ablations.
    """

    def __init__(
        self,
        candidate_features: int,
        global_features: int,
        width: int = 64,
        dropped_features: Sequence[int] = (),
        dropped_kinds: Sequence[int] = (),
    ) -> None:
        super().__init__()
        self.encode_candidate = _linear(candidate_features + global_features, width)
        self.encode = _linear(width, width)
        self.judge_candidate = _linear(3 * width, width)
        self.judge = _linear(width, 1, 0.01)
        self.critic = nn.Sequential(_linear(2 * width + global_features, width), nn.ReLU(), _linear(width, 1, 1.0))
        self.candidate_features, self.width = candidate_features, width
        shown = torch.ones(candidate_features)
        shown[list(dropped_features)] = 0.0
        self.shown: torch.Tensor
        self.register_buffer("shown", shown)
        self.dropped_kinds = tuple(dropped_kinds)

    def forward(
        self, candidates: torch.Tensor, whole: torch.Tensor, mask: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Logits (B, C), -1e8 where masked, and values (B,).

        Args:
            candidates: (B, C, F) float32.
            whole: (B, H) float32.
            mask: (B, C) bool, may be chosen.
        """
        mask = self._without_dropped(candidates, mask)
        own, context = self._halves(self.encode_candidate, self.candidate_features)
        encoded = functional.relu(own(candidates * self.shown) + context(whole)[:, None])
        encoded = functional.relu(self.encode(encoded))
        shown = encoded * mask[:, :, None]
        mean = shown.sum(dim=1) / mask.sum(dim=1, keepdim=True).clamp(min=1)
        pooled = torch.cat([mean, shown.amax(dim=1)], dim=1)  # encodings are at least 0
        own, context = self._halves(self.judge_candidate, self.width)
        logits = self.judge(functional.relu(own(encoded) + context(pooled)[:, None]))[:, :, 0]
        values = self.critic(torch.cat([pooled, whole], dim=1))[:, 0]
        return torch.where(mask, logits, torch.full_like(logits, FORBIDDEN)), values

    def packed(
        self, candidates: torch.Tensor, whole: torch.Tensor, mask: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """The same as ``forward``, computed for the candidates that may be chosen alone: twice as fast to train."""
        mask = self._without_dropped(candidates, mask)
        counts = mask.sum(dim=1)
        game = torch.repeat_interleave(torch.arange(len(counts)), counts)
        own, context = self._halves(self.encode_candidate, self.candidate_features)
        encoded = functional.relu(own(candidates[mask] * self.shown) + context(whole)[game])
        encoded = functional.relu(self.encode(encoded))
        pooled = torch.cat(
            [torch.segment_reduce(encoded, how, lengths=counts, unsafe=True, initial=0.0) for how in ("mean", "max")],
            dim=1,
        )
        own, context = self._halves(self.judge_candidate, self.width)
        logits = self.judge(functional.relu(own(encoded) + context(pooled)[game]))[:, 0]
        values = self.critic(torch.cat([pooled, whole], dim=1))[:, 0]
        padded = torch.full(mask.shape, FORBIDDEN, dtype=logits.dtype)
        return padded.masked_scatter(mask, logits), values

    def _without_dropped(self, candidates: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        for kind in self.dropped_kinds:
            mask = mask & (candidates[:, :, kind] < 0.5)
        return mask

    @staticmethod
    def _halves(layer: nn.Linear, inputs: int):  # type: ignore[no-untyped-def]
        """A layer over [own numbers, context] as two: the context's part is computed once per situation."""
        own, context = layer.weight[:, :inputs], layer.weight[:, inputs:]
        return (
            lambda x: functional.linear(x, own),
            lambda x: functional.linear(x, context, layer.bias),
        )
