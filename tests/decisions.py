"""Choices of the shipped policies in the same situations, as JSON: to be compared between interpreters.

Run as a script it uses the *installed* package; it needs nothing but the base install.
"""

import json
import platform
from typing import Any

import numpy as np

import pacman_env
from pacman_env.config import make_config
from pacman_env.levels.assets import map_assets
from pacman_env.observations.situation_writer import situation_of
from pacman_env.policies.registry import make_policy
from pacman_env.sim.batch import GameBatch

MAP = "house"
GAMES = 24
POLICIES = ("clyde_aware", "lookahead", "ppo")


def decisions(policy: str) -> dict[str, Any]:
    """Choices at the beginning of rounds, (N,), and the scores of all candidates, (N, C)."""
    config = make_config("robot")
    batch = GameBatch(map_assets(MAP, config), config, GAMES)
    batch.reset(np.arange(GAMES), np.arange(GAMES, dtype=np.uint64))
    situation = situation_of(batch)
    planner = make_policy(policy)
    planner.reset(np.ones(GAMES, dtype=np.bool_), config)
    scores = planner.scores(situation)
    return {"choices": planner.select(situation).tolist(), "scores": scores.tolist()}


if __name__ == "__main__":
    answers = {"python": platform.python_version(), "numpy": np.__version__, "package": pacman_env.__file__}
    for name in POLICIES:
        answers[name] = decisions(name)
    print(json.dumps(answers))
