"""No policy can make the robot dither: the executor keeps a pellet for the dwell time, whoever chooses."""

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.game.execution import RUNNING
from pacman_env.policies.base import BasePolicy
from pacman_env.policies.registry import make_policy
from pacman_env.sim.observation.situation import Situation
from tests.sim.players import new_batch

GAMES = 12


class Restless(BasePolicy):
    """Changes its mind at every decision."""

    name = "restless"

    def __init__(self) -> None:
        self.rng = np.random.default_rng(0)

    def scores(self, situation: Situation) -> np.ndarray:
        return np.where(situation.mask, self.rng.random(situation.mask.shape), -np.inf)


@pytest.mark.parametrize("policy", ["restless", "nearest", "clyde_aware", "lookahead", "ppo"])
@pytest.mark.parametrize("dwell_s", [0.0, 2.0])
def test_pellet_is_pursued_for_the_dwell_time(policy: str, dwell_s: float) -> None:
    config = make_config(**{"execution.min_dwell_s": dwell_s, "clyde.speed_mps": 0.45})
    batch, chooser = new_batch(config, GAMES, "house"), Restless() if policy == "restless" else make_policy(policy)
    chooser.reset(np.ones(GAMES, np.bool_), config)
    since, pursued, changes = np.zeros(GAMES), np.full(GAMES, -1), 0
    for tick in range(160):
        now_s = tick * config.execution.tick_s
        batch.step(chooser.select(batch.situation()))
        g = batch.games
        for i in np.flatnonzero(g["end"] == RUNNING):
            goal, before = int(g["pursued"][i]), pursued[i]
            if goal == before:
                continue
            if 0 <= before < batch.pellet_slots and 0 <= goal < batch.pellet_slots and batch.rules["alive"][i, before]:
                assert now_s - since[i] >= dwell_s, f"game {i}: pellet {before} was given up for {goal}"
                changes += 1
            pursued[i], since[i] = goal, now_s
    assert changes > 0 or policy != "restless"
