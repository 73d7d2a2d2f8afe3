"""What the native vector environment promises: to be many single ones, in Gymnasium's layout."""

from __future__ import annotations

import copy
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from pacman_env.config import Config, ConfigError
from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv
from pacman_env.policies.registry import make_policy
from tests.envs.helpers import ID, QUICK, arrays, make, make_vector, same

LOSING = {**QUICK, "nav2.abort_rate": 0.3}
EXECUTIONS = [("robust", QUICK), ("as_built", LOSING)]


def make_sync(num_envs: int, mode: AutoresetMode, **arguments: Any) -> SyncVectorEnv:
    return SyncVectorEnv([lambda: gym.make(ID, **arguments)] * num_envs, autoreset_mode=mode)


def random_play(env: PacManBotVectorEnv, steps: int, seed: int) -> list[Any]:
    rng = np.random.default_rng(seed)
    return [env.step(rng.integers(env.single_action_space.n, size=env.num_envs)) for _ in range(steps)]


@pytest.mark.parametrize(("execution", "settings"), EXECUTIONS)
@pytest.mark.parametrize("mode", [AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP])
def test_it_equals_a_vector_of_single_environments(
    mode: AutoresetMode, execution: str, settings: dict[str, Any]
) -> None:
    arguments: dict[str, Any] = {"settings": {**settings, "execution.rules": execution}}
    native = make_vector(5, autoreset_mode=mode, **arguments)
    singles = make_sync(5, mode, **arguments)
    assert native.observation_space == singles.observation_space
    assert native.action_space == singles.action_space
    assert native.metadata["autoreset_mode"] == mode
    assert same(native.reset(seed=3), singles.reset(seed=3))
    policy, rng, seen = make_policy("nearest"), np.random.default_rng(0), set()
    for k in range(120):
        actions = policy.select(native.situation)
        actions[0] = rng.integers(native.single_action_space.n)
        ours, theirs = native.step(actions), singles.step(actions)
        assert same(ours, theirs), k
        info = ours[4].get("final_info", {}) if mode == AutoresetMode.SAME_STEP else ours[4]
        seen.update(info.get("outcome", []))
    assert seen >= {"caught", "timeout", "cleared" if execution == "as_built" else "complete"}


@pytest.mark.parametrize(("execution", "settings"), EXECUTIONS)
def test_without_autoreset_it_equals_one_reset_by_mask(execution: str, settings: dict[str, Any]) -> None:
    arguments: dict[str, Any] = {"settings": {**settings, "execution.rules": execution}}
    native = make_vector(5, autoreset_mode=AutoresetMode.DISABLED, **arguments)
    singles = make_sync(5, AutoresetMode.DISABLED, **arguments)
    assert same(native.reset(seed=6), singles.reset(seed=6))
    policy, resets = make_policy("nearest"), 0
    for k in range(120):
        ours, theirs = native.step(actions := policy.select(native.situation)), singles.step(actions)
        assert same(ours, theirs), k
        over = ours[2] | ours[3]
        if over.any():
            resets += int(over.sum())
            seed = None if k % 2 else [100 * k + i for i in range(5)]
            both = [env.reset(seed=seed, options={"reset_mask": over.copy()}) for env in (native, singles)]
            assert same(*both), k
            np.testing.assert_array_equal(both[0][1]["_outcome"], over)
    assert resets > 5


def test_make_vec_gives_the_native_one_by_default() -> None:
    env = gym.make_vec(ID, num_envs=2, map="loop")
    assert isinstance(env.unwrapped, PacManBotVectorEnv)
    assert env.unwrapped.batch.assets.occupancy.name == "loop"
    assert env.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP


@pytest.mark.parametrize("num_envs", [1, 130])
def test_the_last_game_is_a_single_environment_with_its_seed(num_envs: int) -> None:
    settings = {"execution.death_radius_m": 0.01}
    many, one = make_vector(num_envs, settings=settings), make(settings=settings)
    rng = np.random.default_rng(1)
    observations, infos = many.reset(seed=40)
    observation, info = one.reset(seed=40 + num_envs - 1)
    for k in range(60):
        assert same({key: array[-1] for key, array in observations.items()}, observation), k
        assert {key: infos[key].tolist()[-1] for key in info} == info
        if k % 15 == 0:
            actions = rng.integers(many.single_action_space.n, size=num_envs)
        observations, rewards, terminated, truncated, infos = many.step(actions)
        observation, reward, *ends, info = one.step(int(actions[-1]))
        assert rewards[-1] == reward
        assert [terminated[-1], truncated[-1]] == ends == [False, False]
    assert many.observation_space.contains(observations)


