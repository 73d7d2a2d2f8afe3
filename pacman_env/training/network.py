"""The learned planner's network in torch: one encoder for every candidate, pooled context, one logit each.

The order of candidates does not matter, and what may not be chosen has no influence: candidates are encoded alike,
pooled by mean and maximum over those that may be chosen (Zaheer et al., "Deep Sets", 2017), and each is judged by its
own encoding beside the pool.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import Any, NamedTuple

import torch
from numpy.typing import NDArray
from torch import nn
from torch.nn import functional

FORBIDDEN = -1e8  # logit of what may not be chosen, as in sb3-contrib


def _linear(inputs: int, outputs: int, gain: float = 2**0.5) -> nn.Linear:
    layer = nn.Linear(inputs, outputs)
    nn.init.orthogonal_(layer.weight, gain)
    nn.init.zeros_(layer.bias)
    return layer


class Packed(NamedTuple):
    """Situations whose candidates that may be chosen come first, then copies of the first of them.

    A copy changes neither the maximum nor, with a share of 0, the mean, so that nothing has to be masked.
    """

    candidates: torch.Tensor  # (B, C, F)
    whole: torch.Tensor  # (B, H)
    share: torch.Tensor  # (B, C) in the mean; 0: may not be chosen
    counts: torch.Tensor  # (B,) candidates that may be chosen

    def of(self, rows: torch.Tensor | slice) -> Packed:
        """Some of the situations, with only as many candidates as the fullest of them needs."""
        counts = self.counts[rows]
        most = max(int(counts.max()), 1)
        return Packed(self.candidates[:, :most][rows], self.whole[rows], self.share[:, :most][rows], counts)


class Row:
    """Situations one behind the other, in memory that is allocated once: large blocks that come and go cost time."""

    def __init__(self, room: int) -> None:
        self.room, self._count = room, 0
        self._all: Packed | None = None

    def clear(self) -> None:
        self._count = 0

    def add(self, part: Packed) -> None:
        if self._all is None:
            self._all = Packed(*(torch.empty(self.room, *a.shape[1:], dtype=a.dtype, device=a.device) for a in part))
        last = self._count + len(part.counts)
        for array, new in zip(self._all, part, strict=True):
            array[self._count : last] = new
        self._count = last

    def situations(self) -> Packed:
        """All of them, not copied."""
        assert self._all is not None, "no situations were met"
        return Packed(*(array[: self._count] for array in self._all))


class _Maximum(torch.autograd.Function):
    """The maximum over candidates; those that share it share its gradient. Half the time of ``amax``."""

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
    """Logits and value of situations from their planner features (``pacman_env.sim.observation.planner_features``).

    For ablations, ``dropped_features`` are columns of the candidates that have no influence, and ``dropped_kinds``
    columns that mark kinds which may not be chosen.
    """

    def __init__(
        self,
        candidate_features: int,  # F, per candidate
        global_features: int,  # H, of the whole situation
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

    def __reduce__(self) -> tuple[Any, ...]:
        """A copy is on the CPU. Pickled tensors would lie in memory that only processes of one machine share."""
        weights = {name: tensor.cpu().numpy() for name, tensor in self.state_dict().items()}
        sizes = self.candidate_features, self.encode_candidate.in_features - self.candidate_features, self.width
        return _with_weights, (type(self), sizes, self.dropped_kinds, weights)

    def forward(
        self, candidates: torch.Tensor, whole: torch.Tensor, mask: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Logits (B, C), -1e8 where ``mask`` (B, C) is False, and values (B,); of (B, C, F) and (B, H)."""
        situations, order = self.pack(candidates, whole, mask)
        logits, values = self.judge_packed(situations.of(slice(None)))
        padded = torch.full(mask.shape, FORBIDDEN, dtype=logits.dtype, device=logits.device)
        return padded.scatter(1, order[:, : logits.shape[1]], logits), values

    def pack(self, candidates: torch.Tensor, whole: torch.Tensor, mask: torch.Tensor) -> tuple[Packed, torch.Tensor]:
        """The inputs laid out so that little is computed for nothing, and (B, C) the candidates' new order."""
        for kind in self.dropped_kinds:
            mask = mask & (candidates[:, :, kind] < 0.5)
        counts, order = mask.sum(dim=1), torch.argsort(mask, dim=1, descending=True, stable=True)
        inside = torch.arange(mask.shape[1], device=mask.device) < counts[:, None]
        source = torch.where(inside, order, order[:, :1])
        source = source + mask.shape[1] * torch.arange(len(mask), device=mask.device)[:, None]
        first = candidates.flatten(0, 1).index_select(0, source.flatten()).view_as(candidates)
        return Packed(first, whole, inside / counts.clamp(min=1)[:, None], counts), order

    def judge_packed(self, situations: Packed) -> tuple[torch.Tensor, torch.Tensor]:
        """Logits (B, C), -1e8 for what may not be chosen, in the order of the rows; values (B,)."""
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
        """A layer over [own numbers, context] as two: the context's part is computed once per situation."""
        own, context = layer.weight[:, :inputs] * shown, layer.weight[:, inputs:]
        return partial(functional.linear, weight=own), partial(functional.linear, weight=context, bias=layer.bias)


def _with_weights(
    kind: type[EntityNetwork],
    sizes: tuple[int, int, int],
    dropped_kinds: tuple[int, ...],
    weights: dict[str, NDArray[Any]],
) -> EntityNetwork:
    with torch.random.fork_rng(devices=[]):  # a network draws its first weights, which are not kept
        network = kind(*sizes, dropped_kinds=dropped_kinds)
    network.load_state_dict({name: torch.tensor(array) for name, array in weights.items()})
    return network
