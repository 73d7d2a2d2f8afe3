"""The batched environment of several agents is many of PettingZoo's, as arrays."""

from typing import Any

import numpy as np
import pytest

import pacman_env
from pacman_env.envs.parallel_vec_env import PACMAN, PacManBotParallelVecEnv
from pacman_env.envs.resets import of_game as part_of
from tests.envs.adapters import GAMES, ParallelVec
from tests.envs.cases import PAIRWISE, SEVERAL_LEARNERS, arguments, name
from tests.envs.helpers import QUICK, joined, same

FAST_GHOSTS = {**QUICK, "clyde.speed_mps": 0.8}
PROGRESS = {"reward.progress": 0.5, "ghost_reward.progress": -0.5, "endless": True, "zero_sum": False, "max_cycles": 30}
#: Arguments of both environments.
CASES = {name(row): arguments(row, several=True) for row in PAIRWISE[::2]}
CASES |= {shape: joined({"settings": FAST_GHOSTS}, chosen) for shape, chosen in SEVERAL_LEARNERS.items()}
CASES["progress"] = {"map": "generated", "settings": {**FAST_GHOSTS, **PROGRESS, "num_levels": 4}}


def make(num_envs: int = GAMES, **arguments: Any) -> PacManBotParallelVecEnv:
    return pacman_env.parallel_vec_env(num_envs, **arguments)


def of_game(env: PacManBotParallelVecEnv, infos: dict[str, Any], game: int) -> dict[str, dict[str, Any]]:
    """Return one game's infos as PettingZoo's environment has them."""
    own = {k: v[game].tolist() if v[game : game + 1].dtype != object else v[game] for k, v in infos.items()}
    by_agent = {agent: dict(own) for agent in env.agents}
    if "action_mask" in infos:
        for k, agent in enumerate(env.agents):
            by_agent[agent]["action_mask"] = infos["action_mask"][game, k]
    return by_agent


@pytest.mark.parametrize(("k", "case"), list(enumerate(CASES)))
def test_games_equal_pettingzoo_environments(k: int, case: str) -> None:
    mode = ("SameStep", "Disabled")[k % 2]
    games = ParallelVec(num_threads=1 + k % 3, autoreset_mode=mode, **CASES[case])
    env, rng, ends = games.env, np.random.default_rng(1), 0
    singles = [pacman_env.parallel_env(**CASES[case]) for _ in range(GAMES)]
    assert env.possible_agents == env.agents == singles[0].possible_agents
    assert env.num_agents == len(env.agents)
    assert (env.state_names, env.state_space) == (singles[0].state_names, singles[0].state_space)
    for agent in env.agents:
        assert env.observation_space(agent) == singles[0].observation_space(agent)
        assert env.observation_space(agent) is env.observation_space(agent)
        assert env.action_space(agent) == singles[0].action_space(agent)
    observations, infos = env.reset(seed=11)
    for i, single in enumerate(singles):
        assert same((part_of(observations, i), of_game(env, infos, i)), single.reset(seed=11 + i))
    for step in range(100):
        actions = actions if step % 4 else games.sample(rng)  # noqa: F821
        as_array = np.stack(list(actions.values()), axis=1) if step % 3 and env.config.action == "goal" else actions
        observations, rewards, terminated, truncated, infos = env.step(as_array)
        assert (rewards.dtype, rewards.shape) == (np.float64, (GAMES, env.num_agents))
        final = {key: infos.pop(key) for key in list(infos) if key.lstrip("_").startswith("final_")}
        over = terminated | truncated
        assert bool(final) == (mode == "SameStep" and bool(over.any()))
        if mode == "Disabled":
            final = {"final_observation": [part_of(observations, i) for i in range(GAMES)]}
            final |= {"final_info": infos, "final_state": env.state()}
            if over.any():
                observations, infos = env.reset(mask=over)
        for i, single in enumerate(singles):
            seen, *theirs, told = single.step({agent: actions[agent][i] for agent in env.agents})
            assert rewards[i].tolist() == list(theirs[0].values()), step
            assert (terminated[i], truncated[i]) == (theirs[1][PACMAN], theirs[2][PACMAN])
            if not single.agents:
                ends += 1
                assert same((final["final_observation"][i], of_game(env, final["final_info"], i)), (seen, told)), step
                assert same(final["final_state"][i], single.state())
                seen, told = single.reset()
            elif final and mode == "SameStep":
                assert final["final_observation"][i] is None
                assert not any(final[f"_final_{part}"][i] for part in ("observation", "info", "state"))
            assert same((part_of(observations, i), of_game(env, infos, i)), (seen, told)), step
            assert same(env.state()[i], single.state())
    assert ends > 1


