"""Reward, ends and info of games written by hand."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.config import RewardConfig
from pacman_env.envs.outcome import OUTCOMES, infos, reward_and_end
from pacman_env.game.execution import CLEARED, COMPLETE, DEAD, RUNNING, TIMEOUT
from pacman_env.sim.core.kernels import SUMMARY, summarize
from pacman_env.sim.core.parameters import GAME

REWARD = RewardConfig(pellet=1.5, death=-20.0, completion=7.0, tick=-0.25, timeout=-3.0)
AT_END = {RUNNING: 0.0, DEAD: -20.0, COMPLETE: 7.0, CLEARED: 0.0, TIMEOUT: -3.0}
NAMES = {RUNNING: "running", DEAD: "caught", COMPLETE: "complete", CLEARED: "cleared", TIMEOUT: "timeout"}


def games(ends: list[int], pellets: list[int] | None = None) -> np.ndarray:
    out = np.zeros(len(ends), dtype=GAME)
    out["end"] = ends
    out["tick_pellets"] = pellets or [0] * len(ends)
    return out


@given(st.lists(st.tuples(st.sampled_from(list(AT_END)), st.integers(0, 4), st.booleans()), min_size=1, max_size=9))
def test_reward_sums_time_pellets_and_end(cases: list[tuple[int, int, bool]]) -> None:
    ends, pellets, over = (list(column) for column in zip(*cases, strict=True))
    over = [was and end != RUNNING for was, end in zip(over, ends, strict=True)]
    reward, terminated, truncated = reward_and_end(games(ends, pellets), np.array(over), REWARD)
    assert (reward.dtype, terminated.dtype, truncated.dtype) == (np.float64, np.bool_, np.bool_)
    expected = [0.0 if was else -0.25 + 1.5 * n + AT_END[end] for end, n, was in zip(ends, pellets, over, strict=True)]
    np.testing.assert_allclose(reward, expected, rtol=0, atol=1e-12)
    assert terminated.tolist() == [end in (DEAD, COMPLETE, CLEARED) for end in ends]
    assert truncated.tolist() == [end == TIMEOUT for end in ends]


def test_infos_contain_counts_and_outcomes_of_games() -> None:
    batch = games(list(AT_END))
    for k, field in enumerate(("collected", "lost", "spawned", "aborts")):
        batch[field] = np.arange(5) + 10 * k
    batch["episode_seed"] = [9, 2**64 - 1, 0, 1, 2]
    numbers = np.zeros((len(SUMMARY), len(batch)), dtype=np.int64)
    for i in range(len(batch)):
        summarize(batch[i], i, numbers)
    info = infos(numbers)
    numbers[:] = 0  # infos have memory of their own
    assert {key: array.tolist() for key, array in info.items()} == {
        "outcome": [NAMES[end] for end in AT_END],
        **{field: batch[field].tolist() for field in ("collected", "lost", "spawned", "aborts")},
        "round_seed": [9, 2**64 - 1, 0, 1, 2],
    }
    assert [OUTCOMES[end] for end in NAMES] == list(NAMES.values())
    assert len(OUTCOMES) == len(NAMES)
