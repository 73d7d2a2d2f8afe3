"""The example of robot and ghost that learn in turns: the games that each learns in, and what comes of both."""

import os
import subprocess
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

pytest.importorskip("sb3_contrib")

from stable_baselines3.common.vec_env import VecMonitor

from pacman_env import OUTCOMES, parallel_vec_env
from pacman_env.envs.arguments import EnvArguments
from pacman_env.episodes.rollout import play
from tests.pages import loaded

ROOT = Path(__file__).resolve().parents[2]
FILE = ROOT / "docs" / "examples" / "two_players.py"
SETTINGS: dict[str, Any] = {"observation.mask": "method", "time_limit_s": 40.0}


@pytest.fixture(scope="module")
def example() -> ModuleType:
    return loaded(FILE)


def games(number: int, **more: Any) -> Any:
    return parallel_vec_env(number, map="loop", flat=True, settings=SETTINGS, **more)


def test_rules_play_same_rounds_against_wandering_ghost(example: ModuleType) -> None:
    env = games(6, autoreset_mode="Disabled")
    _, infos = env.reset(seed=5)
    last = example.rounds(env, (example.rule("nearest"), example.wander), 5)
    arguments = EnvArguments(map="loop", settings={"time_limit_s": 40.0})
    config, _ = arguments.make_config()
    records, _ = play(arguments.make_source(config), config, "nearest", infos["round_seed"])
    assert last["outcome"].tolist() == records["end"].tolist()
    assert last["collected"].tolist() == records["collected"].tolist()


@pytest.mark.parametrize("side", [0, 1])
def test_one_side_plays_game_with_actions_of_rival(side: int, example: ModuleType) -> None:
    plain, masks = games(3), np.zeros((3, 1))
    env = VecMonitor(example.OneSide(games(3), side, lambda _, seen, masks: masks.argmax(axis=1)))
    agent = env.venv.games.possible_agents[side]
    env.seed(9)
    seen, (expected, _) = env.reset(), plain.reset(seed=9)
    finished = 0
    for _ in range(85):
        masks = plain.action_masks()
        assert np.array_equal(seen, expected[agent])
        assert np.array_equal(np.stack(env.env_method("action_masks")), masks[:, side])
        expected, rewards, terminated, _, infos = plain.step(masks.argmax(axis=2))
        seen, reward, dones, rows = env.step(masks[:, side].argmax(axis=1))
        assert np.array_equal(reward, rewards[:, side].astype(np.float32))
        assert np.array_equal(dones, terminated)
        for i in np.flatnonzero(dones).tolist():
            finished += 1
            assert np.array_equal(rows[i]["terminal_observation"], infos["final_observation"][i][agent])
            assert not rows[i]["TimeLimit.truncated"]
            assert rows[i]["episode"]["l"] <= 80
    assert finished >= 3
    env.close()


def test_ghost_wanders_in_half_of_games(example: ModuleType) -> None:
    masks = np.ones((5, 4), dtype=np.bool_)
    act = example.half_wandering(lambda _, __, masks: np.ones(len(masks), dtype=np.int64))
    assert act(games(1), {}, masks).tolist() == [3, 3, 1, 1, 1]


def test_both_sides_learn_reproducibly_by_seed(example: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = {**example.ARGUMENTS["settings"], "time_limit_s": 15.0}
    monkeypatch.setattr(example, "ARGUMENTS", {**example.ARGUMENTS, "map": "loop", "settings": settings})
    monkeypatch.setattr(example, "GAMES", 2)

    def reached(seed: int) -> list[list[dict[str, Any]]]:
        return [*example.alternate(2, 128, 2, seed, n_steps=16)]

    first = reached(1)
    assert first == reached(1)
    assert first != reached(2)
    pairs = [(row["robot"], row["ghost"]) for row in first[-1]]
    robots = ("learned", "nearest", "random_pellet")
    assert pairs == [(robot, ghost) for robot in robots for ghost in ("wander", "learned")]
    for row in first[-1]:
        assert row["running"] == 0
        assert sum(row[name] for name in OUTCOMES) == 2
        assert 0 <= row["pellets"] <= 1


@pytest.mark.daily
def test_script_prints_every_pair_after_each_turn() -> None:
    words = ["--turns", "1", "--decisions", "1", "--rounds", "2"]
    done = subprocess.run(
        [sys.executable, "-W", "error", str(FILE), *words],
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("turn 1\n")
    assert done.stdout.count("completed") == 6
