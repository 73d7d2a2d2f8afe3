"""Policies that play ghosts in the environments: what they see, when they have to forget, and that they are obeyed."""

from typing import Any

import numpy as np
import pytest

import pacman_env
from pacman_env.config import Config, ConfigError
from pacman_env.envs.pettingzoo_env import PACMAN
from pacman_env.observations.situation import Situation
from pacman_env.policies.base import BasePolicy
from pacman_env.policies.registry import make_policy
from tests.envs.helpers import QUICK, make, make_vector, same

FAST_GHOSTS = {**QUICK, "clyde.speed_mps": 0.8}


class Sentinel:
    """Sends its ghost to one place after the other, and writes down what it sees and when it has to forget."""

    name = "sentinel"

    def __init__(self) -> None:
        self.seen: list[Situation] = []
        self.resets: list[list[bool]] = []

    def reset(self, games: np.ndarray, config: Config) -> None:
        self.resets.append(games.tolist())

    def select(self, situation: Situation) -> np.ndarray:
        self.seen.append(situation)
        return np.full(len(situation), len(self.seen) // 5 % situation.mask.shape[1])


def test_policy_observes_game_as_its_own_ghost() -> None:
    policy = Sentinel()
    env = make(ghosts=["wander", policy], settings=QUICK)  # type: ignore[list-item]
    env.reset(seed=0)
    told = [-1]
    for _ in range(30):
        env.step(0)
        seen = policy.seen[-1]
        np.testing.assert_array_equal(seen.clyde, seen.ghosts[:, 1, :2])
        assert seen.current[0] == told[-1]
        assert seen.mask[0, -1]
        told.append(int(len(policy.seen) // 5 % seen.mask.shape[1]))
        if env.batch.games["end"][0] or told[-1] == seen.mask.shape[1] - 1:
            break
    assert len(told) > 10


@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_policy_is_reset_for_every_new_episode(mode: str) -> None:
    policy = Sentinel()
    env = make_vector(5, ghosts=["wander", policy], settings=FAST_GHOSTS, autoreset_mode=mode)
    env.reset(seed=0)
    assert policy.resets == [[True] * 5]
    episodes, ended_before = np.ones(5, dtype=int), np.zeros(5, dtype=bool)
    for k in range(80):
        _, _, terminated, truncated, _ = env.step(np.full(5, k % 4))
        ended = terminated | truncated
        episodes += ended if mode == "SameStep" else ended_before
        ended_before = ended
        np.testing.assert_array_equal(policy.seen[-1].clyde, policy.seen[-1].ghosts[:, 1, :2])
    assert len(policy.seen) == 80
    assert episodes.min() > 1
    assert len(set(episodes)) > 1
    np.testing.assert_array_equal(np.sum(policy.resets, axis=0), episodes)


def test_ghost_moves_alike_for_policy_and_agent() -> None:
    inside = make(ghosts=[Sentinel(), "chase"], settings=QUICK)  # type: ignore[list-item]
    outside = pacman_env.parallel_env(ghosts=("policy", "chase"), settings=QUICK)
    assert same(inside.reset(seed=5)[0], outside.reset(seed=5)[0][PACMAN])
    for k in range(1, 40):
        results = outside.step({PACMAN: k % 3, "clyde": k // 5 % inside.batch.candidates})
        assert same(inside.step(k % 3), tuple(result[PACMAN] for result in results))
        if not outside.agents:
            break
    assert k > 10


def test_policy_and_agent_may_play_different_ghosts() -> None:
    policy = Sentinel()
    env = pacman_env.parallel_env(ghosts=[policy, "policy"])
    assert env.possible_agents == [PACMAN, "blinky"]
    env.reset(seed=0)
    env.step({PACMAN: 0, "blinky": 0})
    assert len(policy.seen) == 1


class Returns(BasePolicy):
    """Selects whatever it was given."""

    name = "returns"

    def __init__(self, value: Any) -> None:
        self._value = value

    def select(self, situation: Situation) -> Any:
        return self._value


@pytest.mark.parametrize("value", [3, None, np.array([2.7]), np.array([1, 2])])
def test_wrong_choice_is_refused_with_number_of_ghost(value: Any) -> None:
    env = make(ghosts=["wander", Returns(value)])
    env.reset(seed=0)
    before = env.batch.games.copy()
    with pytest.raises(ValueError, match=r"ghosts\[1\]: select must return 1 integers"):
        env.step(0)
    np.testing.assert_array_equal(env.batch.games, before)


@pytest.mark.parametrize("ghost", [Returns, 3.5])
def test_wrong_policy_object_is_refused(ghost: Any) -> None:
    with pytest.raises(ConfigError, match=r"ghosts\[0\] = .*an object with reset and select"):
        make(ghosts=(ghost,))


def test_policy_name_plays_like_policy_object() -> None:
    named, given = (make(ghosts=("wander", one), settings=QUICK) for one in ("nearest", make_policy("nearest")))
    assert same(named.reset(seed=0), given.reset(seed=0))
    for _ in range(20):
        assert same(named.step(0), given.step(0))
    assert named.config.clyde.ghosts == ("wander", "policy")
