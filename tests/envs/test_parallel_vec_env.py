"""The batched environment of several agents is many of PettingZoo's, as arrays."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import spaces

import pacman_env
from pacman_env.config import ConfigError
from pacman_env.envs.core import EnvCore
from pacman_env.envs.parallel_vec_env import PACMAN, PacManBotParallelVecEnv
from pacman_env.envs.pettingzoo_env import PacManBotParallelEnv
from tests.envs.helpers import QUICK, same

MIXED = ("policy", "chase", "arcade", "policy")
FAST_GHOSTS = {**QUICK, "clyde.speed_mps": 0.8}
GAMES = 3
#: Arguments of both environments.
CASES: dict[str, dict[str, Any]] = {
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
    """Draw actions of every agent; the masks forbid some of them."""
    actions: dict[str, Any] = {}
    for agent in env.agents:
        space = env.action_space(agent)
        if isinstance(space, spaces.Discrete):
            actions[agent] = rng.integers(space.n, size=env.num_envs)
        elif isinstance(space, spaces.Box):
            actions[agent] = rng.uniform(space.low, space.high, (env.num_envs, 2)).astype(np.float32)
    return actions


def of_game(env: PacManBotParallelVecEnv, infos: dict[str, Any], game: int) -> dict[str, dict[str, Any]]:
    """Return one game's infos as PettingZoo's environment has them."""
    own = {k: v[game].tolist() if v[game : game + 1].dtype != object else v[game] for k, v in infos.items()}
    by_agent = {agent: dict(own) for agent in env.agents}
    if "action_mask" in infos:
        for k, agent in enumerate(env.agents):
            by_agent[agent]["action_mask"] = infos["action_mask"][game, k]
    return by_agent


def split(infos: dict[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return the infos of the games, and those of the games that ended."""
    final = {key: value for key, value in infos.items() if key.lstrip("_").startswith("final_")}
    return {key: value for key, value in infos.items() if key not in final}, final


# --- many of PettingZoo's


@pytest.mark.parametrize(("case", "num_threads"), [(case, 1 + 2 * (k % 2)) for k, case in enumerate(CASES)])
def test_games_equal_pettingzoo_environments(case: str, num_threads: int) -> None:
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
    rng, ends = np.random.default_rng(1), 0
    observations, infos = env.reset(seed=11)
    for i, single in enumerate(singles):
        assert same((EnvCore.of_game(observations, i), of_game(env, infos, i)), single.reset(seed=11 + i))
    for k in range(120):
        actions = actions if k % 4 else actions_of(env, rng)  # noqa: F821
        as_array = np.stack(list(actions.values()), axis=1) if k % 3 and env.config.action == "goal" else actions
        observations, rewards, terminated, truncated, infos = env.step(as_array)
        assert (rewards.dtype, rewards.shape) == (np.float64, (GAMES, env.num_agents))
        infos, final = split(infos)
        assert bool(final) == bool((terminated | truncated).any())
        for i, single in enumerate(singles):
            theirs = single.step({agent: actions[agent][i] for agent in env.agents})
            assert rewards[i].tolist() == list(theirs[1].values()), k
            assert (terminated[i], truncated[i]) == (theirs[2][PACMAN], theirs[3][PACMAN])
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


@pytest.mark.parametrize("case", ["several, separate", "houses, masks in the info"])
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
        seen = theirs[0], theirs[4]
        if ended.any():
            ends += int(ended.sum())
            assert same(final["_final_observation"], ended)
            assert not final["final_state"][~ended].any()
            seen = by_hand.reset(mask=ended)
        assert same((ours[0], infos), seen), k
        assert same(auto.state(), by_hand.state())
    assert ends > 3


def test_finished_games_stand_still_until_reset() -> None:
    env = make(6, ghosts=MIXED, autoreset_mode="Disabled", settings={**FAST_GHOSTS, "max_cycles": 12})
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
    assert over.all()
    assert {"running", "caught"} <= {str(one[-1]) for one in kept.values()}
    mask = np.array([True, False] * 3)
    env.reset(mask=mask)
    _, earned, terminated, truncated, _ = env.step(actions_of(env, rng))
    assert same(terminated | truncated, ~mask)
    assert same(earned.any(axis=1), mask)


def test_max_cycles_count_each_game() -> None:
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


def test_masks_of_agents_match_their_observations() -> None:
    env = make(ghosts=("policy", "policy"), settings={**FAST_GHOSTS, "num_levels": 2}, map="generated")
    env.reset(seed=0)
    rng = np.random.default_rng(0)
    for _ in range(20):
        observations = env.step(actions_of(env, rng))[0]
        masks = env.action_masks()
        assert (masks.dtype, masks.shape) == (np.bool_, (GAMES, 3, env.batch.candidates))
        assert same(masks.astype(np.int8), np.stack([observations[a]["action_mask"] for a in env.agents], axis=1))


def test_only_ghosts_have_masks_with_velocities() -> None:
    env = make(ghosts=MIXED, action="velocity")
    observations, _ = env.reset(seed=0)
    masks = env.action_masks()
    assert list(masks) == ["clyde", "inky"]
    for name, mask in masks.items():
        assert same(mask.astype(np.int8), observations[name]["action_mask"])


