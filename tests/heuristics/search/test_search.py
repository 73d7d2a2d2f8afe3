"""Search keeps what every policy promises and its budget, outwits a chaser, and is its base where all ghosts wander."""

from __future__ import annotations

import itertools
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pacman_env.episodes.rollout import episode_seeds, play
from pacman_env.game.behaviour_belief import BELIEVED
from pacman_env.game.execution import COMPLETE
from pacman_env.game.ghosts import BEHAVIOURS
from pacman_env.heuristics.search import search as module
from pacman_env.heuristics.search.search import Search, is_predictable
from pacman_env.policies.base import Policy
from pacman_env.policies.registry import make_policy
from pacman_env.sim.core.batch import GameBatch
from pacman_env.sim.maps.assets import map_assets
from pacman_env.sim.observation.situation import HOLD
from tests.policies.contract import PolicyContract, random_situation
from tests.sim.coarse.games import config_of, situation_of


class TestSearchAgainstWanderers(PolicyContract):
    def make(self) -> Policy:
        return Search()


class TestSearchAgainstAChaser(PolicyContract):
    config = config_of("chase")

    def make(self) -> Policy:
        return Search(nodes=300, horizon_s=12.0)


def policy_for(*ghosts: str, **parameters: Any) -> Search:
    policy = Search(**{"nodes": 2000, "behaviours": "configuration", **parameters})
    policy.reset(np.ones(1, np.bool_), config_of(*ghosts))
    return policy


@pytest.mark.parametrize("ghosts", [("wander",), ("wander", "wander"), ("policy",)])
def test_it_is_its_base_where_nothing_is_predictable(ghosts: tuple[str, ...]) -> None:
    config = config_of(*ghosts)
    situation = situation_of(config, 4)
    for name in ("ppo", "nearest"):
        base = make_policy(name)
        search = Search(base=name)
        for policy in (base, search):
            policy.reset(np.ones(4, np.bool_), config)
        np.testing.assert_array_equal(search.select(situation), base.select(situation))
        np.testing.assert_array_equal(search.scores(situation), base.scores(situation))


def test_it_searches_where_one_ghost_is_predictable() -> None:
    situation = situation_of(config_of("wander", "chase"))
    scores = policy_for("wander", "chase").scores(situation)
    assert not np.array_equal(scores, make_policy("ppo").scores(situation))


@pytest.mark.parametrize(
    ("believed", "searched"), [("chase", True), ("arcade", True), ("wander", False), ("other", False)]
)
def test_what_a_ghost_is_believed_to_do_decides_whether_it_searches(believed: str, searched: bool) -> None:
    situation = situation_of(config_of("policy"))
    belief = np.zeros_like(situation.belief)
    belief[0, 0, BELIEVED.index(believed)] = 1.0
    situation = replace(situation, belief=belief)
    scores = policy_for("policy", behaviours="belief").scores(situation)
    assert np.array_equal(scores, make_policy("ppo").scores(situation)) != searched


def test_of_several_situations_each_is_searched_or_not() -> None:
    situation = situation_of(config_of("chase"), 2)
    belief = np.zeros_like(situation.belief)
    belief[0, 0, BELIEVED.index("chase")] = belief[1, 0, BELIEVED.index("wander")] = 1.0
    situation = replace(situation, belief=belief)
    policy = policy_for("chase", behaviours="belief")
    together = policy.scores(situation)
    for i in range(2):
        np.testing.assert_array_equal(together[i], policy.scores(situation.rows(np.array([i])))[0])


def test_a_source_of_behaviours_that_there_is_not_is_refused() -> None:
    with pytest.raises(ValueError, match="behaviours = 'guess': must be one of belief, configuration"):
        Search(behaviours="guess")


