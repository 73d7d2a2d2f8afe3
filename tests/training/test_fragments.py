"""A fragment depends on its part, its seed and the network, not on the thread that plays it."""

import copy
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

import torch

from pacman_env.executors.executor import Executor, InProcess, InThreads
from pacman_env.heuristics.simple import Nearest
from pacman_env.policies.learned import LearnedPlanner
from pacman_env.policies.opponents import BehaviourOpponent, Opponents
from pacman_env.training.collector import Collector
from pacman_env.training.fragments import Fragment, How
from pacman_env.training.network import EntityNetwork
from pacman_env.training.ppo import PPO
from pacman_env.training.games import Games, make_ghost_parts, make_parts
from tests.training.planners import random_planner
from tests.training.test_arguments import tiny

ARGUMENTS = tiny(ghosts=["wander,learned", "chase"], games=4, n_steps=8, levels=4, league_every=1, teacher_nodes=221)
STEPS = 5


def network(seed: int = 0) -> EntityNetwork:
    return PPO(ARGUMENTS.hyper, seed).network


def content(fragment: Fragment) -> list[Any]:
    return [*(array.tobytes() for array in (*fragment.situations, *fragment[1:6])), fragment.endings, fragment.agreed]


def planner_parts(tmp_path: Path) -> Sequence[Games]:
    pool = Opponents([BehaviourOpponent("arcade"), LearnedPlanner(random_planner(tmp_path))], [1.0, 2.0])
    return make_parts(ARGUMENTS, 0, pool)


def played(parts: Sequence[Games], executor: Executor, hows: tuple[How, ...], *seeds: int) -> list[list[Any]]:
    """Play several fragments with each seed; return their contents."""
    found, games, model = [], Collector(parts, executor), network()
    for seed in seeds:
        games.reset(seed)
        found.append([content(fragment) for how in hows for fragment in games.play(model, STEPS, how)])
    return found


def test_threads_do_not_change_a_bit(tmp_path: Path) -> None:
    ghosts = make_ghost_parts(tiny(ghosts=["learned"], games=4, n_steps=8, levels=2, league_every=1), 0, Nearest())
    cases: list[tuple[Sequence[Games], tuple[How, ...]]]
    cases = [(planner_parts(tmp_path), ("taught", "labelled", "drawn")), (ghosts, ("drawn", "drawn"))]
    with InThreads(3) as threads:
        for parts, hows in cases:
            other, first = played(parts, InProcess(), hows, 6, 5)
            assert played(parts, threads, hows, 5) == [first]
            assert first != other


def test_diverged_network_is_refused() -> None:
    broken = copy.deepcopy(network())
    with torch.no_grad():
        broken.judge.weight.fill_(torch.nan)
    with pytest.raises(FloatingPointError, match="the training has diverged"):
        Collector(make_parts(tiny(), 0), InProcess()).play(broken, STEPS)


def test_ended_rounds_name_their_level() -> None:
    games = Collector(make_parts(tiny(levels=2), 0), InProcess())
    levels = [ending.level for one in games.play(network(), 700) for ending in one.endings]
    assert set(levels) == {0, 1}
