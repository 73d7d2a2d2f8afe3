"""The rounds of matchups on any executor."""

from __future__ import annotations

import numpy as np
import pytest

from pacman_env.episodes.rollout import episode_seeds
from pacman_env.evaluation.rounds.play import Matchup, play_all
from pacman_env.executors.base import InProcess
from pacman_env.executors.choice import local
from tests.evaluation.helpers import CONFIG, LEVELS, LEVELS_CONFIG, played, played_on_levels


def test_two_processes_repeat_records_of_one_process() -> None:
    seeds = episode_seeds(5, 12)
    matchups = [Matchup("house", CONFIG, policy, seeds) for policy in ("clyde_aware", "random")]
    with local(2) as executor:
        for _ in range(2):
            ended: list[int] = []
            first, second = play_all(matchups, executor, on_end=ended.append)
            np.testing.assert_array_equal(first[0], played("clyde_aware")[0])
            np.testing.assert_array_equal(second[0], played("random")[0])
            assert sum(ended) == 24
            assert len(ended) == 4  # two pieces of each matchup, or nothing was shared out


def test_progress_counts_every_round() -> None:
    ended: list[int] = []
    play_all([Matchup("house", CONFIG, "nearest", episode_seeds(5, 12))], InProcess(), on_end=ended.append)
    assert sum(ended) == 12
    assert len(ended) > 1


def test_error_of_worker_process_is_raised() -> None:
    with local(2) as executor, pytest.raises(ValueError, match="unknown policy 'nobody'"):
        play_all([Matchup("house", CONFIG, "nobody", episode_seeds(5, 2))], executor)


@pytest.mark.parametrize("workers", [1, 2])
def test_level_rounds_are_returned_in_seed_order(workers: int) -> None:
    matchups = [Matchup(LEVELS, LEVELS_CONFIG, policy, episode_seeds(5, 8)) for policy in ("lookahead", "nearest")]
    with local(workers) as executor:
        (first, _), (second, _) = play_all(matchups, executor)
    np.testing.assert_array_equal(first, played_on_levels("lookahead"))
    np.testing.assert_array_equal(second, played_on_levels("nearest"))
