"""Masks, endless games and what is drawn for an episode."""

import numpy as np
import pytest

from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.game.round import clyde_speed_mps
from tests.envs.cases import SMALL
from tests.envs.helpers import make


def nearest_pellet(env: PacManBotEnv) -> int:
    paths = np.where(env.action_masks(), env.situation.path_robot[0], np.inf)
    return int(paths[: env.batch.pellet_slots].argmin())


@pytest.mark.parametrize("source", ["house", "generated"])
def test_endless_game_starts_rounds_until_death_or_timeout(source: str) -> None:
    settings = {**SMALL, "time_limit_s": 60.0, "clyde.speed_step_mps": 0.1, "pellets.spacing_m": 3.0}
    env = make(map=source, preset="ideal", settings={**settings, "endless": True})
    config, outcomes, rounds = env.config, set(), 1
    for seed in range(8):
        _, before = env.reset(seed=seed)
        assert (before["round"], before["score"]) == (1, 0)
        over = False
        while not over:
            observation, reward, terminated, truncated, info = env.step(nearest_pellet(env))
            over = terminated or truncated
            completed = info["round"] - before["round"]
            gained = info["score"] - before["score"]
            end = {"caught": config.reward.death, "timeout": config.reward.timeout}.get(info["outcome"], 0.0)
            expected = config.reward.tick + gained * config.reward.pellet + completed * config.reward.completion + end
            assert reward == pytest.approx(expected, abs=1e-9)
            speed = clyde_speed_mps(config.clyde.speed_mps, config.clyde.speed_step_mps, info["round"])
            assert observation["clyde"][6] == pytest.approx(speed, rel=1e-6)
            assert info["round_seed"] == before["round_seed"]  # it names the episode
            if completed:
                assert completed == 1
                assert info["collected"] == 0
                assert observation["round"].tolist() == [0.0, info["spawned"]]
                assert not over
            before = info
        outcomes.add(info["outcome"])
        rounds = max(rounds, info["round"])
    assert "caught" in outcomes <= {"caught", "timeout"}
    assert rounds >= 3


def test_endless_game_ends_at_time_limit_of_round() -> None:
    settings = {**SMALL, "execution.pickup_radius_m": 3.0, "execution.death_radius_m": 1e-6, "time_limit_s": 30.0}
    env = make(map="maze", settings={**settings, "endless": True})
    _, info = env.reset(seed=0)
    while info["round"] < 3:
        _, _, terminated, truncated, info = env.step(nearest_pellet(env))
        assert {terminated, truncated} == {False}
    results = [env.step(env.batch.hold) for _ in range(60)]
    assert [result[3] for result in results] == [False] * 59 + [True]
    assert results[-1][4]["outcome"] == "timeout"
    assert results[-1][0]["round"][0] == 30.0