def test_nearest_candidates_limit_every_agent() -> None:
    every = make(settings=FAST_GHOSTS)
    nearest = make(settings={**FAST_GHOSTS, "observation.candidates": "nearest"})
    assert nearest.action_space("clyde").n == nearest.action_space(PACMAN).n == 7 < every.action_space("clyde").n
    for env in (nearest, every):
        env.reset(seed=3)
    hold = {agent: np.full(GAMES, 6) for agent in nearest.agents}  # the last of the list
    ours, theirs = nearest.step(hold), every.step({agent: np.full(GAMES, every.batch.hold) for agent in every.agents})
    assert same(ours[1:4], theirs[1:4])
    assert same(nearest.state(), every.state())


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


@pytest.mark.parametrize(
    ("observation", "message"),
    [
        (("flat", "features", "scan"), r"observations of pacman and clyde differ.*\(3, 673\) and \(3, 280\)"),
        (("features", "scan"), r"pacman and clyde differ.*'scan'"),
    ],
)
def test_observations_of_different_shapes_are_not_stacked(observation: Any, message: str) -> None:
    env = make(observation=observation)
    seen, _ = env.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        env.stacked(seen)
    with pytest.raises(ValueError, match="no observation of clyde"):
        env.stacked({PACMAN: seen[PACMAN]})


def test_reset_options_choose_level_round_and_settings() -> None:
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
    for other in (make(), pacman_env.parallel_env()):
        with pytest.raises(ConfigError, match=r"clyde.ghosts would change the spaces or agents"):
            other.reset(options={"settings": {"clyde.ghosts": ("wander",)}})


# --- refusals


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"num_envs": 0}, "num_envs = 0: must be a whole number of at least 1"),
        ({"num_envs": 2.0}, "num_envs = 2.0"),
        ({"num_threads": -1}, "num_threads = -1"),
        ({"autoreset_mode": "no"}, "'no' is not a valid AutoresetMode"),
        ({"autoreset_mode": "NextStep"}, "must be AutoresetMode.SAME_STEP or DISABLED"),
        ({"render_mode": "human"}, "render_mode = 'human'"),
    ],
)
def test_unplayable_argument_is_named(arguments: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        pacman_env.parallel_vec_env(**arguments)


ZEROS = np.zeros(GAMES, dtype=np.int64)


@pytest.mark.parametrize(
    ("action", "actions", "message"),
    [
        ("goal", {}, "no actions of pacman, clyde"),
        ("goal", {PACMAN: ZEROS, "clyde": ZEROS, "blinky": ZEROS}, "actions of blinky: the agents are pacman, clyde"),
        ("goal", {PACMAN: ZEROS[:2], "clyde": ZEROS}, r"actions of pacman must be 3 integers, got int64 of shape"),
        ("goal", {PACMAN: ZEROS, "clyde": np.array([0, 5, 24])}, "action 24 of clyde in game 2: must be 0 to 23"),
        ("goal", np.full((GAMES, 2), 2**63, dtype=np.uint64), "action 9223372036854775808 of pacman in game 0"),
        ("goal", ZEROS, r"actions must be integers of shape \(3, 2\), got int64 of shape \(3,\)"),
        ("velocity", np.zeros((GAMES, 2), dtype=int), "actions must be by agent, with velocities of pacman"),
        ("velocity", {PACMAN: ZEROS, "clyde": ZEROS}, "actions of pacman must be 3 pairs of v and omega, got int64"),
    ],
)
def test_wrong_actions_are_named(action: str, actions: Any, message: str) -> None:
    env = make(action=action)
    env.reset(seed=1)
    with pytest.raises(ValueError, match=message):
        env.step(actions)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"mask": [True] * 3}, r"mask must be a bool array of shape \(3,\)"),
        ({"mask": np.zeros(3, dtype=np.bool_)}, "mask must have at least one True value"),
        ({"seed": 1.5}, "seed = 1.5: must be a whole number"),
        ({"seed": [1, 2]}, "2 seeds for 3 games"),
        ({"seed": [1, 2, -3]}, "Seed must be"),
        ({"options": {"levl": 1}}, r"options\['levl'\]: choose among level, round_seed, settings"),
        (
            {"mask": np.array([True, False, False]), "options": {"settings": {"clyde.speed_mps": 0.4}}},
            r"options\['settings'\] are for all games",
        ),
    ],
)
def test_wrong_reset_changes_nothing(arguments: dict[str, Any], message: str) -> None:
    env, twin = make(), make()
    with pytest.raises(gym.error.ResetNeeded):
        env.reset(mask=np.array([True, False, True]))
    env.reset(seed=1)
    twin.reset(seed=1)
    with pytest.raises((ValueError, gym.error.Error), match=message):
        env.reset(**arguments)
    good = actions_of(env, np.random.default_rng(0))
    assert same((env.step(good), env.reset()), (twin.step(good), twin.reset()))


# --- as it is used


def test_tensor_loop_of_learners_runs() -> None:
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
    returns, episodes = torch.zeros(8, env.num_agents, dtype=torch.float64), 0
    for _ in range(50):
        seen, mask = (torch.from_numpy(stacked[key]) for key in ("observation", "action_mask"))
        logits = actor(seen).masked_fill(mask == 0, -torch.inf)
        actions = torch.distributions.Categorical(logits=logits).sample()
        assert mask.gather(2, actions[..., None]).all()
        observations, rewards, _, _, infos = env.step(actions.numpy())
        stacked = env.stacked(observations)
        if "final_state" in infos:
            assert torch.from_numpy(infos["final_state"]).shape == torch.from_numpy(env.state()).shape
            episodes += int(infos["_final_state"].sum())
        returns += torch.from_numpy(rewards)
    assert episodes >= 16
    torch.testing.assert_close(returns[:, 1:].sum(dim=1), -returns[:, 0])
