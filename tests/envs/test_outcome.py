"""Infos of games written by hand."""

import numpy as np

from pacman_env.envs.outcome import OUTCOMES, infos
from pacman_env.game.ends import CAUGHT, CLEARED, COMPLETE, RUNNING, TIMEOUT
from pacman_env.sim.core.kernels import SUMMARY, summarize
from pacman_env.sim.core.parameters import GAME

NAMES = {RUNNING: "running", CAUGHT: "caught", COMPLETE: "complete", CLEARED: "cleared", TIMEOUT: "timeout"}


def test_infos_contain_counts_and_outcomes_of_games() -> None:
    batch = np.zeros(len(NAMES), dtype=GAME)
    batch["end"] = list(NAMES)
    counts = {name: name for name in ("collected", "lost", "spawned", "aborts", "score")} | {
        "ghosts_caught": "all_caught"
    }
    for k, field in enumerate(counts.values()):
        batch[field] = np.arange(5) + 10 * k
    batch["episode_seed"] = [9, 2**64 - 1, 0, 1, 2]
    numbers = np.zeros((len(SUMMARY), len(batch)), dtype=np.int64)
    for i in range(len(batch)):
        summarize(batch[i], i, numbers)
    info = infos(numbers)
    numbers[:] = 0  # infos have memory of their own
    assert {key: array.tolist() for key, array in info.items()} == {
        "outcome": list(NAMES.values()),
        **{name: batch[field].tolist() for name, field in counts.items()},
        "round_seed": [9, 2**64 - 1, 0, 1, 2],
    }
    assert [OUTCOMES[end] for end in NAMES] == list(NAMES.values())
    assert len(OUTCOMES) == len(NAMES)
