"""A fragment depends on its task alone, not on who has played the games before, nor on who keeps them."""

import pickle
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

import torch

from pacman_env.executors.base import Executor, InProcess, InThreads
from pacman_env.executors.processes import LocalProcesses
from pacman_env.heuristics.simple import Nearest
from pacman_env.policies.base import Policy
from pacman_env.policies.learned import LearnedPlanner
from pacman_env.policies.opponents import BehaviourOpponent, Opponents
from pacman_env.training import fragments
from pacman_env.training.checkpoint import TorchPlanner
from pacman_env.training.collector import Collector
from pacman_env.training.fragments import Fragment, How, Task
from pacman_env.training.games import Part, make_ghost_parts, make_parts
from pacman_env.training.network import EntityNetwork
from pacman_env.training.ppo import PPO
from tests.training.planners import random_planner
from tests.training.test_arguments import tiny

ARGUMENTS = tiny(ghosts=["wander,learned", "chase"], games=4, n_steps=8, levels=4, league_every=1, teacher_nodes=221)
STEPS = 25


def network(seed: int = 0) -> EntityNetwork:
    return PPO(ARGUMENTS.hyper, seed).network


def content(fragment: Fragment) -> list[Any]:
    """All but the state, which is written in another order by another process."""
    numbers = [*fragment.situations, *fragment[1:6]]
    return [*(array.tobytes() for array in numbers), fragment.endings, fragment.agreed]


def played(parts: list[Part], hows: list[How], *, forgetful: bool) -> list[list[Any]]:
    """Of each part in turn, fragment by fragment."""
    found, model = [], network()
    for k, part in enumerate(parts):
        state: bytes | None = None
        for number, how in enumerate(hows):
            task = Task((-1, k), number, part, 3 + k, state, model, number, STEPS, how)
            if forgetful:
                fragments.forget()
                task = pickle.loads(pickle.dumps(task))
            fragment = fragments.play(task)
            state = fragment.state
            found.append(content(fragment))
    fragments.forget()
    return found


def planner_parts(tmp_path: Path) -> list[Part]:
    pool = Opponents([BehaviourOpponent("arcade"), LearnedPlanner(random_planner(tmp_path))], [1.0, 2.0])
    return make_parts(ARGUMENTS, 0, pool)


def ghost_parts(tmp_path: Path) -> list[Part]:
    arguments = tiny(ghosts=["learned"], games=4, n_steps=8, levels=2, league_every=1)
    robots: list[Policy] = [TorchPlanner("p", network(1), 0.3), LearnedPlanner(random_planner(tmp_path)), Nearest()]
    return [make_ghost_parts(arguments, 0, robot)[0] for robot in robots]


@pytest.mark.parametrize(
    ("make", "hows"), [(planner_parts, ["drawn", "taught", "labelled", "drawn"]), (ghost_parts, ["drawn"] * 3)]
)
def test_games_continue_bit_for_bit_in_another_process(make: Any, hows: list[How], tmp_path: Path) -> None:
    parts = make(tmp_path)
    kept, restored = (played(parts, hows, forgetful=forgetful) for forgetful in (False, True))
    assert kept == restored
    assert len({tuple(map(str, one)) for one in kept}) == len(kept)


def test_state_of_games_is_small(tmp_path: Path) -> None:
    """Levels are prepared again, policies made again."""
    part = planner_parts(tmp_path)[0]
    fragment = fragments.play(Task((-1, 0), 0, part, 3, None, network(), 0, STEPS, "drawn"))
    assert len(fragment.state) < 200_000
    assert b"onnx" not in fragment.state


def test_failed_part_starts_again_from_its_last_state() -> None:
    part, model = make_parts(tiny(), 0)[0], network()
    task = Task((-1, 0), 0, part, 3, None, model, 0, STEPS, "drawn")
    first = content(fragments.play(task))
    with torch.no_grad():
        broken = pickle.loads(pickle.dumps(model))
        broken.judge.weight.fill_(torch.nan)
    with pytest.raises(FloatingPointError, match="the training has diverged"):
        fragments.play(replace(task, network=broken))
    assert content(fragments.play(task)) == first
    fragments.forget()


def rows(executor: Executor, tmp_path: Path) -> list[list[Any]]:
    """Of several fragments, with a reset in between."""
    found, games, model = [], Collector(planner_parts(tmp_path), executor), network()
    for seed in (5, 6):
        games.reset(seed)
        for how in ("taught", "drawn", "drawn"):
            found += [content(fragment) for fragment in games.play(model, STEPS, how)]
        found.append([str(games.counts.best())])
    games.close()
    return found


def test_executors_do_not_change_a_bit(tmp_path: Path) -> None:
    with InProcess() as one, InThreads(3) as threads, LocalProcesses(2) as processes:
        alone, together, apart = (rows(executor, tmp_path) for executor in (one, threads, processes))
    assert alone == together == apart


def test_another_seed_plays_other_rounds() -> None:
    games, model = Collector(make_parts(tiny(), 0), InProcess()), network()
    found = []
    for seed in (1, 2, 1):
        games.reset(seed)
        found.append([content(fragment) for fragment in games.play(model, STEPS)])
    assert found[0] == found[2] != found[1]
    games.close()


def test_network_copy_has_same_weights_without_drawing_numbers() -> None:
    model = PPO(ARGUMENTS.hyper, 3, dropped_features=(4,), dropped_kinds=(1,)).network
    torch.manual_seed(0)
    expected = torch.rand(1)
    torch.manual_seed(0)
    copy = pickle.loads(pickle.dumps(model))
    assert torch.equal(torch.rand(1), expected)
    assert copy.dropped_kinds == (1,)
    for name, value in model.state_dict().items():
        assert torch.equal(value, copy.state_dict()[name]), name
    assert np.shares_memory(model.judge.weight.detach().numpy(), copy.judge.weight.detach().numpy()) is False


def test_ended_rounds_name_their_level() -> None:
    games = Collector(make_parts(tiny(levels=2), 0), InProcess())
    games.reset(0)
    levels = [ending.level for one in games.play(network(), 700) for ending in one.endings]
    assert set(levels) == {0, 1}
    games.close()
