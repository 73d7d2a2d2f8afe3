"""The reward for coming nearer to a pellet is potential-based: over an episode it telescopes, whatever was done."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.envs.pettingzoo_env import PacManBotParallelEnv
from tests.envs.helpers import QUICK, joined, make

PROGRESS = 0.7
GAMES: dict[str, dict[str, Any]] = {
    "velocities": {"action": "velocity", "settings": {"action_range": "unit"}},
    "goals_between_events": {"settings": {"decisions.when": "event", "observation.candidates": "nearest"}},
    "goals_that_are_aborted": {"settings": {"nav2.abort_rate": 0.3}},
    "endless": {"settings": {"execution.pickup_radius_m": 3.0, "endless": True}},
}


def twins(discount_per_s: float = 1.0, seed: int = 3, **chosen: Any) -> tuple[PacManBotEnv, PacManBotEnv]:
    """Return the same game with the reward and without."""
    settings = {**QUICK, "decisions.discount_per_s": discount_per_s, **chosen.pop("settings", {})}
    envs = make(settings=settings | {"reward.progress": PROGRESS}, **chosen), make(settings=settings, **chosen)
    for env in envs:
        env.reset(seed=seed)
    return envs


def path_left(env: Any) -> float:
    """Return the path to the nearest pellet left, m, from the situation; 0 if there is none."""
    lengths = env.situation.path_robot[0, : env.batch.pellet_slots][env.batch.alive[0]]
    return float(lengths.min(initial=np.inf)) if len(lengths) else 0.0


def differences(envs: tuple[PacManBotEnv, PacManBotEnv], seed: int) -> tuple[list[tuple[float, float]], bool]:
    """Return the difference of the rewards and the duration of each step, and whether the end was a termination."""
    rng, found = np.random.default_rng(seed), []
    while True:
        if envs[0].config.action == "velocity":
            action: Any = rng.uniform(-1, 1, size=2).astype(np.float32)
        else:
            action = int(rng.choice(np.flatnonzero(envs[0].action_masks())))
        one, other = (env.step(action) for env in envs)
        assert one[2:] == other[2:]
        found.append((one[1] - other[1], one[4].get("elapsed_s", envs[0].config.execution.tick_s)))
        if one[2] or one[3]:
            return found, one[2]


@pytest.mark.parametrize("timeout", ["truncation", "termination"])
@pytest.mark.parametrize("name", GAMES)
def test_progress_rewards_sum_to_path_difference(name: str, timeout: str) -> None:
    seen = set()
    for seed in range(4):
        discount_per_s = (1.0, 0.9)[seed % 2]
        envs = twins(discount_per_s, seed, **joined(GAMES[name], {"settings": {"timeout": timeout}}))
        before = path_left(envs[0])
        found, terminated = differences(envs, seed)
        total, factor = 0.0, 1.0
        for difference, passed_s in found:
            total += factor * difference
            factor *= discount_per_s**passed_s
        left = 0.0 if terminated else factor * path_left(envs[0])
        assert total == pytest.approx(PROGRESS * (before - left), abs=1e-9)
        assert len(found) > 1
        seen.add(terminated)
    assert True in seen or timeout == "truncation"


def test_step_is_rewarded_by_metres_of_path() -> None:
    one, other = twins(settings={"pellets.spacing_m": 2.0, "execution.pickup_radius_m": 0.25})
    target = int(np.where(one.action_masks(), one.situation.path_robot[0], np.inf)[: one.batch.pellet_slots].argmin())
    before, collected, approached = path_left(one), 0, 0.0
    for _ in range(12):
        (_, reward, *_), (_, plain, *_, info) = one.step(target), other.step(target)
        assert reward - plain == pytest.approx(PROGRESS * (before - path_left(one)), abs=1e-9)
        if info["collected"] == collected:
            approached += reward - plain
        before, collected = path_left(one), info["collected"]
    assert approached > 0.2


def test_ghost_has_its_own_progress_reward() -> None:
    settings = {"ghost_reward.progress": -PROGRESS, "time_limit_s": 20.0}
    one, other = (PacManBotParallelEnv(settings={**chosen, "zero_sum": False}) for chosen in (settings, {}))
    for env in (one, other):
        env.reset(seed=0)
    situation = one.situation
    target = int(np.where(situation.mask[0], situation.path_robot[0], np.inf)[: one.batch.pellet_slots].argmin())
    for _ in range(6):
        actions, before = {"pacman": target, "clyde": one.batch.hold}, path_left(one)
        rewards, plain = one.step(actions)[1], other.step(actions)[1]
        assert rewards["pacman"] == plain["pacman"]
        assert rewards["clyde"] - plain["clyde"] == pytest.approx(-PROGRESS * (before - path_left(one)), abs=1e-9)
    assert rewards["clyde"] != plain["clyde"]
