"""One world, three interfaces: Gymnasium's, PettingZoo's for all agents at once, and the one agent by agent."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import pacman_env
from pacman_env.envs.pettingzoo_env import PACMAN
from tests.envs.helpers import QUICK, make, same
from tests.envs.test_pettingzoo_env import FAST_GHOSTS, MIXED, actions_of


@pytest.mark.parametrize(
    "arguments",
    [
        {},
        {"preset": "ideal", "execution": "as_built"},
        {"map": "maze", "settings": {**QUICK, "nav2.abort_rate": 0.3, "max_pellets": 20}},
        {"action": "velocity", "observation": ("features", "scan", "grid")},
        {"observation": "grid", "settings": {**QUICK, "randomize.clyde_speed_mps": (0.2, 0.9)}},
        {"endless": True, "preset": "ideal"},
        {"map": "generated", "num_levels": 3, "endless": True},
        {"ghosts": ("policy", "policy", "wander", "chase")},
    ],
    ids=["house", "ideal", "maze", "velocity", "grid", "endless", "generated", "four"],
)
def test_with_ghosts_told_to_wander_pacman_plays_the_gymnasium_environment(arguments: dict[str, Any]) -> None:
    arguments = {"settings": QUICK, **arguments}
    ghosts = arguments.pop("ghosts", ("policy",))
    env = pacman_env.parallel_env(ghosts=ghosts, **arguments)
    single = make(ghosts=["wander" if ghost == "policy" else ghost for ghost in ghosts], **arguments)
    assert env.observation_space(PACMAN) == single.observation_space
    assert env.action_space(PACMAN) == single.action_space
    rng, episodes, seed = np.random.default_rng(1), 0, 7
    while episodes < 4:
        observations, infos = env.reset(seed=seed if episodes == 0 else None)
        assert same((observations[PACMAN], infos[PACMAN]), single.reset(seed=seed if episodes == 0 else None))
        while env.agents:
            actions = dict.fromkeys(env.agents, env.batch.hold)
            actions[PACMAN] = actions_of(env, rng)[PACMAN]
            results = env.step(actions)
            assert same(tuple(result[PACMAN] for result in results), single.step(actions[PACMAN]))
        episodes += 1


def test_agent_by_agent_it_is_the_same_game() -> None:
    parallel = pacman_env.parallel_env(ghosts=MIXED, settings=FAST_GHOSTS, rewards="separate")
    turns = pacman_env.env(ghosts=MIXED, settings=FAST_GHOSTS, rewards="separate")
    rng = np.random.default_rng(0)
    for episode in range(4):
        observations, infos = parallel.reset(seed=3 if episode == 0 else None)
        turns.reset(seed=3 if episode == 0 else None)
        rewards, terminated, truncated = (dict.fromkeys(parallel.agents, value) for value in (0, False, False))
        asked, actions = [], actions_of(parallel, rng)
        for agent in turns.agent_iter():
            expected = (observations, rewards, terminated, truncated, infos)
            assert same(turns.last(), tuple(part[agent] for part in expected))
            np.testing.assert_array_equal(turns.state(), parallel.state())
            turns.step(actions.get(agent))
            asked.append(agent)
            if len(asked) == len(parallel.agents):
                assert asked == parallel.agents
                observations, rewards, terminated, truncated, infos = parallel.step(actions)
                asked, actions = [], actions_of(parallel, rng)
        assert sorted(asked) == sorted(parallel.possible_agents)  # each was told of the end
