"""``send`` and ``recv``: the games in sub-batches, one of which is stepped while somebody chooses for another."""

from __future__ import annotations

import copy
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv
from pacman_env.policies.base import BasePolicy
from tests.envs.helpers import same

ARGUMENTS: list[dict[str, Any]] = [
    {"map": "house"},
    {
        "map": "generated",
        "settings": {"num_levels": 40, "decisions.when": "event", "observation.normalize": True},
        "observation": ("planner", "flat"),
    },
    {"map": "maze", "action": "velocity", "autoreset_mode": "SameStep", "max_episode_steps": 7},
    {"map": "house", "ghosts": ("chase", "wander"), "autoreset_mode": "SameStep", "max_episode_steps": 5},
]


def actions_of(env: PacManBotVectorEnv, rng: np.random.Generator) -> np.ndarray:
    if env.config.action == "velocity":
        return rng.uniform(0.0, 0.3, (env.num_envs, 2))
    return rng.integers(0, env.single_action_space.n, env.num_envs)  # type: ignore[union-attr]


@pytest.mark.parametrize("arguments", ARGUMENTS)
@pytest.mark.parametrize("threads", [1, 3])
def test_games_in_sub_batches_are_the_same_games(arguments: dict[str, Any], threads: int) -> None:
    whole = PacManBotVectorEnv(6, **arguments)
    parts = PacManBotVectorEnv(6, batch_size=2, num_threads=threads, **arguments)
    assert parts.observation_space == whole.observation_space
    expected, _ = whole.reset(seed=3)
    parts.async_reset(seed=3)
    first = [parts.recv() for _ in range(3)]
    assert [step[4]["env_id"].tolist() for step in first] == [[0, 1], [2, 3], [4, 5]]
    for k, (observation, reward, terminated, truncated, _) in enumerate(first):
        mine = np.s_[2 * k : 2 * k + 2]
        rows = {key: a[mine] for key, a in expected.items()} if isinstance(expected, dict) else expected[mine]
        assert same(observation, rows)
        assert [reward.any(), terminated.any(), truncated.any()] == [False] * 3
    rng = np.random.default_rng(1)
    for _ in range(25):
        actions = actions_of(whole, rng)
        expected, reward, terminated, truncated, info = whole.step(actions)
        for k in range(3):
            parts.send(actions[2 * k : 2 * k + 2], np.array([2 * k, 2 * k + 1]))
        for k in range(3):
            mine = np.s_[2 * k : 2 * k + 2]
            seen = parts.recv()
            rows = {key: a[mine] for key, a in expected.items()} if isinstance(expected, dict) else expected[mine]
            assert same(seen[0], rows)
            for array, all_of_them in zip(seen[1:4], (reward, terminated, truncated), strict=True):
                np.testing.assert_array_equal(array, all_of_them[mine])
            np.testing.assert_array_equal(seen[4]["collected"], info["collected"][mine])
    parts.close()


@pytest.mark.parametrize("arguments", ARGUMENTS)
def test_step_and_reset_of_all_sub_batches_are_those_of_one_environment(arguments: dict[str, Any]) -> None:
    whole, parts = (PacManBotVectorEnv(4, batch_size=size, **arguments) for size in (None, 2))
    rng = np.random.default_rng(0)
    observation, info = parts.reset(seed=0)
    known, facts = whole.reset(seed=0)
    assert same(observation, known)
    assert all(same(info[key], facts[key]) for key in facts)
    for _ in range(20):
        actions = actions_of(whole, rng)
        *expected, facts = whole.step(actions)
        *got, info = parts.step(actions)
        assert all(same(a, b) for a, b in zip(got, expected, strict=True))
        assert all(same(info[key], facts[key]) for key in facts)
    parts.close()


def test_without_a_batch_size_all_games_are_one_sub_batch() -> None:
    env = PacManBotVectorEnv(3, map="house")
    env.async_reset(seed=0)
    assert env.recv()[4]["env_id"].tolist() == [0, 1, 2]
    env.send(np.zeros(3, dtype=np.int64))
    assert env.recv()[1].shape == (3,)
    env.close()


