"""Roll-outs keep what every policy promises, improve a careless base, and obey a robot's clock."""

import copy
import itertools
import pickle
from typing import Any

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.episodes.rollout import episode_seeds, play
from pacman_env.game.ends import CAUGHT
from pacman_env.heuristics.clyde_aware import ClydeAware
from pacman_env.heuristics.rollouts.rollouts import Rollouts
from pacman_env.heuristics.simple import Nearest
from pacman_env.levels.assets import map_assets
from pacman_env.observations.situation import HOLD, Situation
from pacman_env.observations.situation_writer import situation_of
from pacman_env.policies.base import Policy
from pacman_env.policies.registry import make_policy
from tests.policies.contract import PolicyContract
from tests.sim.players import played

CHASE = make_config("robot", "robust", **{"clyde.ghosts": ("chase",)})
SHORT: dict[str, Any] = {"futures": 4, "seconds": 6.0}


class TestRollouts(PolicyContract):
    def make(self) -> Policy:
        return Rollouts(**SHORT, candidates=2)


class TestRolloutsOfLookahead(PolicyContract):
    def make(self) -> Policy:
        return make_policy("rollouts:lookahead", **SHORT, candidates=2)


@pytest.mark.parametrize("name", ["rollouts", "rollouts:lookahead"])
def test_policy_knows_its_name(name: str) -> None:
    assert make_policy(name).name == name


def ready(policy: Rollouts, games: int = 1) -> Rollouts:
    policy.reset(np.ones(games, np.bool_), CHASE)
    return policy


def chased(games: int = 8) -> Situation:
    return situation_of(played(CHASE, games, steps=30, keep=10))


def test_roll_outs_improve_a_careless_base() -> None:
    """``nearest`` drives past chasing ghosts; its futures show that."""
    assets, seeds = map_assets("house", CHASE), episode_seeds(3, 8)
    times = []
    for policy in (Nearest(), Rollouts("nearest", candidates=6, futures=8, seconds=20.0, near_m=100.0)):
        records, _ = play(assets, CHASE.with_fields(time_limit_s=60.0), policy, seeds)
        times.append(records["time_s"][records["end"] == CAUGHT].sum() + 60.0 * (records["end"] != CAUGHT).sum())
    assert times[1] > 1.5 * times[0]


def test_goal_is_kept_between_two_trials() -> None:
    situation, policy = chased(), ready(Rollouts(**SHORT), 8)
    for i in range(8):
        situation.tick[i] = 2 * situation.tick[i] + 1
        situation.current[i] = np.flatnonzero(situation.mask[i] & (situation.kind[i] != HOLD))[-1]
    np.testing.assert_array_equal(policy.select(situation), situation.current)


def test_easy_choices_are_the_base_s() -> None:
    situation = chased()
    policy, base = ready(Rollouts(**SHORT, certain=0.0, near_m=0.0, every=1), 8), make_policy("ppo")
    np.testing.assert_array_equal(policy.scores(situation), base.scores(situation))
    hard = ready(Rollouts(**SHORT, near_m=100.0, every=1), 8)
    assert not np.array_equal(hard.scores(situation), base.scores(situation))


def test_reasons_show_what_the_futures_brought() -> None:
    situation, policy = chased(1), ready(Rollouts(**SHORT, near_m=100.0, every=1, candidates=2))
    tried = [reason for reason in policy.explain(situation)[0] if "return" in reason]
    assert len(tried) == 2
    assert all(0.0 <= float(reason["caught_in_futures"]) <= 1.0 for reason in tried)


def test_standing_clock_changes_nothing_and_a_fast_one_ends_early() -> None:
    situation = chased(4)
    free, standing, fast = (ready(Rollouts(**SHORT, near_m=100.0, every=1), 4) for _ in range(3))
    standing.clock_s = lambda: 1.0
    counter = itertools.count()
    fast.clock_s = lambda: float(next(counter))
    np.testing.assert_array_equal(standing.scores(situation), free.scores(situation))
    scores = fast.scores(situation)
    assert next(counter) <= 4 * 4  # a few looks at the clock for each situation: each game ends at its first decision
    assert not np.isnan(scores).any()
    assert situation.mask[np.arange(4), fast.select(situation)].all()


def test_copies_decide_alike() -> None:
    situation, policy = chased(2), ready(Rollouts(**SHORT, near_m=100.0, every=1), 2)
    expected = policy.scores(situation)
    for other in (copy.deepcopy(policy), pickle.loads(pickle.dumps(policy))):
        np.testing.assert_array_equal(other.scores(situation), expected)


@pytest.mark.parametrize(
    "wrong", [{"futures": 5}, {"futures": 2}, {"candidates": 0}, {"seconds": -1.0}, {"base": ClydeAware()}]
)
def test_unusable_parameters_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(wrong))):
        Rollouts(**wrong)
