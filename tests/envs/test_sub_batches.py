"""``send`` and ``recv``: the games in sub-batches, one of which is stepped while somebody chooses for another."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest

from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv
from pacman_env.policies.base import BasePolicy
from tests.envs.helpers import same

ARGUMENTS: list[dict[str, Any]] = [
    {"map": "house", "ghosts": ("chase", "wander"), "autoreset_mode": "SameStep", "max_episode_steps": 5},
    {
        "map": "generated",
        "settings": {"num_levels": 10, "decisions.when": "event", "observation.normalize": True},
        "observation": ("planner", "flat"),
    },
    {"map": "maze", "action": "velocity", "autoreset_mode": "SameStep", "max_episode_steps": 7},
]
#: Of two of four games, and of all.
HALF, ALL = np.zeros(2, dtype=np.int64), np.zeros(4, dtype=np.int64)


def make(size: int | None = 2, games: int = 4, **arguments: Any) -> PacManBotVectorEnv:
    return PacManBotVectorEnv(games, batch_size=size, **{"map": "house", **arguments})


def rows(data: Any, k: int) -> Any:
    """Return the part of the k-th two games."""
    if isinstance(data, dict):
        return {key: value[2 * k : 2 * k + 2] for key, value in data.items()}
    return data[2 * k : 2 * k + 2]


@pytest.mark.parametrize(("threads", "arguments"), list(zip((1, 3, 1), ARGUMENTS, strict=True)))
def test_sub_batches_play_the_same_games(arguments: dict[str, Any], threads: int) -> None:
    whole, parts = make(None, 6, **arguments), make(2, 6, num_threads=threads, **arguments)
    assert parts.observation_space == whole.observation_space
    expected, _ = whole.reset(seed=3)
    parts.async_reset(seed=3)
    for k, (observation, *numbers, info) in enumerate([parts.recv() for _ in range(3)]):
        assert info["env_id"].tolist() == [2 * k, 2 * k + 1]
        assert same(observation, rows(expected, k))
        assert not any(array.any() for array in numbers)
    whole.action_space.seed(1)
    for _ in range(25):
        actions = whole.action_space.sample()
        *expected, info = whole.step(actions)
        for k in range(3):
            parts.send(actions[2 * k : 2 * k + 2], np.array([2 * k, 2 * k + 1]))
        for k in range(3):
            *seen, told = parts.recv()
            assert same(seen, [rows(part, k) for part in expected])
            np.testing.assert_array_equal(told["collected"], rows(info["collected"], k))
    parts.close()


@pytest.mark.parametrize("arguments", ARGUMENTS)
def test_step_and_reset_join_sub_batches(arguments: dict[str, Any]) -> None:
    whole, parts = (make(size, **arguments) for size in (None, 2))
    (observation, info), (known, facts) = parts.reset(seed=0), whole.reset(seed=0)
    whole.action_space.seed(0)
    assert same(observation, known)
    for _ in range(20):
        assert all(same(info[key], facts[key]) for key in facts)
        actions = whole.action_space.sample()
        *expected, facts = whole.step(actions)
        *got, info = parts.step(actions)
        assert same(got, expected)
    parts.close()


def test_one_sub_batch_is_the_default() -> None:
    env = make(None)
    env.async_reset(seed=0)
    assert env.recv()[4]["env_id"].tolist() == [0, 1, 2, 3]
    env.send(ALL)
    assert env.recv()[1].shape == (4,)
    env.close()


def test_masks_and_situation_match_received_sub_batch() -> None:
    env, whole = make(), make(None)
    env.async_reset(seed=0)
    for _ in range(2):
        info = env.recv()[4]
        assert env.situation.seed.tolist() == info["round_seed"].tolist()
        assert env.action_masks().shape == (2, env.batch.candidates)
    for one in (env, whole):
        one.reset(seed=1)
    np.testing.assert_array_equal(env.action_masks(), whole.action_masks())  # of all
    _, _, _, _, info = env.step(ALL)
    whole.step(ALL)
    np.testing.assert_array_equal(env.action_masks(), whole.action_masks())
    assert env.situation.seed.tolist() == info["round_seed"][2:].tolist()
    env.send(HALF, np.array([0, 1]))
    env.recv()
    assert env.action_masks().shape == (2, env.batch.candidates)
    env.close()


def test_wrong_send_is_refused_and_steps_nothing() -> None:
    env = make()
    with pytest.raises(gym.error.ResetNeeded, match=r"async_reset\(\) first"):
        env.send(HALF)
    with pytest.raises(ValueError, match=r"nothing is being stepped: send\(\) first"):
        env.recv()
    env.async_reset(seed=0)
    env.recv()
    for actions, games, message in (
        (HALF, [2, 3], r"games \[2, 3\] are being stepped"),
        (HALF, [0, 2], "env_id = .*must be the games of one sub-batch"),
        (np.array([0, 1000]), [0, 1], "choice 1000 of game 1: candidates are 0 to"),
    ):
        with pytest.raises(ValueError, match=message):
            env.send(actions, np.array(games))
    with pytest.raises(ValueError, match=r"1 sub-batches are being stepped"):
        env.step(ALL)
    env.recv()
    env.step(ALL)
    env.close()


@pytest.mark.parametrize("size", [None, 2])
def test_reset_discards_running_steps(size: int | None) -> None:
    env, other = make(size), make(size)
    env.async_reset(seed=0)
    env.recv()
    env.send(np.zeros(size or 4, dtype=np.int64))
    with pytest.raises(ValueError, match=r"are being stepped: recv\(\) them before step\(\)"):
        env.step(ALL)
    assert same(env.reset(seed=5)[0], other.reset(seed=5)[0])
    with pytest.raises(ValueError, match=r"nothing is being stepped"):
        env.recv()
    assert same(env.step(ALL)[0], other.step(ALL)[0])
    env.close()


def test_refused_velocity_steps_no_sub_batch() -> None:
    env, other = (make(size, action="velocity") for size in (2, None))
    for one in (env, other):
        one.reset(seed=0)
    bad, good = np.full((4, 2), 0.1), np.full((4, 2), 0.1)
    bad[3, 0] = np.nan
    for step in (lambda: env.step(bad), lambda: env.send(bad[2:], np.array([2, 3]))):
        with pytest.raises(ValueError, match=r"of game 1: must be two finite numbers"):
            step()
    assert same(env.step(good)[0], other.step(good)[0])
    env.close()


def test_views_are_overwritten_two_steps_later() -> None:
    copies, views = (make(None, copy=one) for one in (True, False))
    copies.reset(seed=0)
    observations: list[Any] = [views.reset(seed=0)[0]]
    for k in range(8):
        expected, *_ = copies.step(np.full(4, k % 4))
        seen, *_ = views.step(np.full(4, k % 4))
        assert same(seen, expected)
        observations.append(dict(seen))
    for before, after in zip(observations[2:], observations[4:], strict=False):
        assert np.shares_memory(before["candidates"], after["candidates"])
    assert not np.shares_memory(observations[-1]["candidates"], observations[-2]["candidates"])


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


def test_ghost_with_memory_plays_same_in_sub_batches() -> None:
    seen = []
    for size in (None, 2):
        env = make(size, ghosts=[Turns()])
        env.reset(seed=0)
        seen.append([env.step(np.arange(4))[0]["clyde"] for _ in range(20)])
        env.close()
    np.testing.assert_array_equal(*seen)