def test_the_situation_is_that_of_the_sub_batch_received_last() -> None:
    env = PacManBotVectorEnv(4, map="house", batch_size=2)
    env.async_reset(seed=0)
    for _ in range(2):
        info = env.recv()[4]
        assert env.situation.seed.tolist() == info["round_seed"].tolist()
        assert env.action_masks().shape == (2, env.batch.candidates)
    env.close()


def test_what_cannot_be_sent_is_refused_and_nothing_is_stepped() -> None:
    env = PacManBotVectorEnv(4, map="house", batch_size=2)
    with pytest.raises(gym.error.ResetNeeded, match=r"async_reset\(\) first"):
        env.send(np.zeros(2, dtype=np.int64))
    with pytest.raises(ValueError, match=r"nothing is being stepped: send\(\) first"):
        env.recv()
    env.async_reset(seed=0)
    env.recv()
    with pytest.raises(ValueError, match=r"games \[2, 3\] are being stepped"):
        env.send(np.zeros(2, dtype=np.int64), np.array([2, 3]))
    with pytest.raises(ValueError, match=r"env_id = .*must be the games of one sub-batch"):
        env.send(np.zeros(2, dtype=np.int64), np.array([0, 2]))
    with pytest.raises(ValueError, match=r"choice 1000 of game 1: candidates are 0 to"):
        env.send(np.array([0, 1000]), np.array([0, 1]))
    with pytest.raises(ValueError, match=r"1 sub-batches are being stepped"):
        env.step(np.zeros(4, dtype=np.int64))
    env.recv()
    env.step(np.zeros(4, dtype=np.int64))
    env.close()


@pytest.mark.parametrize("size", [0, 3, 1.5, True])
def test_a_batch_size_that_does_not_divide_the_games_is_refused(size: Any) -> None:
    with pytest.raises(ValueError, match=r"batch_size = .*must be a whole number that divides num_envs = 4"):
        PacManBotVectorEnv(4, map="house", batch_size=size)


def test_a_copy_of_sub_batches_goes_on_alike() -> None:
    env = PacManBotVectorEnv(4, map="house", batch_size=2)
    env.reset(seed=0)
    for _ in range(5):
        env.step(np.full(4, 2))
    other = copy.deepcopy(env)
    for _ in range(5):
        assert all(same(a, b) for a, b in zip(env.step(np.full(4, 3)), other.step(np.full(4, 3)), strict=True))
    env.close()
    other.close()


def test_without_copies_the_same_memory_is_written_by_the_step_after_the_next() -> None:
    copies, views = (PacManBotVectorEnv(3, map="house", copy=one) for one in (True, False))
    observations: list[Any] = []
    copies.reset(seed=0)
    observations.append(views.reset(seed=0)[0])
    for k in range(8):
        expected, *_ = copies.step(np.full(3, k % 4))
        seen, *_ = views.step(np.full(3, k % 4))
        assert same(seen, expected)
        observations.append(dict(seen))
    for before, after in zip(observations[2:], observations[4:], strict=False):
        assert np.shares_memory(before["candidates"], after["candidates"])
    assert not np.shares_memory(observations[-1]["candidates"], observations[-2]["candidates"])


@pytest.mark.parametrize("size", [None, 2])
def test_what_is_being_stepped_is_not_stepped_twice_and_a_reset_drops_it(size: int | None) -> None:
    env, other = (PacManBotVectorEnv(4, map="house", batch_size=size) for _ in range(2))
    env.async_reset(seed=0)
    env.recv()
    env.send(np.zeros(size or 4, dtype=np.int64))
    with pytest.raises(ValueError, match=r"are being stepped: recv\(\) them before step\(\)"):
        env.step(np.zeros(4, dtype=np.int64))
    assert same(env.reset(seed=5)[0], other.reset(seed=5)[0])
    with pytest.raises(ValueError, match=r"nothing is being stepped"):
        env.recv()
    assert same(env.step(np.ones(4, dtype=np.int64))[0], other.step(np.ones(4, dtype=np.int64))[0])
    env.close()


