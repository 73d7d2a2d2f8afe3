"""What the batched environment of several agents promises: to be many of PettingZoo's, as arrays."""

from __future__ import annotations

import copy
import math
import pickle
from typing import Any

import numpy as np
import pytest
from gymnasium import spaces

import pacman_env
from pacman_env.config import ConfigError
from pacman_env.envs.core import EnvCore
from pacman_env.envs.parallel_vec_env import PACMAN, PacManBotParallelVecEnv, _within_half_a_turn
from pacman_env.envs.pettingzoo_env import PacManBotParallelEnv
from pacman_env.sim.observation.situation import MISSING
from tests.envs.helpers import QUICK, nothing_returned_is_changed_later, same

MIXED = ("policy", "chase", "arcade", "policy")
FAST_GHOSTS = {**QUICK, "clyde.speed_mps": 0.8}
GAMES = 3
#: Arguments of both environments.
CASES: dict[str, dict[str, Any]] = {
    "one ghost": {"settings": QUICK},
    "several, separate": {"ghosts": MIXED, "settings": {**FAST_GHOSTS, "zero_sum": False}},
    "all four, flat": {
        "ghosts": ("policy",) * 4,
        "observation": "flat",
        "settings": {
            **FAST_GHOSTS,
            "observation.normalize": True,
            "observation.mask": "beside",
            "observation.numeric_info": True,
            "timeout": "termination",
        },
    },
    "velocities, with a scan": {
        "action": "velocity",
        "ghosts": ("wander", "policy", "policy"),
        "observation": ("features", "scan"),
        "settings": FAST_GHOSTS,
    },
    "endless, progress": {
        "preset": "ideal",
        "settings": {
            **QUICK,
            "execution.death_radius_m": 0.3,
            "reward.progress": 0.5,
            "ghost_reward.progress": -0.5,
            "endless": True,
            "max_cycles": 45,
            "zero_sum": False,
        },
    },
    "houses, the nearest candidates": {
        "map": "generated",
        "flat": True,
        "settings": {**FAST_GHOSTS, "num_levels": 4, "observation.candidates": "nearest"},
    },
    "houses, masks in the info": {
        "map": "generated",
        "ghosts": ("policy", "policy"),
        "settings": {
            **FAST_GHOSTS,
            "randomize.speed_mps": (0.6, 1.2),
            "num_levels": 4,
            "observation.mask": "info",
            "max_cycles": 30,
        },
    },
}


def make(num_envs: int = GAMES, **arguments: Any) -> PacManBotParallelVecEnv:
    return pacman_env.parallel_vec_env(num_envs, **arguments)


def actions_of(env: PacManBotParallelVecEnv, rng: np.random.Generator) -> dict[str, Any]:
    """Any actions of every agent, also those that the mask forbids."""
    actions: dict[str, Any] = {}
    for agent in env.agents:
        space = env.action_space(agent)
        if isinstance(space, spaces.Discrete):
            actions[agent] = rng.integers(space.n, size=env.num_envs)
    if env.config.action == "velocity":
        space: Any = env.action_space(PACMAN)
        actions[PACMAN] = rng.uniform(space.low, space.high, (env.num_envs, 2)).astype(np.float32)
    return actions


def as_array(env: PacManBotParallelVecEnv, actions: dict[str, Any]) -> Any:
    """The actions as one array (N, A), if they can be."""
    return actions if env.config.action == "velocity" else np.stack(list(actions.values()), axis=1)


def of_game(env: PacManBotParallelVecEnv, infos: dict[str, Any], game: int) -> dict[str, dict[str, Any]]:
    """One game's infos as PettingZoo's environment has them."""
    own = {k: v[game].tolist() if v[game : game + 1].dtype != object else v[game] for k, v in infos.items()}
    by_agent = {agent: dict(own) for agent in env.agents}
    if "action_mask" in infos:
        for k, agent in enumerate(env.agents):
            by_agent[agent]["action_mask"] = infos["action_mask"][game, k]
    return by_agent


