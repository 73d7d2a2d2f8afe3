"""Episodes decided by events: those of the environment with ``decide="event"``, whoever plays them."""

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.episodes.rollout import episode_seeds, play
from pacman_env.heuristics.simple import Nearest
from pacman_env.sim.maps.assets import map_assets
from tests.episodes.watcher import Watcher
from tests.evaluation.helpers import ENDLESS

SETTINGS = {"pellets.spacing_m": 3.0, "time_limit_s": 120.0, "clyde.speed_mps": 0.3}
CONFIG = make_config("robot", **SETTINGS, **{"decisions.when": "event"})


def test_events_ask_less_often_than_ticks() -> None:
    asked = {}
    for when in ("tick", "event"):
        config = CONFIG.with_fields(**{"decisions.when": when})
        policy = Watcher()
        played, _ = play(map_assets("house", config), config, policy, episode_seeds(5, 4))
        ticks = played["time_s"].sum() / config.execution.tick_s
        asked[when] = sum(policy.asked) / ticks
    assert asked["tick"] >= 1.0
    assert asked["event"] < 0.6


def test_endless_game_by_events_equals_the_environments() -> None:
    settings = {"pellets.spacing_m": 3.0, "time_limit_s": 60.0, "execution.pickup_radius_m": 2.0}
    env = PacManBotEnv(
        map="house", preset="robot_0_15", settings={**settings, "decisions.when": "event", "endless": True}
    )
    policy, time_s = Nearest(), 0.0
    _, info = env.reset(seed=2)
    while info["outcome"] == "running":
        *_, info = env.step(int(policy.select(env.situation)[0]))
        time_s += info["elapsed_s"]
    config = ENDLESS.with_fields(**{"decisions.when": "event"})
    seeds = np.array([info["round_seed"], 7], dtype=np.uint64)
    record = play(map_assets("house", config), config, "nearest", seeds)[0][0]
    assert record["rounds"] == info["round"] - 1 > 0
    assert record["collected"] == info["score"]
    assert record["time_s"] == pytest.approx(time_s)
