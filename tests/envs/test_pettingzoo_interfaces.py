"""One world, three interfaces: Gymnasium's, PettingZoo's for all agents at once, and the one agent by agent."""

from __future__ import annotations

from typing import Any

import numpy as np
import pettingzoo
import pytest
from gymnasium import spaces

import pacman_env
from pacman_env.envs.pettingzoo_env import PACMAN
from pacman_env.envs.registration import FLAT_ID
from tests.envs.helpers import QUICK, joined, make, same
from tests.envs.test_pettingzoo_env import FAST_GHOSTS, MIXED, actions_of


@pytest.mark.parametrize(
    "arguments",
    [
        {},
        {"preset": "ideal", "settings": {"execution.rules": "as_built"}},
        {"map": "maze", "settings": {**QUICK, "nav2.abort_rate": 0.3, "max_pellets": 20}},
        {"action": "velocity", "observation": ("features", "scan", "grid")},
        {"observation": "grid", "settings": {**QUICK, "randomize.clyde_speed_mps": (0.2, 0.9)}},
        {"settings": {"endless": True}, "preset": "ideal"},
        {"map": "generated", "settings": {"num_levels": 3, "endless": True}},
        {"ghosts": ("policy", "policy", "wander", "chase")},
    ],
    ids=["house", "ideal", "maze", "velocity", "grid", "endless", "generated", "four"],
)
def test_with_ghosts_told_to_wander_pacman_plays_the_gymnasium_environment(arguments: dict[str, Any]) -> None:
    arguments = joined({"settings": QUICK}, arguments)
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
    parallel = pacman_env.parallel_env(ghosts=MIXED, settings={**FAST_GHOSTS, "zero_sum": False})
    turns = pacman_env.env(ghosts=MIXED, settings={**FAST_GHOSTS, "zero_sum": False})
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


SHAPES: tuple[dict[str, Any], ...] = (
    {
        "observation": "flat",
        "settings": {"observation.normalize": True, "observation.mask": "beside", "observation.numeric_info": True},
    },
    {
        "observation": "flat",
        "settings": {"observation.normalize": True, "observation.mask": "info", "observation.numeric_info": True},
    },
    {"observation": ("features", "planner"), "settings": {"observation.mask": "beside"}},
    {"observation": "flat", "settings": {"observation.mask": "method"}, "ghosts": ("policy", "policy", "wander")},
)


@pytest.mark.parametrize("arguments", SHAPES)
def test_in_the_shapes_of_learners_the_game_is_the_same(arguments: dict[str, Any]) -> None:
    ghosts = arguments.get("ghosts", ("policy",))
    plain = pacman_env.parallel_env(map="loop", ghosts=ghosts)
    env = pacman_env.parallel_env(map="loop", **arguments)
    observations, infos = env.reset(seed=4)
    seen, _ = plain.reset(seed=4)
    rng = np.random.default_rng(4)
    while env.agents:
        for agent in env.agents:
            mask = seen[agent]["action_mask"]
            if arguments["settings"]["observation.mask"] == "beside":
                np.testing.assert_array_equal(observations[agent]["action_mask"], mask)
                assert mask.dtype == observations[agent]["action_mask"].dtype == np.int8
            if arguments["settings"]["observation.mask"] == "info":
                np.testing.assert_array_equal(infos[agent]["action_mask"], mask)
            assert observations[agent] in env.observation_spaces[agent]
        actions = actions_of(plain, rng)
        observations, rewards, *_, infos = env.step(actions)
        seen, expected, *_ = plain.step(actions)
        assert rewards == expected
    assert not plain.agents


def test_flat_agents_have_one_shape_with_the_mask_beside_or_in_the_info() -> None:
    beside = pacman_env.parallel_env(map="loop", **SHAPES[0])
    space = beside.observation_space(PACMAN)
    assert space == beside.observation_space("clyde")
    assert isinstance(space, spaces.Dict)
    assert set(space.keys()) == {"observation", "action_mask"}
    flat = pacman_env.parallel_env(map="loop", **SHAPES[1])
    assert flat.observation_space(PACMAN) == flat.observation_space("clyde") == space["observation"]
    turns = pacman_env.env(map="loop", **SHAPES[0])
    for agent in turns.possible_agents:
        assert turns.observation_space(agent) == beside.observation_spaces[agent]
        assert turns.action_space(agent) == beside.action_spaces[agent]


def test_a_ghosts_numbers_are_within_1_where_all_are() -> None:
    env = pacman_env.parallel_env(map="house", ghosts=("policy", "wander"), **SHAPES[0])
    observations, _ = env.reset(seed=0)
    rng, most = np.random.default_rng(0), 0.0
    while env.agents:
        assert all(np.abs(seen["observation"]).max() <= 1.0 for seen in observations.values())
        most = max(most, float(np.abs(observations["clyde"]["observation"]).max()))
        actions = {a: rng.choice(np.flatnonzero(observations[a]["action_mask"])) for a in env.agents}
        observations, *_ = env.step(actions)
    assert most > 0.5


def test_numeric_infos_hold_nothing_but_numbers() -> None:
    env = pacman_env.parallel_env(map="loop", **SHAPES[1])
    _, infos = env.reset(seed=0)
    for info in infos.values():
        assert all(isinstance(value, (int, float, np.ndarray)) for value in info.values())


@pytest.mark.skipif(not hasattr(pettingzoo, "register"), reason="PettingZoo before 1.27 has no registry")
@pytest.mark.parametrize("kind", ["parallel", "aec"])
def test_both_are_in_pettingzoos_registry(kind: Any) -> None:
    env = pettingzoo.make(kind, "pacman_env/PacManBot-v0", map="loop")
    env.reset(seed=0)
    assert env.metadata["name"] == "pacmanbot_v0"
    learners = pettingzoo.make(kind, FLAT_ID, map="loop")
    assert set(learners.observation_space(PACMAN).keys()) == {"observation", "action_mask"}
