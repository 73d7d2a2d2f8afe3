"""Search keeps what every policy promises and its budget, outwits a chaser, and is its base where all ghosts wander."""

import itertools
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pacman_env.episodes.rollout import episode_seeds, play
from pacman_env.game.behaviour_belief import BELIEVED
from pacman_env.game.ends import CAUGHT, COMPLETE
from pacman_env.game.ghosts import BEHAVIOURS
from pacman_env.heuristics.search import search as module
from pacman_env.heuristics.search.search import Search, is_predictable
from pacman_env.levels.assets import map_assets
from pacman_env.observations.situation import HOLD
from pacman_env.observations.situation_writer import situation_of
from pacman_env.policies.base import Policy
from pacman_env.policies.registry import make_policy
from pacman_env.sim.batch import GameBatch
from tests.policies.contract import PolicyContract
from tests.sim.coarse_games import config_of, first_situation


class TestSearchAgainstAChaser(PolicyContract):
    config = config_of("chase")

    def make(self) -> Policy:
        return Search(nodes=300, horizon_s=12.0)


def policy_for(*ghosts: str, **parameters: Any) -> Search:
    policy = Search(**{"nodes": 2000, "behaviours": "configuration", **parameters})
    policy.reset(np.ones(1, np.bool_), config_of(*ghosts))
    return policy


@pytest.mark.parametrize("ghosts", [("wander", "wander"), ("policy",)])
def test_search_is_its_base_without_predictable_ghosts(ghosts: tuple[str, ...]) -> None:
    config = config_of(*ghosts)
    situation = first_situation(config, 4)
    for name in ("ppo", "nearest"):
        base = make_policy(name)
        search = Search(base=name)
        for policy in (base, search):
            policy.reset(np.ones(4, np.bool_), config)
        np.testing.assert_array_equal(search.select(situation), base.select(situation))
        np.testing.assert_array_equal(search.scores(situation), base.scores(situation))


def test_search_uses_one_predictable_ghost() -> None:
    situation = first_situation(config_of("wander", "chase"))
    scores = policy_for("wander", "chase").scores(situation)
    assert not np.array_equal(scores, make_policy("ppo").scores(situation))


def test_search_leaves_out_harmless_ghosts() -> None:
    one, two = first_situation(config_of("chase")), first_situation(config_of("chase", "chase"))
    harmless = replace(two, fright=np.array([[[0.0, 0.0, 0.0], [9.0, 0.0, 1.0]]]))
    policy = policy_for("chase", "chase")
    np.testing.assert_array_equal(policy.scores(harmless), policy_for("chase").scores(one))
    assert not np.array_equal(policy.scores(two), policy.scores(harmless))
    nobody = policy.scores(replace(two, fright=np.array([[[9.0, 0.0, 1.0], [9.0, 0.0, 1.0]]])))
    assert np.isfinite(nobody[nobody > -np.inf]).all()
    assert np.isfinite(nobody).any()


@pytest.mark.parametrize(
    ("believed", "searched"), [("chase", True), ("arcade", True), ("wander", False), ("other", False)]
)
def test_belief_decides_whether_to_search(believed: str, searched: bool) -> None:
    situation = first_situation(config_of("policy"))
    belief = np.zeros_like(situation.belief)
    belief[0, 0, BELIEVED.index(believed)] = 1.0
    situation = replace(situation, belief=belief)
    scores = policy_for("policy", behaviours="belief").scores(situation)
    assert np.array_equal(scores, make_policy("ppo").scores(situation)) != searched


def test_seed_decides_the_futures() -> None:
    situation = first_situation(config_of("wander", "chase"))
    first, again, other = (policy_for("wander", "chase", seed=seed).scores(situation) for seed in (0, 0, 1))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


@pytest.mark.parametrize(
    ("ghosts", "samples", "nodes"),
    [(("chase",), 2, 800), (("chase", "wander"), 2, 3000), (("arcade", "wander"), 3, 12_000)],
)
def test_budget_limits_the_segments_played(ghosts: tuple[str, ...], samples: int, nodes: int) -> None:
    policy = policy_for(*ghosts, nodes=nodes, samples=samples)
    policy.scores(first_situation(config_of(*ghosts)))
    assert nodes / 4 < policy.played <= nodes


def test_more_time_widens_the_search(monkeypatch: pytest.MonkeyPatch) -> None:
    situation = first_situation(config_of("chase"))
    played = []
    for milliseconds in (1.0, 8.0):
        clock = itertools.count(0.0, 1e-3)  # a search takes a millisecond, however wide it is
        monkeypatch.setattr(module, "time", SimpleNamespace(perf_counter=lambda clock=clock: next(clock)))
        policy = policy_for("chase", milliseconds=milliseconds)
        policy.scores(situation)
        played.append(policy.played)
    assert played[1] > 5 * played[0]


@pytest.mark.parametrize(("speed_mps", "nodes"), [(0.15, 1500), pytest.param(0.22, 6000, marks=pytest.mark.daily)])
def test_search_flees_from_a_believed_chaser(speed_mps: float, nodes: int) -> None:
    config = config_of("chase", **{"clyde.speed_mps": speed_mps})
    record, _ = play(map_assets("house", config), config, Search(nodes=nodes), episode_seeds(0, 12), batch_size=12)
    assert (record["end"] != CAUGHT).sum() >= 9
    assert (record["end"] == COMPLETE).sum() >= 6, "slow rounds end at the time limit"


def test_reached_refuge_has_no_bonus() -> None:
    config = config_of("chase")
    batch = GameBatch(map_assets("house", config), config, 1)
    batch.reset(np.array([0]), np.array([0], dtype=np.uint64))
    situation = situation_of(batch)  # the first refuge is the home pose, where the robot stands
    assert situation.current[0] == -1
    plain, keeping = (policy_for("chase", keep_worth=worth).scores(situation) for worth in (0.0, 50.0))
    np.testing.assert_array_equal(plain, keeping)


def test_pursued_goal_has_a_bonus() -> None:
    config = config_of("chase")
    batch = GameBatch(map_assets("house", config), config, 1)
    batch.reset(np.array([0]), np.array([0], dtype=np.uint64))
    batch.step(situation_of(batch).path_robot.argmin(axis=1))
    batch.step(np.array([2]))
    situation = situation_of(batch)
    current = situation.current[0]
    assert current >= 0
    plain, keeping = (policy_for("chase", keep_worth=worth).scores(situation)[0] for worth in (0.0, 50.0))
    if np.isfinite(plain[current]):
        assert keeping[current] == plain[current] + 50.0
    others = np.arange(len(plain)) != current
    np.testing.assert_array_equal(plain[others], keeping[others])


def test_holding_always_has_a_score() -> None:
    situation = first_situation(config_of("chase"), 3)
    scores = policy_for("chase").scores(situation)
    assert np.isfinite(scores[situation.kind == HOLD]).all()


def test_behaviours_without_chance_are_predictable() -> None:
    assert {name for name, one in BEHAVIOURS.items() if is_predictable(one)} == {"arcade", "chase", "flee"}


@pytest.mark.parametrize(
    "parameters", [{"nodes": 0}, {"samples": 17}, {"segment_s": 1.0}, {"lead_m": float("nan")}, {"behaviours": "guess"}]
)
def test_bad_parameters_are_named(parameters: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(parameters))):
        Search(**parameters)
    with pytest.raises(TypeError, match="width"):
        Search(width=3)
