from dataclasses import replace

import numpy as np
import pytest

from pacman_env.heuristics.simple import Nearest, Random, RandomPellet
from pacman_env.observations.situation import PELLET, Situation
from tests.policies.contract import random_situation


def with_paths(paths: list[float], current: int = -1, mask: list[bool] | None = None) -> Situation:
    """One game with the given path lengths to its pellets, then HOLD."""
    situation = random_situation(0, 1, pellets=len(paths), refuges=0, allowed=1.0)
    return replace(
        situation,
        path_robot=np.array([[*paths, 0.0]]),
        mask=np.array([[*(mask or [True] * len(paths)), True]]),
        current=np.array([current]),
    )


@pytest.mark.parametrize(
    ("situation", "goal"),
    [
        (with_paths([3.0, 1.0, 2.0]), 1),
        (with_paths([2.0, 1.0, 1.0]), 1),
        (with_paths([3.0, 1.0, 2.0], mask=[True, False, True]), 2),
        (with_paths([3.0, np.inf, 4.0]), 0),
        (with_paths([np.inf, np.inf]), 2),
        (with_paths([1.3, 1.0], current=0), 0),
        (with_paths([1.31, 1.0], current=0), 1),
        (with_paths([1.1, 1.0], current=0, mask=[False, True]), 1),
        (with_paths([5.0, 6.0], current=2), 0),
    ],
)
def test_nearest_takes_shortest_path_within_margin(situation: Situation, goal: int) -> None:
    assert Nearest(replan_margin_m=0.3).select(situation).tolist() == [goal]


def test_nearest_refuses_an_impossible_margin() -> None:
    for margin in (-0.1, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="replan_margin_m"):
            Nearest(replan_margin_m=margin)


def test_random_pellet_draws_allowed_pellets_uniformly() -> None:
    games = 8000
    situation = random_situation(1, games, pellets=4, refuges=1, allowed=1.0)
    mask = situation.mask.copy()
    mask[:, 1] = False
    goal = RandomPellet().select(replace(situation, mask=mask, current=np.full(games, -1)))
    share = np.bincount(goal, minlength=6) / games
    np.testing.assert_allclose(share, [1 / 3, 0, 1 / 3, 1 / 3, 0, 0], atol=0.02)


def test_random_draws_allowed_candidates_uniformly_whatever_is_pursued() -> None:
    situation = random_situation(1, 8000, pellets=4, refuges=1, allowed=1.0)
    mask = situation.mask.copy()
    mask[:, 1] = False
    goal = Random().select(replace(situation, mask=mask, current=np.zeros(8000, np.int64)))
    np.testing.assert_allclose(np.bincount(goal, minlength=6) / 8000, [0.2, 0, 0.2, 0.2, 0.2, 0.2], atol=0.02)


def test_random_pellet_depends_on_tick_and_seed() -> None:
    situation = replace(random_situation(2, 200, pellets=20, allowed=1.0), current=np.full(200, -1))
    base = replace(situation, seed=np.full(200, 7, np.uint64), tick=np.zeros(200, np.int64))
    assert len(set(RandomPellet().select(base).tolist())) == 1
    for changed in (replace(base, seed=np.arange(200, dtype=np.uint64)), replace(base, tick=np.arange(200))):
        assert len(set(RandomPellet().select(changed).tolist())) == 20


def test_random_pellet_keeps_its_pellet_while_allowed() -> None:
    situation = random_situation(3, 300, allowed=0.6)
    games, current = np.arange(300), situation.current
    kept = (current >= 0) & situation.mask[games, current] & (situation.kind[games, current] == PELLET)
    goal = RandomPellet().select(situation)
    assert 0 < kept.sum() < 300
    assert (goal[kept] == current[kept]).all()
    assert (goal[~kept] != current[~kept]).any()
