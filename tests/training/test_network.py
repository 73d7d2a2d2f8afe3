"""The entity network: order does not matter, what is masked has no influence, both ways of computing it agree."""

from functools import partial
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("onnx")

import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from pacman_env.training.network import FORBIDDEN, EntityNetwork, joined
from tests.training.planners import random_network

torch.set_num_threads(1)  # products as small as these wait for threads longer than they compute
Inputs = tuple[torch.Tensor, torch.Tensor, torch.Tensor]
SHAPES = st.tuples(st.integers(1, 6), st.integers(1, 12))
SEEDS = st.integers(0, 2**32 - 1)
VARIANTS: list[dict[str, Any]] = [
    {},
    {"dropped_features": (4, 6)},
    {"dropped_kinds": (1,)},
    {"dropped_features": (0,), "dropped_kinds": (1, 2)},
]
NETWORKS = [random_network(width=16, **variant) for variant in VARIANTS]


def inputs(seed: int, games: int, count: int, allowed: float = 0.6) -> Inputs:
    """Random candidates, of three kinds, globals and masks."""
    rng = np.random.default_rng(seed)
    network = NETWORKS[0]
    features = network.candidate_features
    candidates = rng.normal(size=(games, count, features)).astype(np.float32)
    candidates[:, :, :3] = np.eye(3)[rng.integers(3, size=(games, count))]
    whole = rng.normal(size=(games, network.encode_candidate.in_features - features)).astype(np.float32)
    return torch.tensor(candidates), torch.tensor(whole), torch.tensor(rng.random((games, count)) < allowed)


def packed(network: EntityNetwork, *batch: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """The network's results by way of packed situations, as training computes them."""
    situations, order = network.pack(*batch)
    logits, values = network(*situations.of(slice(None)))
    padded = torch.full(order.shape, FORBIDDEN, dtype=logits.dtype)
    return padded.scatter(1, order[:, : logits.shape[1]], logits), values


def close(one: torch.Tensor, other: torch.Tensor) -> None:
    np.testing.assert_allclose(one.detach().numpy(), other.detach().numpy(), atol=1e-5, rtol=1e-5)


@settings(max_examples=60)
@given(variant=st.sampled_from(VARIANTS), seed=SEEDS, shape=SHAPES)
def test_logits_follow_order_of_candidates(variant: dict[str, Any], seed: int, shape: tuple[int, int]) -> None:
    network = NETWORKS[VARIANTS.index(variant)]
    candidates, whole, mask = inputs(seed, *shape)
    order = np.random.default_rng(seed).permutation(shape[1])
    for judge in (network, partial(packed, network)):
        logits, values = judge(candidates, whole, mask)
        moved, same = judge(candidates[:, order], whole, mask[:, order])
        close(logits[:, order], moved)
        close(values, same)


@settings(max_examples=60)
@given(variant=st.sampled_from(VARIANTS), seed=SEEDS, shape=SHAPES, more=st.integers(1, 8))
def test_padded_slots_do_not_change_output(
    variant: dict[str, Any], seed: int, shape: tuple[int, int], more: int
) -> None:
    """Whatever stands in them."""
    network = NETWORKS[VARIANTS.index(variant)]
    candidates, whole, mask = inputs(seed, *shape)
    filling, _, _ = inputs(seed + 1, shape[0], more)
    longer = torch.cat([candidates, 100 * filling], dim=1)
    padded = torch.cat([mask, torch.zeros(filling.shape[:2], dtype=torch.bool)], dim=1)
    for judge in (network, partial(packed, network)):
        logits, values = judge(candidates, whole, mask)
        found, same = judge(longer, whole, padded)
        close(logits, found[:, : shape[1]])
        close(values, same)
        assert (found[:, shape[1] :] == FORBIDDEN).all()


@pytest.mark.parametrize("variant", VARIANTS)
@pytest.mark.parametrize("allowed", [0.0, 0.1, 0.6, 1.0])
def test_packed_network_equals_its_definition_and_gradient(variant: dict[str, Any], allowed: float) -> None:
    """Also where nothing may be chosen, in some games or in all."""
    network = random_network(**variant)
    batch = inputs(5, 20, 9, allowed)
    gradients = []
    for judge in (network, partial(packed, network)):
        logits, values = judge(*batch)
        network.zero_grad()
        (torch.where(logits > FORBIDDEN, logits, 0.0).square().sum() + values.square().sum()).backward()
        gradients.append([p.grad.clone() for p in network.parameters() if p.grad is not None])
        assert all(torch.isfinite(gradient).all() for gradient in gradients[-1])
    expected, found = network(*batch), packed(network, *batch)
    assert ((expected[0] == FORBIDDEN) == (found[0] == FORBIDDEN)).all()
    close(expected[0], found[0])
    close(expected[1], found[1])
    for one, other in zip(*gradients, strict=True):
        torch.testing.assert_close(one, other, atol=1e-3, rtol=1e-4)


def test_joined_situations_are_judged_as_their_parts() -> None:
    """Of parts with different numbers of candidates."""
    network = NETWORKS[0]
    parts = [network.pack(*inputs(seed, 5, count))[0] for seed, count in ((1, 4), (2, 9))]
    logits, values = network(*joined(parts))
    for part, first in zip(parts, (0, 5), strict=True):
        expected, rows = network(*part), slice(first, first + 5)
        close(logits[rows, : part.mask.shape[1]], expected[0])
        close(values[rows], expected[1])
        assert (logits[rows, part.mask.shape[1] :] == FORBIDDEN).all()


def test_every_weight_gets_gradient() -> None:
    network = random_network()
    logits, values = network(*inputs(7, 64, 12))
    (torch.where(logits > FORBIDDEN, logits, 0.0).square().sum() + values.square().sum()).backward()
    for name, parameter in network.named_parameters():
        assert parameter.grad is not None, name
        rows = parameter.grad.reshape(len(parameter), -1).abs().sum(dim=1)
        assert (rows > 0).float().mean() > 0.9, name  # a few units may never fire


def test_new_network_rates_candidates_nearly_equally() -> None:
    torch.manual_seed(0)
    reference = random_network()
    network = EntityNetwork(
        reference.candidate_features, reference.encode_candidate.in_features - reference.candidate_features
    )
    candidates, whole, mask = inputs(10, 50, 9, allowed=1.0)
    logits, _ = network(candidates, whole, mask)
    assert (logits.amax(dim=1) - logits.amin(dim=1)).max() < 0.2
