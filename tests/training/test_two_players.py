from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from stable_baselines3.common.vec_env import VecMonitor

from pacman_env import parallel_vec_env
from pacman_env.envs.arguments import EnvArguments
from pacman_env.episodes.rollout import play
from pacman_env.training.baselines import Baseline, Environment, Hyperparameters
from pacman_env.training.two_players import OneSide, alternate, half_wandering, rounds, rule, wander

SETTINGS: dict[str, Any] = {"observation.mask": "method", "time_limit_s": 40.0}
TINY = Baseline(
    environment=Environment(map="loop", flat=True, settings={**SETTINGS, "time_limit_s": 15.0}),
    games=2,
    decisions=128,
    turns=2,
    normalize=True,
    test="loop",
    hyperparameters=Hyperparameters(n_steps=16, batch_size=16, n_epochs=1),
)


def games(number: int, **more: Any) -> Any:
    return parallel_vec_env(number, map="loop", flat=True, settings=SETTINGS, **more)


def test_rules_play_the_rounds_that_they_play_against_a_ghost_that_wanders() -> None:
    env = games(6, autoreset_mode="Disabled")
    _, infos = env.reset(seed=5)
    last = rounds(env, (rule("nearest"), wander), 5)
    arguments = EnvArguments(map="loop", settings={"time_limit_s": 40.0})
    config, _ = arguments.make_config()
    records, _ = play(arguments.make_source(config), config, "nearest", infos["round_seed"])
    assert last["outcome"].tolist() == records["end"].tolist()
    assert last["collected"].tolist() == records["collected"].tolist()


@pytest.mark.parametrize("side", [0, 1])
def test_one_side_is_the_game_with_the_rivals_actions(side: int) -> None:
    plain, masks = games(3), np.zeros((3, 1))
    env = VecMonitor(OneSide(games(3), side, lambda _, seen, masks: masks.argmax(axis=1)))
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


def test_in_half_of_the_games_the_ghost_wanders() -> None:
    masks = np.ones((5, 4), dtype=np.bool_)
    act = half_wandering(lambda _, __, masks: np.ones(len(masks), dtype=np.int64))
    assert act(games(1), {}, masks).tolist() == [3, 3, 1, 1, 1]


def test_both_learn_and_the_same_seed_learns_the_same() -> None:
    first, again, other = ([*alternate(TINY, seed, 2, 100)] for seed in (1, 1, 2))
    for points in (first, again, other):
        for point in points:
            assert point.pop("learning_s") > 0
    assert first == again
    assert [point["decisions"] for point in first] == [64, 128]
    assert first != other
    pairs = [(row["robot"], row["ghost"]) for row in first[-1]["pairs"]]
    assert pairs == [(robot, ghost) for robot in ("learned", "nearest", "random") for ghost in ("wander", "learned")]
    for row in first[-1]["pairs"]:
        low, high = row["caught_interval"]
        assert 0 <= low <= row["caught"] <= high <= 1
