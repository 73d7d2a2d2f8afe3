"""The native vector environment is many single environments in Gymnasium's layout."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium import wrappers
from gymnasium.vector import AutoresetMode, SyncVectorEnv

from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv
from pacman_env.envs.registration import IDS
from pacman_env.observations.situation import Situation
from pacman_env.policies.base import BasePolicy
from pacman_env.policies.registry import make_policy
from tests.envs.cases import PAIRWISE, SMALL, arguments, name
from tests.envs.helpers import ID, QUICK, make, make_vector, same

LOSING = {**QUICK, "nav2.abort_rate": 0.3, "execution.rules": "as_built"}
MODES = tuple(AutoresetMode)


def make_sync(num_envs: int, mode: AutoresetMode, **arguments: Any) -> SyncVectorEnv:
    return SyncVectorEnv([lambda: gym.make(ID, **arguments)] * num_envs, autoreset_mode=mode)


def equal_steps(native: Any, singles: Any, actions: np.ndarray, mode: AutoresetMode, seed: Any = None) -> Any:
    """Step both, reset what is over if they do not, and return the results of the native one."""
    ours, theirs = native.step(actions), singles.step(actions)
    assert same(ours, theirs)
    over = ours[2] | ours[3]
    if mode == AutoresetMode.DISABLED and over.any():
        both = [env.reset(seed=seed, options={"reset_mask": over.copy()}) for env in (native, singles)]
        assert same(*both)
        np.testing.assert_array_equal(both[0][1]["_outcome"], over)
    return ours


class Patrol(BasePolicy):
    """Sends its ghost to a place that time and seed tell."""

    name = "patrol"

    def select(self, situation: Situation) -> np.ndarray:
        return (situation.tick // 5 + (situation.seed % 7).astype(np.int64)) % situation.mask.shape[1]


EVENTS = {**SMALL, "time_limit_s": 4.0, "decisions.when": "event"}
CASES = {name(row): arguments(row, time_limit_s=4.0) for row in PAIRWISE}
CASES["events, endless"] = {"settings": {**EVENTS, "execution.pickup_radius_m": 3.0, "endless": True}}
CASES["events, policy"] = {"map": "generated", "ghosts": ["chase", Patrol()], "settings": {**EVENTS, "num_levels": 3}}


@pytest.mark.parametrize(("k", "case"), list(enumerate(CASES)))
def test_vector_equals_single_environments(k: int, case: str) -> None:
    mode, chosen = MODES[k % 3], CASES[case]
    native, singles = make_vector(3, autoreset_mode=mode, num_threads=1 + k % 2, **chosen), make_sync(3, mode, **chosen)
    assert native.observation_space == singles.observation_space
    assert native.action_space == singles.action_space
    native.action_space.seed(1)
    assert same(native.reset(seed=5), singles.reset(seed=5))
    ended = 0
    for _ in range(30):
        result = equal_steps(native, singles, native.action_space.sample(), mode)
        ended += int((result[2] | result[3]).sum())
    assert ended > 3


@pytest.mark.parametrize("settings", [QUICK, LOSING], ids=["robust", "as_built"])
@pytest.mark.parametrize("mode", MODES)
def test_vector_equals_single_environments_at_every_end(mode: AutoresetMode, settings: dict[str, Any]) -> None:
    native, singles = make_vector(5, autoreset_mode=mode, settings=settings), make_sync(5, mode, settings=settings)
    assert native.metadata["autoreset_mode"] == mode
    assert same(native.reset(seed=3), singles.reset(seed=3))
    policy, rng, seen = make_policy("nearest"), np.random.default_rng(0), set()
    for k in range(120):
        actions = policy.select(native.situation)
        actions[0] = rng.integers(native.single_action_space.n)
        seed = None if k % 2 else [100 * k + i for i in range(5)]
        infos = equal_steps(native, singles, actions, mode, seed)[4]
        seen.update(infos.get("final_info", infos)["outcome"])
    assert seen >= {"caught", "timeout", "complete" if settings is QUICK else "cleared"}


@pytest.mark.parametrize("env_id", IDS)
def test_vector_of_id_plays_game_of_id(env_id: str) -> None:
    games, single = gym.make_vec(env_id, num_envs=2).unwrapped, gym.make(env_id).unwrapped
    assert isinstance(games, PacManBotVectorEnv)
    assert games.metadata["autoreset_mode"] == AutoresetMode.NEXT_STEP
    assert games.config == single.config
    assert games.batch.assets.occupancy.name == single.batch.assets.occupancy.name


def test_reset_takes_one_seed_per_game() -> None:
    env, one = make_vector(3), make()
    observations, infos = env.reset(seed=[9, np.int64(4), np.uint8(9)])
    assert infos["round_seed"][0] == infos["round_seed"][2] != infos["round_seed"][1]
    assert infos["round_seed"][1] == one.reset(seed=4)[1]["round_seed"]
    assert all(same(array[0], array[2]) for array in observations.values())
    _, infos = env.reset(seed=[1, None, 1])  # a game without a seed continues its generator
    assert infos["round_seed"][1] == one.reset()[1]["round_seed"]
    with pytest.raises(ValueError, match="2 seeds for 3 games"):
        env.reset(seed=[1, 2])


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_max_episode_steps_cut_like_gymnasium_time_limit(mode: str) -> None:
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
        assert all(np.array_equal(one, other) for one, other in zip(result, expected, strict=True))
        over = result[1] | result[2]
        assert ("final_obs" in infos) == (mode == "SameStep" and bool(over.any()))
        cut, ended = cut + int(result[2].sum()), ended + int(result[1].sum())
        if mode == "Disabled" and over.any():
            for one in (env, single):
                one.reset(options={"reset_mask": over})
    assert cut > 5
    assert ended > 0


@pytest.mark.parametrize(
    ("wrap", "mode"),
    [
        *((wrappers.vector.NormalizeReward, mode) for mode in MODES),
        *(
            (wrappers.vector.RecordEpisodeStatistics, mode)
            for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.SAME_STEP)
        ),
        *((wrappers.vector.FlattenObservation, mode) for mode in (AutoresetMode.NEXT_STEP, AutoresetMode.DISABLED)),
    ],
)
def test_vector_wrappers_behave_like_single_environments(wrap: Any, mode: AutoresetMode) -> None:
    native, singles = (
        wrap(make_vector(4, settings=QUICK, autoreset_mode=mode)),
        wrap(make_sync(4, mode, settings=QUICK)),
    )
    assert native.observation_space == singles.observation_space
    policy, episodes = make_policy("nearest"), 0
    assert same(native.reset(seed=2), singles.reset(seed=2))
    for _ in range(90):
        actions = policy.select(native.unwrapped.situation)
        ours, theirs = native.step(actions), singles.step(actions)
        for infos in (ours[4], theirs[4]):
            infos.get("episode", {}).pop("t", None)  # real time
        assert same(ours, theirs)
        over = ours[2] | ours[3]
        episodes += int(over.sum())
        if mode == AutoresetMode.DISABLED and over.any():
            assert same(*[env.reset(options={"reset_mask": over.copy()}) for env in (native, singles)])
    assert episodes >= 4


def test_episode_statistics_are_correct_without_autoreset() -> None:
    """Gymnasium's own vector of single environments loses the mask of the reset, and with it the counts."""
    env = wrappers.vector.RecordEpisodeStatistics(make_vector(4, settings=QUICK, autoreset_mode="Disabled"))
    env.reset(seed=2)
    policy, returns, lengths, episodes = make_policy("nearest"), np.zeros(4), np.zeros(4, dtype=int), 0
    for _ in range(90):
        _, rewards, terminated, truncated, infos = env.step(policy.select(env.unwrapped.situation))
        returns, lengths, over = returns + rewards, lengths + 1, terminated | truncated
        if over.any():
            np.testing.assert_allclose(infos["episode"]["r"], np.where(over, returns, 0))
            np.testing.assert_array_equal(infos["episode"]["l"], np.where(over, lengths, 0))
            returns[over] = lengths[over] = 0
            episodes += int(over.sum())
            env.reset(options={"reset_mask": over})
    assert env.episode_count == episodes >= 4


def test_views_are_overwritten_two_steps_later() -> None:
    copies, views = (make_vector(4, map="house", copy=one) for one in (True, False))
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
