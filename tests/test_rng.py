import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env import rng
from pacman_env.engine.jit import kernel
from pacman_env.rng import CLYDE, LOCALIZATION, NAVIGATION, POLICY

below, mix, normal, stream, uniform = map(kernel, (rng.below, rng.mix, rng.normal, rng.stream, rng.uniform))

PURPOSES = (CLYDE, LOCALIZATION, NAVIGATION, POLICY)
WORD = 2**64 - 1
seeds = st.integers(0, WORD)


def splitmix64(state: int) -> tuple[int, int]:
    """The published generator in Python's own integers: next state and output."""
    state = (state + 0x9E3779B97F4A7C15) & WORD
    z = ((state ^ (state >> 30)) * 0xBF58476D1CE4E5B9) & WORD
    z = ((z ^ (z >> 27)) * 0x94D049BB133111EB) & WORD
    return state, z ^ (z >> 31)


def uniforms(seed: int, purpose: int, count: int) -> np.ndarray:
    state = stream(np.uint64(seed), purpose)
    draws = np.empty(count)
    for i in range(count):
        state, draws[i] = uniform(np.uint64(state))
    return draws


def test_generator_reproduces_published_outputs_for_seed_1234567() -> None:
    known = [6457827717110365317, 3203168211198807973, 9817491932198370423, 4593380528125082431, 16408922859458223821]
    state = word = 1234567
    for output in known:
        word, expected = splitmix64(word)
        state, u = uniform(np.uint64(state))
        assert (state, mix(np.uint64(state)), expected) == (word, output, output)
        assert u == (output >> 11) / 2.0**53


@given(seeds)
def test_uniform_scales_splitmix64_output_to_unit_interval(word: int) -> None:
    state, draw = uniform(np.uint64(word))
    expected_state, expected = splitmix64(word)
    assert (state, mix(np.uint64(state))) == (expected_state, expected)
    assert 0.0 <= draw < 1.0


@given(seeds, st.integers(1, 2**31))
def test_below_stays_below_its_bound(seed: int, bound: int) -> None:
    state = seed
    for _ in range(10):
        state, draw = below(np.uint64(state), bound)
        assert 0 <= draw < bound


def test_uniform_and_below_cover_their_ranges_evenly() -> None:
    counts, _ = np.histogram(uniforms(3, CLYDE, 20000), bins=20, range=(0.0, 1.0))
    assert ((counts - 1000) ** 2 / 1000).sum() < 44  # chi-square, 19 degrees of freedom, p = 0.001
    state, counts = stream(np.uint64(8), POLICY), np.zeros(7)
    for _ in range(14000):
        state, draw = below(np.uint64(state), 7)
        counts[draw] += 1
    assert ((counts - 2000) ** 2 / 2000).sum() < 22.5  # 6 degrees of freedom, p = 0.001


def test_normal_has_mean_0_variance_1_and_tails() -> None:
    state, draws = stream(np.uint64(5), LOCALIZATION), np.empty(40000)
    for i in range(len(draws)):
        state, draws[i] = normal(np.uint64(state))
    assert abs(draws.mean()) < 4 / math.sqrt(len(draws))
    assert draws.var() == pytest.approx(1.0, abs=4 * math.sqrt(2 / len(draws)))
    for limit, share in ((1.0, 0.3173), (2.0, 0.0455), (3.0, 0.0027)):
        assert (np.abs(draws) > limit).mean() == pytest.approx(share, abs=0.008)


@given(seeds)
def test_each_purpose_has_its_own_random_stream(seed: int) -> None:
    states = {int(stream(np.uint64(seed), purpose)) for purpose in PURPOSES}
    assert len(states) == len(PURPOSES)


def test_streams_of_purposes_and_seeds_are_uncorrelated() -> None:
    columns = [uniforms(seed, purpose, 2000) for seed in (0, 1, 2) for purpose in PURPOSES]
    correlation = np.corrcoef(columns) - np.eye(len(columns))
    assert np.abs(correlation).max() < 4.5 / math.sqrt(2000)
    assert len(np.unique(np.concatenate(columns))) == 2000 * len(columns)
