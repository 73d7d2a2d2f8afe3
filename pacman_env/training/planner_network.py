"""Network of the learned planner in torch: a shared encoder of candidates, pooled context, one logit per candidate.

The order of candidates does not matter, and forbidden candidates have no influence. Candidates share an encoder
and are pooled by mean and maximum over the allowed ones (Zaheer et al., "Deep Sets", 2017). The logit of a candidate
depends on its own encoding and the pooled context.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any, NamedTuple

import torch
from torch import nn
from torch.nn import functional

FORBIDDEN = -1e8  # logit of a forbidden candidate, as in sb3-contrib


def _linear(inputs: int, outputs: int, gain: float = 2**0.5) -> nn.Linear:
    layer = nn.Linear(inputs, outputs)
    nn.init.orthogonal_(layer.weight, gain)
    nn.init.zeros_(layer.bias)
    return layer


class PackedSituations(NamedTuple):
    """Situations with the allowed candidates first, padded with copies of the first candidate.

    The network needs no masks: a copy does not change the maximum over candidates, and its weight ``share`` in the mean
    is 0.
    """

    candidates: torch.Tensor  # (B, C, F)
    whole: torch.Tensor  # (B, H)
    share: torch.Tensor  # (B, C) weight in the mean; 0: forbidden
    counts: torch.Tensor  # (B,) number of allowed candidates

    def of(self, rows: torch.Tensor | slice) -> PackedSituations:
        """Return the situations ``rows``, without candidates beyond the largest number of allowed candidates."""
        counts = self.counts[rows]
        most = max(int(counts.max()), 1)
        return PackedSituations(self.candidates[:, :most][rows], self.whole[rows], self.share[:, :most][rows], counts)


def joined(parts: Iterable[PackedSituations]) -> PackedSituations:
    """Return the situations of all parts, one after the other."""
    return PackedSituations(*map(torch.cat, zip(*parts, strict=True)))


class _Maximum(torch.autograd.Function):
    """Maximum over candidates; equal maxima share the gradient. Faster than ``amax``."""

    @staticmethod
    def forward(ctx: Any, encoded: torch.Tensor) -> torch.Tensor:
        top = encoded.amax(dim=1)
        ctx.save_for_backward(encoded, top)
        return top

    @staticmethod
    def backward(ctx: Any, gradient: torch.Tensor) -> torch.Tensor:
        encoded, top = ctx.saved_tensors
        shared = torch.eq(encoded, top[:, None], out=torch.empty_like(encoded))
        return shared.mul_((gradient / shared.sum(dim=1))[:, None])


class EntityNetwork(nn.Module):
    """Computes logits and values of situations from planner features (``pacman_env.observations.planner_features``).

    For ablations, ``dropped_features`` are candidate columns to ignore, and ``dropped_kinds`` are columns that mark
    candidates to forbid.
    """

    def __init__(
        self,
        candidate_features: int,  # F, features per candidate
        global_features: int,  # H, features of the whole situation
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
        """Return logits (B, C) and values (B,) for ``candidates`` (B, C, F) and ``whole`` (B, H), float32.

        The logit of a candidate is -1e8 if ``mask`` (B, C) is False.
        """
        situations, order = self.pack(candidates, whole, mask)
        logits, values = self.judge_packed(situations.of(slice(None)))
        padded = torch.full(mask.shape, FORBIDDEN, dtype=logits.dtype, device=logits.device)
        return padded.scatter(1, order[:, : logits.shape[1]], logits), values

    def pack(
        self, candidates: torch.Tensor, whole: torch.Tensor, mask: torch.Tensor
    ) -> tuple[PackedSituations, torch.Tensor]:
        """Return the inputs of ``forward``, allowed candidates first, and the candidates' old numbers (B, C)."""
        for kind in self.dropped_kinds:
            mask = mask & (candidates[:, :, kind] < 0.5)
        counts, order = mask.sum(dim=1), torch.argsort(mask, dim=1, descending=True, stable=True)
        inside = torch.arange(mask.shape[1], device=mask.device) < counts[:, None]
        source = torch.where(inside, order, order[:, :1])
        source = source + mask.shape[1] * torch.arange(len(mask), device=mask.device)[:, None]
        first = candidates.flatten(0, 1).index_select(0, source.flatten()).view_as(candidates)
        return PackedSituations(first, whole, inside / counts.clamp(min=1)[:, None], counts), order

    def judge_packed(self, situations: PackedSituations) -> tuple[torch.Tensor, torch.Tensor]:
        """Return logits (B, C) in the order of ``situations``, -1e8 for forbidden candidates, and values (B,)."""
        candidates, whole, share = situations[:3]
        own, context = self._halves(self.encode_candidate, self.candidate_features, self.shown)
        encoded = own(candidates).add_(context(whole)[:, None]).relu_()
        encoded = self.encode(encoded).relu_()
        mean, top = torch.bmm(share[:, None], encoded)[:, 0], _Maximum.apply(encoded)
        pooled = torch.cat([mean, top * (share[:, :1] > 0)], dim=1)
        own, context = self._halves(self.judge_candidate, self.width)
        logits = self.judge(own(encoded).add_(context(pooled)[:, None]).relu_())[:, :, 0]
        values = self.critic(torch.cat([pooled, whole], dim=1))[:, 0]
        return torch.where(share > 0, logits, FORBIDDEN), values

    @staticmethod
    def _halves(layer: nn.Linear, inputs: int, shown: torch.Tensor | float = 1.0):  # type: ignore[no-untyped-def]
        """Split a layer whose inputs are own numbers (B, C, n) and a context (B, m) into one function for each.

        The sum of their results is the layer's output, but the context is used only once per situation. ``inputs`` is
        n, and ``shown`` (n,) scales the own numbers.
        """
        own, context = layer.weight[:, :inputs] * shown, layer.weight[:, inputs:]
        return partial(functional.linear, weight=own), partial(functional.linear, weight=context, bias=layer.bias)