def test_after_a_reset_or_step_of_all_the_masks_are_of_all_and_the_rest_of_the_sub_batch_received_last() -> None:
    env = PacManBotVectorEnv(4, map="house", batch_size=2)
    whole = PacManBotVectorEnv(4, map="house")
    for one in (env, whole):
        one.reset(seed=1, options={"settings": {"clyde.speed_mps": 0.4}})
    assert env.config.clyde.speed_mps == 0.4
    np.testing.assert_array_equal(env.action_masks(), whole.action_masks())
    _, _, _, _, info = env.step(np.zeros(4, dtype=np.int64))
    whole.step(np.zeros(4, dtype=np.int64))
    np.testing.assert_array_equal(env.action_masks(), whole.action_masks())
    assert env.situation.seed.tolist() == info["round_seed"][2:].tolist()
    env.send(np.zeros(2, dtype=np.int64), np.array([0, 1]))
    env.recv()
    assert env.action_masks().shape == (2, env.batch.candidates)
    env.close()


@pytest.mark.parametrize("options", [{"settings": {"clyde.speed_mps": -4}}, {"level": 3}, {"round_seed": [1, 2]}])
def test_a_reset_that_is_refused_changes_nothing(options: dict[str, Any]) -> None:
    env, other = (PacManBotVectorEnv(4, map="house", batch_size=size) for size in (2, None))
    for one in (env, other):
        one.reset(seed=0)
    with pytest.raises(ValueError, match=r"speed_mps|levels are for|2 numbers for 4 games"):
        env.reset(seed=9, options=options)
    with pytest.raises(gym.error.Error, match="-3"):
        env.reset(seed=[0, 1, 2, -3])
    assert same(env.step(np.zeros(4, dtype=np.int64))[0], other.step(np.zeros(4, dtype=np.int64))[0])
    env.close()


def test_each_game_gets_the_round_seed_that_was_given_for_it() -> None:
    env = PacManBotVectorEnv(4, map="house", batch_size=2)
    _, info = env.reset(options={"round_seed": [4, 5, 6, 7]})
    assert info["round_seed"].tolist() == [4, 5, 6, 7]
    env.close()


def test_velocities_that_are_not_finite_are_refused_before_anything_is_stepped() -> None:
    env, other = (PacManBotVectorEnv(4, map="house", action="velocity", batch_size=size) for size in (2, None))
    for one in (env, other):
        one.reset(seed=0)
    bad, good = np.full((4, 2), 0.1), np.full((4, 2), 0.1)
    bad[1, 0] = np.nan
    with pytest.raises(ValueError, match=r"of game 1: must be two finite numbers"):
        env.step(bad)
    with pytest.raises(ValueError, match=r"of game 1: must be two finite numbers"):
        env.send(bad[:2], np.array([0, 1]))
    assert same(env.step(good)[0], other.step(good)[0])
    env.close()


class Turns(BasePolicy):
    """A ghost's policy that remembers something of each game."""

    name = "turns"
    counts = np.zeros(0, dtype=np.int64)

    def reset(self, games: Any, config: Any) -> None:
        super().reset(games, config)
        if len(self.counts) != len(games):
            self.counts = np.zeros(len(games), dtype=np.int64)
        self.counts[games] = 0

    def scores(self, situation: Any) -> Any:
        self.counts = self.counts + 1
        return -np.abs(np.arange(situation.mask.shape[1])[None] - (self.counts // 3 % 5)[:, None])


def test_a_ghost_that_remembers_plays_the_same_games_in_sub_batches() -> None:
    seen = []
    for size in (None, 2):
        env = PacManBotVectorEnv(4, map="house", ghosts=[Turns()], batch_size=size)
        env.reset(seed=0)
        seen.append([env.step(np.array([0, 1, 2, 3]))[0]["clyde"] for _ in range(20)])
        env.close()
    np.testing.assert_array_equal(*seen)
