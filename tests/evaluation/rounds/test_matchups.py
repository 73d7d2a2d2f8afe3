"""The rounds of matchups on any executor."""

import numpy as np
import pytest

from pacman_env.episodes.rollout import episode_seeds
from pacman_env.evaluation.rounds.matchups import Matchup, play_all
from pacman_env.executors.executor import InProcess
from pacman_env.executors.process_pool import LocalProcesses
from tests.evaluation.helpers import CONFIG, LEVELS, LEVELS_CONFIG, played, played_on_levels


@pytest.mark.parametrize("workers", [1, 2])
def test_rounds_are_same_in_seed_order_with_any_workers(workers: int) -> None:
    matchups = [Matchup("house", CONFIG, policy, episode_seeds(5, 12)) for policy in ("clyde_aware", "random_pellet")]
    matchups += [Matchup(LEVELS, LEVELS_CONFIG, policy, episode_seeds(5, 8)) for policy in ("lookahead", "nearest")]
    expected = [*(played(policy)[0] for policy in ("clyde_aware", "random_pellet"))]
    expected += [played_on_levels(policy) for policy in ("lookahead", "nearest")]
    with InProcess() if workers == 1 else LocalProcesses(workers) as executor:
        for _ in range(workers):
            ended: list[int] = []
            found = play_all(matchups, executor, on_end=ended.append)
            for (records, _), wanted in zip(found, expected, strict=True):
                np.testing.assert_array_equal(records, wanted)
            assert sum(ended) == 2 * 12 + 2 * 8
            assert len(ended) >= workers * len(matchups)  # every matchup is divided
