"""Infos of games written by hand."""

import numpy as np

from pacman_env.config import make_config
from pacman_env.envs.infos import OUTCOMES, GameInfos
from pacman_env.game.ends import CAUGHT, CLEARED, COMPLETE, RUNNING, TIMEOUT
from pacman_env.levels.assets import map_assets
from pacman_env.sim.batch import GameBatch
from pacman_env.sim.kernels import summarize

NAMES = {RUNNING: "running", CAUGHT: "caught", COMPLETE: "complete", CLEARED: "cleared", TIMEOUT: "timeout"}


def test_infos_contain_counts_and_outcomes_of_games() -> None:
    config = make_config()
    batch = GameBatch(map_assets("maze", config), config, len(NAMES))
    games = batch.games
    games["end"] = list(NAMES)
    counts = {name: name for name in ("collected", "lost", "spawned", "aborts", "score")} | {
        "ghosts_caught": "all_caught"
    }
    for k, field in enumerate(counts.values()):
        games[field] = np.arange(5) + 10 * k
    games["episode_seed"] = [2**64 - 1, 9, 0, 1, 2]
    for i in range(batch.n):
        summarize(games[i], i, batch.summary)
    infos, allowed = GameInfos(batch), np.zeros((batch.n, batch.candidates), dtype=np.int8)
    first, every = infos.of_first(allowed), infos.of_all(allowed)
    batch.summary[:] = 0  # infos have memory of their own
    expected = {
        "outcome": list(NAMES.values()),
        **{name: games[field].tolist() for name, field in counts.items()},
        "round_seed": [2**64 - 1, 9, 0, 1, 2],
    }
    assert {key: array.tolist() for key, array in every.items()} == expected
    assert first == {key: values[0] for key, values in expected.items()}
    assert [OUTCOMES[end] for end in NAMES] == list(NAMES.values())
    assert len(OUTCOMES) == len(NAMES)
