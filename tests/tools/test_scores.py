"""Reference scores: every id has some, and playing an id with its seeds gives the same."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from pacman_env.envs.registration import IDS
from pacman_env.policies.registry import make_policy
from tools.figures import store
from tools.scores import POLICIES, play, read


def test_committed_scores_cover_every_id_and_policy() -> None:
    known = read(store.read())
    assert list(known) == list(IDS)
    for env_id, scores in known.items():
        drives = IDS[env_id].kwargs.get("action") == "velocity"
        assert tuple(scores) == (POLICIES[:1] if drives else POLICIES)
        assert {one["episodes"] for one in scores.values()} == {200}


@pytest.mark.parametrize("env_id", ["pacman_env/PacManBot-v2", "pacman_env/PacManBotFlatEndless-v2"])
def test_score_equals_return_of_single_environment(env_id: str) -> None:
    played = play(env_id, "clyde_aware", range(3, 5))
    env: Any = gym.make(env_id).unwrapped
    for k, seed in enumerate((3, 4)):
        policy = make_policy("clyde_aware")
        _, info = env.reset(seed=seed)
        policy.reset(np.ones(1, dtype=np.bool_), env.config)
        total, over, round_before = 0.0, False, 1
        while not over:
            if info.get("round", 1) != round_before:
                policy.reset(np.ones(1, dtype=np.bool_), env.config)
                round_before = info["round"]
            _, reward, terminated, truncated, info = env.step(env.action_of(policy.select(env.situation))[0])
            total, over = total + reward, terminated or truncated
        assert played["return"][k] == pytest.approx(total)
        assert played["pellets"][k] == info.get("score", info["collected"])
