"""The reward for coming nearer to a pellet is potential-based, whatever is done: over an episode it telescopes."""

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


def random_action(env: PacManBotEnv, rng: np.random.Generator) -> Any:
    if env.config.action == "velocity":
        return rng.uniform(-1, 1, size=2).astype(np.float32)
    return int(rng.choice(np.flatnonzero(env.action_masks())))


@pytest.mark.parametrize("timeout", ["truncation", "termination"])
@pytest.mark.parametrize("name", GAMES)
def test_step_is_rewarded_by_metres_of_path(name: str, timeout: str) -> None:
    ends, approached = set(), 0.0
    for seed in range(4):
        discount_per_s = (1.0, 0.9)[seed % 2]
        one, other = twins(discount_per_s, seed, **joined(GAMES[name], {"settings": {"timeout": timeout}}))
        rng, over = np.random.default_rng(seed), False
        while not over:
            before, action = path_left(one), random_action(one, rng)
            (_, reward, *end, info), (_, plain, *same_end, same_info) = one.step(action), other.step(action)
            assert (end, info) == (same_end, same_info)
            factor = discount_per_s ** info.get("elapsed_s", one.config.execution.tick_s)
            left = 0.0 if end[0] else factor * path_left(one)
            assert reward - plain == pytest.approx(PROGRESS * (before - left), abs=1e-9)
            approached = max(approached, reward - plain)
            over = any(end)
        ends.add(end[0])
    assert approached > 0.1
    assert True in ends or timeout == "truncation"


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