def test_reset_takes_one_seed_per_game() -> None:
    env = make_vector(3)
    observations, infos = env.reset(seed=[9, 4, 9])
    assert infos["round_seed"][0] == infos["round_seed"][2] != infos["round_seed"][1]
    assert infos["round_seed"][1] == make().reset(seed=4)[1]["round_seed"]
    for array in observations.values():
        np.testing.assert_array_equal(array[0], array[2])


def test_a_game_without_a_seed_continues_its_generator() -> None:
    env, one = make_vector(3), make()
    env.reset(seed=5)
    one.reset(seed=6)
    _, infos = env.reset(seed=[1, None, 1])
    assert infos["round_seed"][1] == one.reset()[1]["round_seed"]
    _, infos = env.reset()
    assert infos["round_seed"][1] == one.reset()[1]["round_seed"]


def test_the_first_reset_without_a_seed_is_random() -> None:
    seeds = [make_vector(2).reset()[1]["round_seed"].tolist() for _ in range(2)]
    assert len({*seeds[0], *seeds[1]}) == 4


@pytest.mark.parametrize(
    ("actions", "message"),
    [
        (np.array([0, 1, 24]), "choice 24 of game 2: candidates are 0 to 23"),
        (np.array([0, -1, 99]), "choice -1 of game 1: candidates are 0 to 23"),
        (np.array([0, 1]), r"3 integers, got int64 of shape \(2,\)"),
        (np.array([[0, 1, 2]]), r"3 integers, got int64 of shape \(1, 3\)"),
        (np.array(1), r"3 integers, got int64 of shape \(\)"),
        (np.array([0.0, 1.0, 2.0]), "3 integers, got float64"),
        (np.array([True, False, True]), "3 integers, got bool"),
        (["a", "b", "c"], "3 integers, got <U1"),
        (None, "3 integers, got object"),
    ],
)
def test_what_are_no_actions_is_named_and_changes_nothing(actions: Any, message: str) -> None:
    env, twin = make_vector(3), make_vector(3)
    env.reset(seed=1)
    twin.reset(seed=1)
    assert env.single_action_space.n == 24
    with pytest.raises(ValueError, match=message):
        env.step(actions)
    good = np.array([0, 1, 23])
    assert same(env.step(good), twin.step(good))


@pytest.mark.parametrize("kind", [list, tuple, np.int32, np.uint8, np.uint64])
def test_any_integers_are_actions(kind: Any) -> None:
    plain, other = make_vector(3), make_vector(3)
    plain.reset(seed=1)
    other.reset(seed=1)
    actions = np.array([2, 0, 23])
    assert same(plain.step(actions), other.step(kind(actions)))


def test_nothing_can_be_asked_before_the_first_reset() -> None:
    env = make_vector(2)
    for ask in (lambda: env.step(np.zeros(2, dtype=np.int64)), env.action_masks, lambda: env.situation):
        with pytest.raises(gym.error.ResetNeeded):
            ask()
    with pytest.raises(gym.error.ResetNeeded, match="all games"):
        env.reset(seed=0, options={"reset_mask": np.array([True, False])})
    env.reset(seed=0, options={"reset_mask": np.array([True, True])})
    env.step(np.zeros(2, dtype=np.int64))


@pytest.mark.parametrize(
    ("mask", "message"),
    [
        (np.zeros(3, dtype=np.bool_), "at least one True"),
        (np.ones(2, dtype=np.bool_), r"bool array of shape \(3,\)"),
        (np.ones(3, dtype=np.int64), "bool array"),
        ([True, True, True], "bool array"),
    ],
)
def test_a_reset_mask_that_does_not_fit_is_refused(mask: Any, message: str) -> None:
    env = make_vector(3)
    env.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        env.reset(options={"reset_mask": mask})


