"""Episodes decided by events: those of the environment with ``decide="event"``, whoever plays them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode
from numpy.typing import NDArray

from pacman_env.config import Config, make_config
from pacman_env.envs.outcome import OUTCOMES
from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv
from pacman_env.episodes.rollout import EPISODE, episode_seeds, play
from pacman_env.evaluation.replay import RecordedGame
from pacman_env.evaluation.rounds.scenarios import open_scenario
from pacman_env.game.execution import RUNNING
from pacman_env.heuristics.simple import Nearest
from pacman_env.policies.base import Policy
from pacman_env.policies.registry import make_policy
from pacman_env.sim.maps.assets import map_assets
from pacman_env.sim.observation.situation import Situation
from tests.episodes.watcher import Watcher
from tests.evaluation.helpers import ENDLESS

SETTINGS = {"pellets.spacing_m": 3.0, "time_limit_s": 120.0, "clyde.speed_mps": 0.3}
CONFIG = make_config("robot", **SETTINGS, **{"decisions.when": "event"})
GAMES = 6


class Careless(Nearest):
    """Forgets every third time, counted by game, what may be chosen."""

    name = "careless"

    def __init__(self) -> None:
        super().__init__()
        self._asked = np.zeros(0, np.int64)

    def reset(self, games: NDArray[np.bool_], config: Config) -> None:
        if len(self._asked) != len(games):
            self._asked = np.zeros(len(games), np.int64)
        self._asked[games] = 0

    def select(self, situation: Situation) -> NDArray[np.int64]:
        chosen = super().select(situation)
        self._asked += 1
        candidates = situation.mask.shape[1]
        return np.where(self._asked % 3 == 0, (self._asked * 5) % candidates, chosen)


POLICIES = {"clyde_aware": lambda: make_policy("clyde_aware"), "careless": Careless}


def in_the_environment(policy: Policy) -> tuple[NDArray[np.uint64], NDArray]:
    """Seeds of rounds, and how they ended."""
    envs = PacManBotVectorEnv(
        GAMES, map="house", settings={**SETTINGS, "decisions.when": "event"}, autoreset_mode=AutoresetMode.DISABLED
    )
    _, infos = envs.reset(seed=4)
    policy.reset(np.ones(GAMES, np.bool_), envs.config)
    while (envs.batch.games["end"] == RUNNING).any():
        envs.step(policy.select(envs.situation))
    games, records = envs.batch.games, np.zeros(GAMES, EPISODE)
    for name in ("spawned", "collected", "lost", "aborts", "end"):
        records[name] = games[name]
    records["seed"] = infos["round_seed"]
    records["time_s"] = games["step"] * CONFIG.physics_step_s
    records["rounds"] = records["collected"] == records["spawned"]
    return records["seed"], records


@pytest.mark.parametrize("name", POLICIES)
def test_round_by_events_equals_the_environments(name: str) -> None:
    seeds, records = in_the_environment(POLICIES[name]())
    played, _ = play(map_assets("house", CONFIG), CONFIG, POLICIES[name](), seeds, batch_size=4)
    np.testing.assert_array_equal(played, records)
    assert len(set(records["end"])) > 1


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
    env = PacManBotEnv(map="house", settings={**settings, "decisions.when": "event", "endless": True})
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


@pytest.mark.parametrize(
    ("config", "policy"),
    [(CONFIG, "clyde_aware"), (ENDLESS.with_fields(**{"decisions.when": "event"}), "nearest")],
)
def test_replayed_round_equals_the_played_one(config: Config, policy: str) -> None:
    source: Any = open_scenario("house", config)
    seeds = episode_seeds(5, 2)
    record = play(source, config, policy, seeds)[0][1]
    game = RecordedGame(source, config, policy, seeds[1], policy)
    while not game.over:
        game.step()
    words = f" in round {record['rounds'] + 1}" if config.endless else ""
    assert game.outcome().startswith(f"{OUTCOMES[record['end']]}{words} after {record['time_s']:.1f} s, ")
    assert game.outcome().split(" s, ")[1].startswith(f"{record['collected']} ")
