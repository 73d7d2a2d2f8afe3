"""The league has one more Clyde after every so many segments; those to which the planner loses are met more often."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

from pacman_env.episodes.rollout import episode_seeds
from pacman_env.heuristics.simple import Nearest
from pacman_env.policies.learned import LearnedPlanner
from pacman_env.policies.metadata import read_planner
from pacman_env.training import league as module
from pacman_env.training.arguments import Arguments
from pacman_env.training.league import League, clyde_arguments
from pacman_env.training.ppo import train_clyde
from tests.training.planners import random_planner
from tests.training.test_arguments import tiny

SEEDS = episode_seeds(0, 4000)


def arguments(**changes: Any) -> Arguments:
    return tiny(**{"ghosts": ["learned"], "league_every": 2, "levels": 2} | changes)


def test_league_adds_member_after_configured_number_of_segments(tmp_path: Path) -> None:
    league = League(arguments(out=tmp_path))
    assert [segment for segment in range(7) if league.is_due(segment)] == [2, 4, 6]
    assert [len(league.names(segment)) for segment in range(7)] == [0, 0, 1, 1, 2, 2, 3]
    assert League(tiny(tmp_path)).names(9) == []
    assert not League(tiny(tmp_path)).is_due(2)


def test_rules_play_while_league_has_no_members(tmp_path: Path) -> None:
    pool = League(arguments(out=tmp_path)).pool(1, {})
    assert [member.name for member in pool.members] == ["arcade", "chase"]


def test_members_are_drawn_by_how_often_they_win(tmp_path: Path) -> None:
    league = League(arguments(out=tmp_path))
    for name in ("clyde-1", "clyde-2"):
        random_planner(tmp_path, name)
    pool = league.pool(4, {"clyde-1": (8, 8), "clyde-2": (0, 8)})  # weights 1/10 and 9/10
    assert np.bincount(pool.drawn(SEEDS)) / len(SEEDS) == pytest.approx([0.1, 0.9], abs=0.03)
    unknown = league.pool(4, {"clyde-1": (2, 6)})  # 5/8 and, of which nothing is known, 1/2
    assert np.bincount(unknown.drawn(SEEDS)) / len(SEEDS) == pytest.approx([5 / 9, 4 / 9], abs=0.03)


def test_rounds_are_counted_for_the_playing_member(tmp_path: Path) -> None:
    league = League(arguments(out=tmp_path))
    for name in ("clyde-1", "clyde-2"):
        random_planner(tmp_path, name)
    pool = league.pool(4, {})
    drawn = pool.drawn(SEEDS[:40])
    found = league.record(4, SEEDS[:40], drawn == 1, pool)
    ones = int(drawn.sum())
    assert found == {"clyde-1": (0, 40 - ones), "clyde-2": (ones, ones)}


def test_member_is_trained_reproducibly_against_planner(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_GAMES", 4)
    monkeypatch.setattr(module, "_DECISIONS", 16)
    monkeypatch.setattr(module, "_STEPS", 8)
    contents = []
    for number in range(2):
        folder = tmp_path / str(number)
        league = League(arguments(out=folder))
        for segment in (2, 4):
            train_clyde(league, segment, Nearest())
        contents.append([league.path(name).read_bytes() for name in league.names(4)])
    assert contents[0] == contents[1]
    assert contents[0][0] != contents[0][1]
    metadata = read_planner(tmp_path / "0" / "clyde-2.onnx")[0]
    assert metadata.training.ghosts == ("learned",)
    assert metadata.training.clyde_speeds_mps == (0.1, 0.35)
    assert metadata.training.decisions == 32  # a whole rollout
    assert isinstance(league.pool(4, {}).members[0], LearnedPlanner)


def test_ghost_learns_at_its_own_speeds() -> None:
    hyper = clyde_arguments(arguments()).hyper
    assert (hyper.clyde_speed, hyper.ghosts, hyper.imitation) == ((0.1, 0.35), ("learned",), 0)