def test_arguments_that_cannot_be_played_are_named() -> None:
    with pytest.raises(ValueError, match="num_envs = 0"):
        PacManBotVectorEnv(0)
    with pytest.raises(ValueError, match=r"'human'.*rgb_array"):
        PacManBotVectorEnv(2, render_mode="human")
    with pytest.raises(ConfigError, match="settings is a Config"):
        PacManBotVectorEnv(2, settings=Config(), preset="ideal")
    with pytest.raises(ValueError, match="2 seeds for 3 games"):
        make_vector(3).reset(seed=[1, 2])


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_what_was_returned_is_never_changed_later(mode: AutoresetMode) -> None:
    env = make_vector(4, autoreset_mode=mode, settings={**QUICK, "time_limit_s": 5.0})
    returned = [env.reset(seed=0), *random_play(env, 50, seed=1)]
    kept = copy.deepcopy(returned)
    random_play(env, 20, seed=2)
    env.reset(seed=7)
    assert same(returned, kept)
    all_arrays = [array for result in returned for array in arrays(result)]
    # each array is memory of its own, so that changing one leaves all others alone
    starts = {array.__array_interface__["data"][0] for array in all_arrays}
    assert len(starts) == len(all_arrays) > 1000
    assert all(array.flags.writeable for array in all_arrays)


def test_action_masks_are_those_of_the_observation() -> None:
    env = make_vector(4, settings=LOSING)
    observations, _ = env.reset(seed=0)
    forbidden = 0
    for k in range(60):
        masks = env.action_masks()
        assert masks.dtype == np.bool_
        np.testing.assert_array_equal(masks, observations["action_mask"] == 1)
        forbidden += int((~masks).sum())
        masks[:] = False  # a copy: the environment does not notice
        assert env.action_masks().any()
        observations, *_ = env.step(np.arange(4) + k // 20)
    assert forbidden > 0


def test_each_game_gets_a_picture() -> None:
    env = make_vector(2, render_mode="rgb_array")
    env.reset(seed=0)
    one = make(render_mode="rgb_array")
    one.reset(seed=1)
    pictures = env.render()
    assert pictures is not None
    assert len(pictures) == 2
    np.testing.assert_array_equal(pictures[1], one.render())
    assert make_vector(2).render() is None


def test_episode_statistics_are_those_of_the_singles() -> None:
    native = gym.wrappers.vector.RecordEpisodeStatistics(make_vector(3, settings=QUICK))
    singles = gym.wrappers.vector.RecordEpisodeStatistics(make_sync(3, AutoresetMode.NEXT_STEP, settings=QUICK))
    native.reset(seed=0)
    singles.reset(seed=0)
    episodes = 0
    for k in range(80):
        actions = np.arange(3) + k // 20
        ours, theirs = native.step(actions)[4], singles.step(actions)[4]
        assert ("episode" in ours) == ("episode" in theirs)
        if "episode" in ours:
            episodes += int(ours["_episode"].sum())
            for key in ("r", "l"):
                np.testing.assert_array_equal(ours["episode"][key], theirs["episode"][key])
    assert episodes >= 3


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_long_episodes_are_cut_as_by_gymnasiums_time_limit(mode: str) -> None:
    arguments: dict[str, Any] = {"map": "loop", "ghosts": "chase", "settings": {"clyde.speed_mps": 0.8}}
    env = gym.make_vec(
        ID, 3, vectorization_mode="vector_entry_point", vector_kwargs=None, max_episode_steps=7,
        autoreset_mode=mode, **arguments,
    )  # fmt: skip
    single = gym.make_vec(
        ID, 3, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode}, max_episode_steps=7, **arguments
    )
    for one in (env, single):
        one.reset(seed=0)
    cut = ended = 0
    for k in range(60):
        actions = np.array([k % 3, 1, (k + 1) % 3])
        (_, *result, infos), (_, *expected, _) = env.step(actions), single.step(actions)
        for one, other in zip(result, expected, strict=True):
            np.testing.assert_array_equal(one, other)
        assert ("final_obs" in infos) == (mode == "SameStep" and bool((result[1] | result[2]).any()))
        cut += int(result[2].sum())
        ended += int(result[1].sum())
        if mode == "Disabled" and (result[1] | result[2]).any():
            for one in (env, single):
                one.reset(options={"reset_mask": result[1] | result[2]})
    assert cut > 5
    assert ended > 0


@pytest.mark.parametrize("steps", [0, -1, 1.5, True, "5"])
def test_a_number_of_steps_that_is_none_is_named(steps: Any) -> None:
    with pytest.raises(ValueError, match=r"max_episode_steps = .*: must be a whole number of at least 1, or None"):
        PacManBotVectorEnv(2, map="loop", max_episode_steps=steps)
