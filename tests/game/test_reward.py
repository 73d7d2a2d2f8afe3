"""The reward sums a tick, pellets, caught ghosts, completed rounds and the end, for numbers and for arrays."""

import numpy as np
import pytest

from pacman_env.config import RewardConfig
from pacman_env.game.ends import CAUGHT, CLEARED, COMPLETE, RUNNING, TIMEOUT
from pacman_env.game.reward import Rewards, TickCounts, reward

REWARDS = Rewards.of(
    RewardConfig(pellet=1.5, death=-20.0, completion=7.0, tick=-0.25, timeout=-3.0, power=0.5, ghost_caught=4.0)
)
AT_END = {RUNNING: 0.0, CAUGHT: -20.0, COMPLETE: 7.0, CLEARED: 0.0, TIMEOUT: -3.0}


@pytest.mark.parametrize("end", AT_END)
def test_reward_sums_tick_pellets_ghosts_rounds_and_end(end: int) -> None:
    counts = TickCounts(tick_pellets=2, tick_power=1, tick_caught=3, tick_rounds=1)
    assert reward(counts, end, REWARDS) == -0.25 + 3.0 + 0.5 + 12.0 + 7.0 + AT_END[end]


def test_reward_of_arrays_is_elementwise() -> None:
    ends, pellets = np.array(list(AT_END)), np.arange(len(AT_END))
    expected = [reward(TickCounts(number), end, REWARDS) for number, end in enumerate(AT_END)]
    assert reward(TickCounts(pellets), ends, REWARDS).tolist() == expected