def split(infos: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Infos of the games, and of those that ended."""
    final = {key: value for key, value in infos.items() if key.lstrip("_").startswith("final_")}
    return {key: value for key, value in infos.items() if key not in final}, final


def play(env: PacManBotParallelVecEnv, steps: int, seed: int = 0, first: int | None = 5) -> list[Any]:
    """Results of random actions, each held for four steps; goes on where ``first`` is None."""
    rng = np.random.default_rng(seed)
    results: list[Any] = [] if first is None else [env.reset(seed=first)]
    actions: dict[str, Any] = {}
    for k in range(steps):
        actions = actions if k % 4 else actions_of(env, rng)
        results.append((*env.step(actions), env.state()))
    return results


def test_a_ghosts_action_is_the_candidate_that_is_listed_there_in_a_game_with_all() -> None:
    settings = {**FAST_GHOSTS, "observation.mask": "info"}
    every = make(settings=settings)
    nearest = make(settings={**settings, "observation.candidates": "nearest"})
    assert nearest.action_space("clyde").n == nearest.action_space(PACMAN).n == 7 < every.action_space("clyde").n
    rng = np.random.default_rng(0)
    for env in (every, nearest):
        env.reset(seed=3)
    forbidden = 0
    for _ in range(60):
        chosen = {agent: rng.integers(7, size=GAMES) for agent in nearest.agents}
        masks = nearest.action_masks()
        lists = {PACMAN: nearest._core.observer.listed, "clyde": nearest._ghost_listed["clyde"]}
        stand_for = {}
        for number, (agent, listed) in enumerate(lists.items()):
            assert listed is not None
            named = listed[np.arange(GAMES), chosen[agent]]
            allowed = masks[np.arange(GAMES), number, chosen[agent]]
            np.testing.assert_array_equal(allowed, named != MISSING)
            forbidden += (~allowed).sum()
            stand_for[agent] = np.where(allowed, named, every.batch.hold)
        _, rewards, *_ = nearest.step(chosen)
        _, same_rewards, *_ = every.step(stand_for)
        np.testing.assert_array_equal(rewards, same_rewards)
        np.testing.assert_array_equal(nearest.state(), every.state())
    assert forbidden > 0


# --- many of PettingZoo's


@pytest.mark.parametrize("num_threads", [1, 3])
@pytest.mark.parametrize("case", CASES)
def test_each_game_equals_a_pettingzoo_environment_over_200_steps(case: str, num_threads: int) -> None:
    env = make(num_threads=num_threads, **CASES[case])
    singles: list[PacManBotParallelEnv] = [pacman_env.parallel_env(**CASES[case]) for _ in range(GAMES)]
    assert env.possible_agents == env.agents == singles[0].possible_agents
    assert env.num_agents == len(env.agents)
    assert env.state_names == singles[0].state_names
    assert env.state_space == singles[0].state_space
    for agent in env.agents:
        assert env.observation_space(agent) == singles[0].observation_space(agent)
        assert env.observation_space(agent) is env.observation_space(agent)
        assert env.action_space(agent) == singles[0].action_space(agent)
        assert env.action_space(agent) is env.action_space(agent)
    rng, ends = np.random.default_rng(1), 0
    observations, infos = env.reset(seed=11)
    for i, single in enumerate(singles):
        seen = single.reset(seed=11 + i)
        assert same((EnvCore.of_game(observations, i), of_game(env, infos, i)), seen)
    actions: dict[str, Any] = {}
    for k in range(200):
        actions = actions if k % 4 else actions_of(env, rng)
        observations, rewards, terminated, truncated, infos = env.step(as_array(env, actions) if k % 3 else actions)
        assert (rewards.dtype, rewards.shape) == (np.float64, (GAMES, env.num_agents))
        infos, final = split(infos)
        assert bool(final) == bool((terminated | truncated).any())
        for i, single in enumerate(singles):
            theirs = single.step({agent: actions[agent][i] for agent in env.agents})
            assert rewards[i].tolist() == list(theirs[1].values()), k
            assert terminated[i] == theirs[2][PACMAN]
            assert truncated[i] == theirs[3][PACMAN]
            seen = theirs[0], theirs[4]
            if not single.agents:
                ends += 1
                assert same((final["final_observation"][i], of_game(env, final["final_info"], i)), seen), k
                assert same(final["final_state"][i], single.state())
                seen = single.reset()
            elif final:
                assert final["final_observation"][i] is None
                assert not any(final[f"_final_{name}"][i] for name in ("observation", "info", "state"))
            assert same((EnvCore.of_game(observations, i), of_game(env, infos, i)), seen), k
            assert same(env.state()[i], single.state())
    assert ends > 1


def test_threads_and_the_number_of_games_change_nothing() -> None:
    arguments: dict[str, Any] = {"ghosts": MIXED, "settings": FAST_GHOSTS}
    one = play(make(5, **arguments), 60)
    for threads in (0, 3):
        assert same(play(make(5, num_threads=threads, **arguments), 60), one)
    few, rng = make(2, **arguments), np.random.default_rng(0)
    few.reset(seed=5)
    actions: dict[str, Any] = {}
    for k, expected in enumerate(one[1:]):
        actions = actions if k % 4 else {agent: rng.integers(few.batch.candidates, size=5) for agent in few.agents}
        result = few.step({agent: chosen[:2] for agent, chosen in actions.items()})
        assert same(result[1:4], tuple(array[:2] for array in expected[1:4]))


def test_headings_of_the_state_are_turned_without_rounding() -> None:
    angles = np.concatenate([np.random.default_rng(0).normal(0.0, 40.0, 5000), [0.0, math.pi, -math.pi]])
    expected = [math.remainder(angle, 2 * math.pi) for angle in angles.tolist()]
    assert _within_half_a_turn(angles).tolist() == expected


# --- ends


@pytest.mark.parametrize("case", ["several, separate", "houses, masks in the info", "endless, progress"])
def test_autoreset_equals_resetting_by_hand(case: str) -> None:
    auto, by_hand = (make(autoreset_mode=mode, **CASES[case]) for mode in ("SameStep", "Disabled"))
    assert same(auto.reset(seed=2), by_hand.reset(seed=2))
    rng, ends = np.random.default_rng(4), 0
    for k in range(150):
        actions = actions_of(auto, rng)
        ours, theirs = auto.step(actions), by_hand.step(actions)
        infos, final = split(ours[4])
        assert same(ours[1:4], theirs[1:4]), k
        ended = theirs[2] | theirs[3]
        if ended.any():
            ends += int(ended.sum())
            assert same(final["_final_observation"], ended)
            for i in np.flatnonzero(ended).tolist():
                assert same(final["final_observation"][i], EnvCore.of_game(theirs[0], i))
                assert same(final["final_state"][i], by_hand.state()[i])
            assert not final["final_state"][~ended].any()
            theirs = (*by_hand.reset(mask=ended), theirs[4])
            assert same((ours[0], infos), theirs[:2]), k
        else:
            assert same((ours[0], infos), (theirs[0], theirs[4])), k
        assert same(auto.state(), by_hand.state())
    assert ends > 3


@pytest.mark.parametrize("rewards", ["zero_sum", "separate"])
def test_games_that_are_over_stand_still_until_they_are_reset(rewards: Any) -> None:
    arguments: dict[str, Any] = {
        "ghosts": MIXED,
        "settings": {**FAST_GHOSTS, "max_cycles": 12, "zero_sum": rewards == "zero_sum"},
    }
    env = make(6, autoreset_mode="Disabled", **arguments)
    rng, over, kept = np.random.default_rng(0), np.zeros(6, dtype=np.bool_), {}
    env.reset(seed=1)
    for _ in range(20):
        observations, earned, terminated, truncated, infos = env.step(actions_of(env, rng))
        assert (earned[over] == 0.0).all()
        assert earned[~over].all()
        state = env.state()
        for i in range(6):
            now = EnvCore.of_game(observations, i), terminated[i], truncated[i], state[i], infos["outcome"][i]
            if over[i]:
                assert same(now, kept[i])
            elif terminated[i] or truncated[i]:
                kept[i] = now
        over = terminated | truncated
        assert set(np.flatnonzero(over).tolist()) == kept.keys()
    assert over.all()
    outcomes = [str(one[-1]) for one in kept.values()]
    assert {"running", "caught"} <= set(outcomes)
    mask = np.array([True, False] * 3)
    env.reset(mask=mask)
    _, earned, terminated, truncated, _ = env.step(actions_of(env, rng))
    assert same(terminated | truncated, ~mask)
    assert same(earned.any(axis=1), mask)


def test_max_cycles_truncate_games_that_still_run_each_by_its_own_count() -> None:
    env = make(2, settings={"max_cycles": 3, "zero_sum": False}, autoreset_mode="Disabled")
    env.reset(seed=0)
    still = {PACMAN: np.zeros(2, dtype=int), "clyde": np.zeros(2, dtype=int)}
    env.step(still)
    env.reset(mask=np.array([False, True]))
    results = [env.step(still) for _ in range(3)]
    assert [result[3].tolist() for result in results] == [[False, False], [True, False], [True, True]]
    assert not any(result[2].any() for result in results)
    assert results[-1][4]["outcome"].tolist() == ["running", "running"]
    assert results[-1][1].tolist() == [[0.0, 0.0], [-0.002, -0.002]]  # the game's own time limit is not reached


# --- masks, stacks, options


def test_masks_are_those_in_the_observations() -> None:
    env = make(ghosts=("policy", "policy"), settings={**FAST_GHOSTS, "num_levels": 2}, map="generated")
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(20):
        observations = env.step(actions_of(env, rng))[0]
        masks = env.action_masks()
        assert (masks.dtype, masks.shape) == (np.bool_, (GAMES, 3, env.batch.candidates))
        assert same(masks.astype(np.int8), np.stack([observations[a]["action_mask"] for a in env.agents], axis=1))
    masks[:] = False
    assert env.action_masks().any(axis=2).all()


def test_with_velocities_only_ghosts_have_masks() -> None:
    env = make(ghosts=MIXED, action="velocity")
    observations, _ = env.reset(seed=0)
    masks = env.action_masks()
    assert list(masks) == ["clyde", "inky"]
    for name, mask in masks.items():
        assert same(mask.astype(np.int8), observations[name]["action_mask"])


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
        assert same(copy.deepcopy(part), copy.deepcopy(observations[agent]))


def test_what_keeps_observations_from_being_stacked_is_named() -> None:
    env = make(observation=("flat", "features", "scan"))
    with pytest.raises(ValueError, match=r"observations of pacman and clyde differ.*\(3, 673\) and \(3, 280\)"):
        env.stacked(env.reset(seed=0)[0])
    env = make(observation=("features", "scan"))
    with pytest.raises(ValueError, match=r"pacman and clyde differ.*'scan'"):
        env.stacked(env.reset(seed=0)[0])
    with pytest.raises(ValueError, match="no observation of clyde"):
        env.stacked({PACMAN: env.reset(seed=0)[0][PACMAN]})


def test_a_level_a_round_and_settings_can_be_asked_for() -> None:
    env = make(map="generated", settings={"num_levels": 9})
    _, infos = env.reset(seed=0, options={"round_seed": [7, 8, 2**64 - 9], "level": [3, 4, 3]})
    assert infos["round_seed"].tolist() == [7, 8, 2**64 - 9]
    assert infos["level"].tolist() == [3, 4, 3]
    env = make(map="loop")
    env.reset(options={"settings": {"clyde.speed_mps": 0.4}})
    env.reset(mask=np.array([True, False, False]))
    assert env.config.clyde.speed_mps == 0.4
    env.reset()
    assert env.config.clyde.speed_mps == 0.25


def test_settings_that_would_change_who_the_agents_are_are_refused() -> None:
    for env in (make(), pacman_env.parallel_env()):
        with pytest.raises(ConfigError, match=r"clyde.ghosts would change the spaces or agents"):
            env.reset(options={"settings": {"clyde.ghosts": ("wander",)}})


# --- the same again


def test_what_was_returned_is_never_changed_later() -> None:
    env = make(ghosts=MIXED, settings=FAST_GHOSTS, observation=("features", "scan", "grid"))
    nothing_returned_is_changed_later(play, env, 30)


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
@pytest.mark.parametrize("mode", ["SameStep", "Disabled"])
def test_a_copy_made_in_mid_episode_goes_on_alike(copied: Any, mode: str) -> None:
    env = make(ghosts=MIXED, settings={**FAST_GHOSTS, "max_cycles": 12}, autoreset_mode=mode, num_threads=2)
    play(env, 9)
    env.reset(mask=np.array([False, True, False]))
    play(env, 6, first=None)
    twin = copied(env)
    assert same((twin.state(), twin.action_masks()), (env.state(), env.action_masks()))
    assert same(play(env, 40, seed=9, first=None), play(twin, 40, seed=9, first=None))


def test_pictures_are_one_for_each_game() -> None:
    env = make(2, render_mode="rgb_array")
    env.reset(seed=0)
    pictures = env.render()
    assert pictures is not None
    assert [(picture.dtype, picture.shape[0]) for picture in pictures] == [(np.uint8, 720)] * 2
    assert make(2).metadata["render_modes"] == ["rgb_array"]
    env.close()


# --- as it is used


def test_a_loop_over_tensors_as_learners_of_several_agents_write_it() -> None:
    torch = pytest.importorskip("torch")
    torch.manual_seed(0)
    env = make(
        8,
        ghosts=("policy", "policy"),
        observation="flat",
        settings={"observation.normalize": True, "observation.mask": "beside", "max_cycles": 20},
    )
    observations, _ = env.reset(seed=0)
    stacked = env.stacked(observations)
    actor = torch.nn.Linear(stacked["observation"].shape[-1], stacked["action_mask"].shape[-1])
    critic = torch.nn.Linear(env.state().shape[1], env.num_agents)
    returns, episodes = torch.zeros(8, env.num_agents, dtype=torch.float64), 0
    for _ in range(50):
        seen, mask = (torch.from_numpy(stacked[key]) for key in ("observation", "action_mask"))
        logits = actor(seen).masked_fill(mask == 0, -torch.inf)
        actions = torch.distributions.Categorical(logits=logits).sample()
        assert actions.shape == (8, 3)
        assert mask.gather(2, actions[..., None]).all()
        observations, rewards, terminated, _, infos = env.step(actions.numpy())
        stacked = env.stacked(observations)
        following = torch.from_numpy(env.state())
        if "final_state" in infos:
            ended = torch.from_numpy(infos["_final_state"])
            following = torch.where(ended[:, None], torch.from_numpy(infos["final_state"]), following)
            episodes += int(ended.sum())
        going = torch.from_numpy(~terminated)[:, None]
        targets = torch.from_numpy(rewards) + 0.99 * going * critic(following.float())
        assert targets.isfinite().all()
        returns += torch.from_numpy(rewards)
    assert episodes >= 16
    torch.testing.assert_close(returns[:, 1:].sum(dim=1), -returns[:, 0])
