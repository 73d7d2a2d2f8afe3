"""Reward, ends and info of games written by hand."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacman_env.config import RewardConfig
from pacman_env.envs.outcome import OUTCOMES, infos, reward_and_end
from pacman_env.game.execution import CLEARED, COMPLETE, DEAD, RUNNING, TIMEOUT
from pacman_env.sim.core.kernels import SUMMARY, summarize
from pacman_env.sim.core.parameters import GAME

REWARD = RewardConfig(pellet=1.5, death=-20.0, completion=7.0, tick=-0.25, timeout=-3.0)
AT_END = {RUNNING: 0.0, DEAD: -20.0, COMPLETE: 7.0, CLEARED: 0.0, TIMEOUT: -3.0}
NAMES = {RUNNING: "running", DEAD: "caught", COMPLETE: "complete", CLEARED: "cleared", TIMEOUT: "timeout"}


def summary(batch: np.ndarray) -> np.ndarray:
    """As a batch tells it together with its situations."""
    numbers = np.zeros((len(SUMMARY), len(batch)), dtype=np.int64)
    for i in range(len(batch)):
        summarize(batch[i], i, numbers)
    return numbers


def games(ends: list[int], pellets: list[int] | None = None) -> np.ndarray:
    out = np.zeros(len(ends), dtype=GAME)
    out["end"] = ends
    out["tick_pellets"] = pellets or [0] * len(ends)
    return out


@settings(deadline=None)  # the first example compiles
@given(st.lists(st.tuples(st.sampled_from(list(AT_END)), st.integers(0, 4), st.booleans()), min_size=1, max_size=9))
def test_a_tick_is_worth_its_time_its_pellets_and_its_end(cases: list[tuple[int, int, bool]]) -> None:
    ends, pellets, over = (list(column) for column in zip(*cases, strict=True))
    over = [was and end != RUNNING for was, end in zip(over, ends, strict=True)]
    reward, terminated, truncated = reward_and_end(games(ends, pellets), np.array(over), REWARD)
    assert (reward.dtype, terminated.dtype, truncated.dtype) == (np.float64, np.bool_, np.bool_)
    expected = [0.0 if was else -0.25 + 1.5 * n + AT_END[end] for end, n, was in zip(ends, pellets, over, strict=True)]
    np.testing.assert_allclose(reward, expected, rtol=0, atol=1e-12)
    assert terminated.tolist() == [end in (DEAD, COMPLETE, CLEARED) for end in ends]
    assert truncated.tolist() == [end == TIMEOUT for end in ends]


@pytest.mark.parametrize("end", list(AT_END))
def test_the_outcome_is_named(end: int) -> None:
    assert OUTCOMES[end] == NAMES[end]
    assert infos(summary(games([end])))["outcome"].tolist() == [NAMES[end]]
    assert len(OUTCOMES) == len(NAMES)


def test_the_counts_are_the_games_own() -> None:
    batch = games([RUNNING, DEAD])
    batch["collected"], batch["lost"], batch["spawned"], batch["aborts"] = [1, 2], [3, 4], [5, 6], [7, 8]
    batch["episode_seed"] = [9, 2**64 - 1]
    info = infos(summary(batch))
    assert {key: array.tolist() for key, array in info.items()} == {
        "outcome": ["running", "caught"],
        "collected": [1, 2],
        "lost": [3, 4],
        "spawned": [5, 6],
        "aborts": [7, 8],
        "round_seed": [9, 2**64 - 1],
    }


def test_the_infos_of_a_tick_outlive_what_is_told() -> None:
    batch = games([DEAD])
    batch["collected"] = 4
    numbers = summary(batch)
    info = infos(numbers)
    numbers[:] = 0
    assert info["collected"].tolist() == [4]
    assert info["outcome"].tolist() == ["caught"]