def test_the_same_seed_gives_the_same_scores_and_another_seed_other_futures() -> None:
    situation = situation_of(config_of("wander", "chase"))
    first, again, other = (policy_for("wander", "chase", seed=seed).scores(situation) for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.parametrize(("ghosts", "samples"), [(("chase",), 2), (("chase", "wander"), 2), (("arcade", "wander"), 3)])
@pytest.mark.parametrize("nodes", [800, 3000, 12_000])
def test_no_more_segments_are_played_than_the_budget(ghosts: tuple[str, ...], samples: int, nodes: int) -> None:
    policy = policy_for(*ghosts, nodes=nodes, samples=samples)
    policy.scores(situation_of(config_of(*ghosts)))
    assert nodes / 4 < policy.played <= nodes


def test_more_time_is_a_wider_search(monkeypatch: pytest.MonkeyPatch) -> None:
    situation = situation_of(config_of("chase"))
    played = []
    for milliseconds in (1.0, 8.0):
        clock = itertools.count(0.0, 1e-3)  # a search takes a millisecond, however wide it is
        monkeypatch.setattr(module, "time", SimpleNamespace(perf_counter=lambda clock=clock: next(clock)))
        policy = policy_for("chase", milliseconds=milliseconds)
        policy.scores(situation)
        played.append(policy.played)
    assert played[1] > 5 * played[0]


def completed(policy: Policy, speed_mps: float, rounds: int) -> int:
    config = config_of("chase", **{"clyde.speed_mps": speed_mps})
    record, _ = play(map_assets("house", config), config, policy, episode_seeds(0, rounds), batch_size=rounds)
    return int((record["end"] == COMPLETE).sum())


@pytest.mark.daily
def test_it_flees_in_time_from_a_chaser_that_it_is_told_of() -> None:
    assert completed(Search(nodes=6000, behaviours="configuration"), 0.25, 4) >= 3


@pytest.mark.parametrize("speed_mps", [0.15, 0.22])
def test_it_flees_in_time_from_a_ghost_that_it_takes_for_a_chaser(speed_mps: float) -> None:
    assert completed(Search(nodes=6000), speed_mps, 12) >= 9


def test_a_rule_does_not_flee_from_that_chaser_in_time() -> None:
    assert completed(make_policy("lookahead"), 0.22, 12) <= 4


def test_a_round_is_the_same_again_and_in_any_batch() -> None:
    config = config_of("chase", "wander", time_limit_s=40.0)
    assets, seeds = map_assets("house", config), episode_seeds(3, 3)
    alone, _ = play(assets, config, Search(nodes=1500), seeds, batch_size=1)
    together, _ = play(assets, config, Search(nodes=1500), seeds, batch_size=3)
    np.testing.assert_array_equal(alone, together)


def test_at_a_refuge_that_is_reached_there_is_no_bonus_for_staying() -> None:
    config = config_of("chase")
    batch = GameBatch(map_assets("house", config), config, 1)
    batch.reset(np.array([0]), np.array([0], dtype=np.uint64))
    situation = batch.situation()  # the first refuge is the home pose, where the robot stands
    assert situation.current[0] == -1
    plain, keeping = (policy_for("chase", keep_worth=worth).scores(situation) for worth in (0.0, 50.0))
    np.testing.assert_array_equal(plain, keeping)


def test_the_goal_pursued_is_worth_more() -> None:
    config = config_of("chase")
    batch = GameBatch(map_assets("house", config), config, 1)
    batch.reset(np.array([0]), np.array([0], dtype=np.uint64))
    batch.step(batch.situation().path_robot.argmin(axis=1))
    batch.step(np.array([2]))
    situation = batch.situation()
    current = situation.current[0]
    assert current >= 0
    plain, keeping = (policy_for("chase", keep_worth=worth).scores(situation)[0] for worth in (0.0, 50.0))
    if np.isfinite(plain[current]):
        assert keeping[current] == plain[current] + 50.0
    others = np.arange(len(plain)) != current
    np.testing.assert_array_equal(plain[others], keeping[others])


def test_holding_is_always_rated() -> None:
    situation = situation_of(config_of("chase"), 3)
    scores = policy_for("chase").scores(situation)
    assert np.isfinite(scores[situation.kind == HOLD]).all()


def test_what_can_be_predicted() -> None:
    assert {name for name, one in BEHAVIOURS.items() if is_predictable(one)} == {"arcade", "chase"}


@pytest.mark.parametrize(
    "parameters",
    [{"nodes": 0}, {"samples": 17}, {"segment_s": 1.0}, {"lead_m": float("nan")}, {"near_worth": -1.0}],
)
def test_parameters_out_of_range_are_named(parameters: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(parameters))):
        Search(**parameters)


def test_a_parameter_that_it_does_not_have_is_refused() -> None:
    with pytest.raises(TypeError, match="width"):
        Search(width=3)


def test_a_situation_without_maps_is_refused() -> None:
    situation = replace(random_situation(0, 1), maps=None)
    with pytest.raises(ValueError, match="no maps"):
        policy_for("chase").scores(situation)