def test_finished_games_do_not_change_until_reset() -> None:
    games = ParallelVec(autoreset_mode="Disabled", settings={**FAST_GHOSTS, "max_cycles": 12})
    env, rng, over, kept = games.env, np.random.default_rng(0), np.zeros(GAMES, dtype=np.bool_), {}
    env.reset(seed=1)
    for _ in range(20):
        observations, earned, terminated, truncated, infos = env.step(games.sample(rng))
        assert not earned[over].any()
        assert earned[~over].all()
        state = env.state()
        for i in np.flatnonzero(terminated | truncated).tolist():
            now = part_of(observations, i), terminated[i], truncated[i], state[i], infos["outcome"][i]
            assert same(now, kept.setdefault(i, now))
        over = terminated | truncated
    assert over.all()
    mask = np.array([True, False, False])
    env.reset(mask=mask)
    _, earned, terminated, truncated, _ = env.step(games.sample(rng))
    assert same(terminated | truncated, ~mask)
    assert same(earned.any(axis=1), mask)


@pytest.mark.parametrize("action", ["goal", "velocity"])
def test_masks_of_agents_match_their_observations(action: str) -> None:
    games = ParallelVec(ghosts=("policy", "wander", "policy"), action=action, settings=FAST_GHOSTS)
    env, rng = games.env, np.random.default_rng(0)
    env.reset(seed=0)
    for _ in range(20):
        observations, masks = env.step(games.sample(rng))[0], env.action_masks()
        if action == "goal":
            assert (masks.dtype, masks.shape) == (np.bool_, (GAMES, 3, env.batch.candidates))
            masks = {agent: masks[:, k] for k, agent in enumerate(env.agents)}
        assert list(masks) == (["pacman"] if action == "goal" else []) + ["clyde", "pinky"]
        assert all(same(mask.astype(np.int8), observations[agent]["action_mask"]) for agent, mask in masks.items())


def test_nearest_actions_select_listed_candidates() -> None:
    every = make(settings=FAST_GHOSTS)
    nearest = make(settings={**FAST_GHOSTS, "observation.candidates": "nearest"})
    assert nearest.action_space("clyde").n == nearest.action_space(PACMAN).n == 7 < every.action_space("clyde").n
    rng, forbidden = np.random.default_rng(0), 0
    whole, _ = every.reset(seed=3)
    listed, _ = nearest.reset(seed=3)
    for _ in range(60):
        chosen = {agent: rng.integers(7, size=GAMES) for agent in nearest.agents}
        stand_for = {agent: np.full(GAMES, every.batch.hold) for agent in every.agents}
        for agent, places in chosen.items():
            for i, place in enumerate(places):
                if listed[agent]["action_mask"][i, place]:
                    alike = whole[agent]["candidates"][i] == listed[agent]["candidates"][i, place]
                    stand_for[agent][i] = np.flatnonzero(alike.all(axis=1) & (whole[agent]["action_mask"][i] == 1))[0]
                else:
                    forbidden += 1
        (listed, *ours, _), (whole, *theirs, _) = nearest.step(chosen), every.step(stand_for)
        assert same(ours, theirs)
        np.testing.assert_array_equal(nearest.state(), every.state())
    assert forbidden > 0


@pytest.mark.parametrize("mask", ["observation", "beside", "method"])
def test_observations_of_one_shape_are_stacked(mask: str) -> None:
    env = make(ghosts=("policy",) * 3, observation="flat", settings={"observation.mask": mask})
    observations, _ = env.reset(seed=0)
    stacked = env.stacked(observations)
    if mask == "beside":
        assert set(stacked) == {"observation", "action_mask"}
        assert stacked["action_mask"].dtype == np.int8
    for k, agent in enumerate(env.agents):
        part = {key: a[:, k] for key, a in stacked.items()} if isinstance(stacked, dict) else stacked[:, k]
        assert same(part, observations[agent])


def test_observations_of_different_shapes_are_not_stacked() -> None:
    for kinds, message in (
        (("flat", "features", "scan"), r"observations of pacman and clyde differ.*\(3, 673\) and \(3, 280\)"),
        (("features", "scan"), r"pacman and clyde differ.*'scan'"),
    ):
        env = make(observation=kinds)
        seen, _ = env.reset(seed=0)
        with pytest.raises(ValueError, match=message):
            env.stacked(seen)
        with pytest.raises(ValueError, match="no observation of clyde"):
            env.stacked({PACMAN: seen[PACMAN]})
