"""Decisions by events: the same game as with a decision at each tick, under a wrapper that repeats choices."""

import os
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.game.decisions import HOLD, decision_due, decision_rules
from pacman_env.policies.registry import make_policy
from tests.envs.helpers import joined, same

EPISODES = int(os.environ.get("PACMAN_ENV_EVENT_EPISODES", "12"))  # 10,000 for a release
GHOSTS: tuple[Any, ...] = (None, ("chase",), ("arcade", "wander"))
EVENTS = {"decisions.when": "event"}


class Repeats:
    """One game with a decision at each tick, which is repeated until the rule asks for another."""

    def __init__(self, **arguments: Any) -> None:
        self.env = PacManBotEnv(**arguments)
        config = self.env.config
        self.rules = SimpleNamespace(**decision_rules(config, lambda s: round(s / config.execution.tick_s)))
        self.discount = config.decisions.discount_per_s**config.execution.tick_s

    def step(self, action: int) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any], int]:
        env, game = self.env, self.env.batch.games[0]
        allowed = env.action_masks()[action]
        before, reward, factor, waited = game.copy(), 0.0, 1.0, 0
        while True:
            observation, earned, terminated, truncated, info = env.step(action)
            reward += factor * earned
            factor *= self.discount
            news = terminated or truncated or any(game[name] != before[name] for name in ("collected", "round"))
            choice = HOLD if action == env.batch.hold else action
            waited += 1
            now = float(game["distance"])
            asked = decision_due(choice, int(game["pursued"]), news, float(before["distance"]), now, waited, self.rules)
            if asked or not allowed:
                return observation, reward, terminated, truncated, info, waited


def play(seed: int, policy: str, **arguments: Any) -> dict[str, Any]:
    """Play one episode on both, bit for bit; return the last info."""
    ticks, events = Repeats(**arguments), PacManBotEnv(**joined(arguments, {"settings": EVENTS}))
    rng = np.random.default_rng(seed)
    observation, _ = events.reset(seed=seed)
    expected, _ = ticks.env.reset(seed=seed)
    chooser = make_policy(policy)
    chooser.reset(np.ones(1, dtype=np.bool_), events.config)
    over = False
    while not over:
        assert same(observation, expected)
        action = int(chooser.select(events.situation)[0])
        if rng.random() < 0.1:  # forbidden ones among them
            action = int(rng.integers(events.batch.candidates))
        observation, *ours, info = events.step(action)
        expected, *theirs, info_there, waited = ticks.step(action)
        assert ours == theirs
        assert info.pop("elapsed_s") == pytest.approx(waited * events.config.execution.tick_s, abs=1e-9)
        assert info == info_there
        assert events.batch.games.tobytes() == ticks.env.batch.games.tobytes()
        over = ours[1] or ours[2]
    return info


@pytest.mark.parametrize(("policy", "rules"), [("nearest", "robust"), ("random_pellet", "as_built")])
def test_event_decisions_play_same_game_as_ticks(policy: str, rules: str) -> None:
    for seed in range(max(1, EPISODES // 2)):
        settings = {"clyde.speed_mps": 0.1 + 0.05 * (seed % 8), "time_limit_s": 120.0, "decisions.discount_per_s": 0.99}
        play(seed, policy, map="house", ghosts=GHOSTS[seed % 3], settings={**settings, "execution.rules": rules})


def test_event_decisions_continue_in_next_rounds() -> None:
    settings = {"endless": True, "time_limit_s": 60.0, "pellets.spacing_m": 3.0, "execution.pickup_radius_m": 2.0}
    assert play(2, "nearest", map="house", preset="ideal", settings=settings)["round"] > 1
