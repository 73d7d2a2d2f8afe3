"""The example of roll-outs keeps what every policy promises, and improves a careless base."""

import copy
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from pacman_env.config import make_config
from pacman_env.episodes.rollout import episode_seeds, play
from pacman_env.game.ends import CAUGHT
from pacman_env.heuristics.simple import Nearest
from pacman_env.levels.assets import map_assets
from pacman_env.observations.situation import HOLD, Situation
from pacman_env.observations.situation_writer import situation_of
from pacman_env.policies.base import Policy
from pacman_env.policies.registry import make_policy
from tests.pages import loaded
from tests.policies.contract import PolicyContract
from tests.sim.players import played

EXAMPLE: ModuleType = loaded(Path(__file__).resolve().parents[2] / "docs" / "examples" / "rollouts.py")
CHASE = make_config("robot", "robust", **{"clyde.ghosts": ("chase",)})
SHORT: dict[str, Any] = {"futures": 4, "seconds": 6.0}


class TestRollouts(PolicyContract):
    def make(self) -> Policy:
        policy: Policy = EXAMPLE.Rollouts(**SHORT, candidates=2)
        return policy


class TestRolloutsOfLookahead(PolicyContract):
    def make(self) -> Policy:
        policy: Policy = EXAMPLE.Rollouts("lookahead", **SHORT, candidates=2)
        return policy


def ready(games: int = 1, **parameters: Any) -> Any:
    policy = EXAMPLE.Rollouts(**{**SHORT, **parameters})
    policy.reset(np.ones(games, np.bool_), CHASE)
    return policy


def chased(games: int = 8) -> Situation:
    return situation_of(played(CHASE, games, steps=30, keep=10))


def test_roll_outs_improve_a_careless_base() -> None:
    """``nearest`` drives past chasing ghosts; its futures show that."""
    assets, seeds = map_assets("house", CHASE), episode_seeds(3, 8)
    times = []
    for policy in (Nearest(), EXAMPLE.Rollouts("nearest", candidates=6, futures=8, seconds=20.0, near_m=100.0)):
        records, _ = play(assets, CHASE.with_fields(time_limit_s=60.0), policy, seeds)
        times.append(records["time_s"][records["end"] == CAUGHT].sum() + 60.0 * (records["end"] != CAUGHT).sum())
    assert times[1] > 1.5 * times[0]


def test_goal_is_kept_between_two_trials() -> None:
    situation, policy = chased(), ready(8)
    for i in range(8):
        situation.tick[i] = 2 * situation.tick[i] + 1
        situation.current[i] = np.flatnonzero(situation.mask[i] & (situation.kind[i] != HOLD))[-1]
    np.testing.assert_array_equal(policy.select(situation), situation.current)


def test_base_decides_easy_situations() -> None:
    situation, base = chased(), make_policy("ppo")
    easy = ready(8, certain=0.0, near_m=0.0, every=1)
    np.testing.assert_array_equal(easy.scores(situation), base.scores(situation))
    hard = ready(8, near_m=100.0, every=1)
    assert not np.array_equal(hard.scores(situation), base.scores(situation))


def test_reasons_show_what_the_futures_brought() -> None:
    situation, policy = chased(1), ready(near_m=100.0, every=1, candidates=2)
    tried = [reason for reason in policy.explain(situation)[0] if "return" in reason]
    assert len(tried) == 2
    assert all(0.0 <= float(reason["caught_in_futures"]) <= 1.0 for reason in tried)


def test_copies_decide_alike() -> None:
    situation, policy = chased(2), ready(2, near_m=100.0, every=1)
    expected = policy.scores(situation)
    np.testing.assert_array_equal(copy.deepcopy(policy).scores(situation), expected)
