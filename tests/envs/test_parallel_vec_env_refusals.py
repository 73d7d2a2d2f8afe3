"""What the batched environment of several agents refuses: arguments, actions and resets; nothing changes then."""

from __future__ import annotations

import re
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import pacman_env
from pacman_env.config import Config, ConfigError
from pacman_env.envs.parallel_vec_env import PACMAN
from tests.envs.helpers import same
from tests.envs.test_parallel_vec_env import GAMES, actions_of, make


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"num_envs": 0}, ValueError, "num_envs = 0: must be a whole number of at least 1"),
        ({"num_envs": 2.0}, ValueError, "num_envs = 2.0"),
        ({"num_threads": -1}, ValueError, "num_threads = -1"),
        ({"autoreset_mode": "no"}, ValueError, "'no' is not a valid AutoresetMode"),
        ({"autoreset_mode": "NextStep"}, ValueError, "must be AutoresetMode.SAME_STEP or DISABLED"),
        ({"settings": {"zero_sum": "shared"}}, ConfigError, "zero_sum = 'shared': Expected `bool`"),
        ({"settings": {"max_cycles": 0}}, ConfigError, "max_cycles = 0: Expected `int` >= 1"),
        ({"ghosts": 2}, ConfigError, "at least one must have the behaviour 'policy'"),
        ({"settings": Config()}, ConfigError, "at least one must have the behaviour 'policy'"),
        (
            {"settings": {"decisions.when": "event"}},
            ConfigError,
            "decisions.when='event' is for one agent",
        ),
        ({"render_mode": "human"}, ValueError, "render_mode = 'human'"),
    ],
)
def test_an_argument_that_cannot_be_played_is_named(
    arguments: dict[str, Any], error: type[Exception], message: str
) -> None:
    with pytest.raises(error, match=message):
        pacman_env.parallel_vec_env(**arguments)


ZEROS = np.zeros(GAMES, dtype=np.int64)
TWO = np.zeros((GAMES, 2))
INF = np.array([[0.0, 0.0], [0.1, np.inf], [0.0, 0.0]])
BAD: list[tuple[str, Any, str]] = [
    ("goal", {PACMAN: ZEROS}, "no actions of clyde"),
    ("goal", {}, "no actions of pacman, clyde"),
    ("goal", {PACMAN: ZEROS, "clyde": ZEROS, "blinky": ZEROS}, "actions of blinky: the agents are pacman, clyde"),
    ("goal", {PACMAN: ZEROS[:2], "clyde": ZEROS}, r"actions of pacman must be 3 integers, got int64 of shape \(2,\)"),
    ("goal", {PACMAN: ZEROS, "clyde": ZEROS + 0.5}, "actions of clyde must be 3 integers, got float64"),
    ("goal", {PACMAN: ZEROS > 0, "clyde": ZEROS}, "actions of pacman must be 3 integers, got bool"),
    ("goal", {PACMAN: ZEROS, "clyde": None}, "actions of clyde must be 3 integers, got object"),
    ("goal", {PACMAN: ZEROS, "clyde": np.array([0, 5, 24])}, "action 24 of clyde in game 2: must be 0 to 23"),
    ("goal", np.array([[0, 0], [-1, 0], [0, 0]]), "action -1 of pacman in game 1: must be 0 to 23"),
    ("goal", np.full((GAMES, 2), 2**63, dtype=np.uint64), "action 9223372036854775808 of pacman in game 0"),
    ("goal", ZEROS, r"actions must be integers of shape \(3, 2\), got int64 of shape \(3,\)"),
    ("goal", TWO, r"actions must be integers of shape \(3, 2\), got float64"),
    ("goal", None, r"actions must be integers of shape \(3, 2\), got object"),
    ("velocity", np.zeros((GAMES, 2), dtype=int), "actions must be by agent, with velocities of pacman"),
    ("velocity", {PACMAN: ZEROS, "clyde": ZEROS}, "actions of pacman must be 3 pairs of v and omega, got int64"),
    ("velocity", {PACMAN: INF, "clyde": ZEROS}, re.escape("action [0.1, inf] of pacman in game 1: must be two finite")),
    ("velocity", {PACMAN: TWO, "clyde": ZEROS - 1}, "action -1 of clyde in game 0: must be 0 to 23"),
]


@pytest.mark.parametrize(("action", "actions", "message"), BAD)
def test_wrong_actions_are_named_and_leave_the_games_as_they_were(action: str, actions: Any, message: str) -> None:
    env, twin = (make(action=action, settings={"max_cycles": 2}) for _ in range(2))
    env.reset(seed=1)
    twin.reset(seed=1)
    good = actions_of(env, np.random.default_rng(0))
    for _ in range(2):
        with pytest.raises(ValueError, match=message):
            env.step(actions)
        assert same(env.step(good), twin.step(good))


BAD_RESETS: list[tuple[dict[str, Any], str]] = [
    ({"mask": [True] * 3}, r"mask must be a bool array of shape \(3,\)"),
    ({"mask": np.ones(3, dtype=int)}, r"mask must be a bool array of shape \(3,\)"),
    ({"mask": np.zeros(3, dtype=np.bool_)}, "mask must have at least one True value"),
    ({"seed": 1.5}, "seed = 1.5: must be a whole number"),
    ({"seed": [1, 2]}, "2 seeds for 3 games"),
    ({"seed": [1, 2, -3]}, "Seed must be"),
    ({"options": {"levl": 1}}, r"options\['levl'\]: choose among level, round_seed, settings"),
    (
        {"mask": np.array([True, False, False]), "options": {"settings": {"clyde.speed_mps": 0.4}}},
        r"options\['settings'\] are for all games",
    ),
]


@pytest.mark.parametrize(("arguments", "message"), BAD_RESETS)
def test_a_wrong_reset_is_named_and_leaves_the_games_as_they_were(arguments: dict[str, Any], message: str) -> None:
    env, twin = make(), make()
    env.reset(seed=1)
    twin.reset(seed=1)
    with pytest.raises((ValueError, gym.error.Error), match=message):
        env.reset(**arguments)
    good = actions_of(env, np.random.default_rng(0))
    assert same((env.step(good), env.reset()), (twin.step(good), twin.reset()))


def test_nothing_can_be_asked_before_the_first_reset_of_all() -> None:
    env = make(render_mode="rgb_array")
    asks: list[Any] = [lambda: env.step(np.zeros((GAMES, 2), dtype=int)), env.state, env.action_masks, env.render]
    for ask in (*asks, lambda: env.reset(mask=np.array([True, False, True]))):
        with pytest.raises(gym.error.ResetNeeded):
            ask()
