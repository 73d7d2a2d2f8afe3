import numpy as np
import pytest

from pacman_env.config import Config
from pacman_env.episodes.decisions import allowed, ghost_choices, play_until_due
from pacman_env.heuristics.simple import Nearest
from pacman_env.levels.assets import map_assets
from pacman_env.observations.situation_writer import situation_of
from pacman_env.sim.batch import GameBatch
from pacman_env.sim.ghost_state import TO_CANDIDATE, TO_CELL, choices_of
from tests.evaluation.helpers import CONFIG

BY_POLICY = CONFIG.with_fields(**{"clyde.ghosts": ("policy", "wander", "policy")})


def begun(n: int, config: Config = CONFIG) -> GameBatch:
    batch = GameBatch(map_assets("house", config), config, n)
    batch.reset(np.arange(n), np.arange(n, dtype=np.uint64))
    return batch


def test_forbidden_choice_becomes_hold() -> None:
    batch = begun(5)
    batch.alive[0, 2] = False
    choices = np.array([2, 2, batch.candidates, -1, batch.hold])
    taken = allowed(situation_of(batch), choices, batch.hold)
    assert taken.tolist() == [batch.hold, 2, batch.hold, batch.hold, batch.hold]


def test_ghosts_are_moved_by_policies_and_given_choices() -> None:
    batch = begun(2, BY_POLICY)
    given = {2: choices_of(np.array([5, 6]), TO_CELL)}
    choices = ghost_choices(batch, {0: Nearest()}, given)
    assert choices is not None
    assert choices[:, 0].tolist() == [(TO_CANDIDATE, chosen) for chosen in Nearest().select(situation_of(batch, 0))]
    assert choices[:, 1].tolist() == [(0, 0)] * 2
    assert choices[:, 2].tolist() == [(TO_CELL, 5), (TO_CELL, 6)]
    assert ghost_choices(batch, {}) is None


@pytest.mark.parametrize("when", ["tick", "event"])
def test_ghost_policies_are_asked_before_each_tick(when: str) -> None:
    batch = begun(1, BY_POLICY.with_fields(**{"decisions.when": when}))
    seen: list[int] = []

    def ask() -> np.ndarray | None:
        seen.append(int(batch.games["tick"][0]))
        return ghost_choices(batch, {0: Nearest(), 2: Nearest()})

    play_until_due(batch, np.array([0]), np.array([False]), ask)
    ticks = int(batch.games["tick"][0])
    assert seen == list(range(ticks))
    assert (ticks > 1) == (when == "event")
    play_until_due(batch, np.array([0]), np.array([False]), ask, played=np.array([False]))
    assert batch.games["tick"][0] == ticks
