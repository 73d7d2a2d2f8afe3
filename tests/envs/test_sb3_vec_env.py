"""The VecEnv of Stable-Baselines3 is its DummyVecEnv of monitored single environments, only faster."""

import copy
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

pytest.importorskip("stable_baselines3")

from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

from pacman_env.policies.registry import make_policy
from pacman_env.sb3 import PacManBotVecEnv
from tests.envs.helpers import ID, QUICK, make_vector, same


def make_dummy(num_envs: int, **arguments: Any) -> DummyVecEnv:
    return DummyVecEnv([lambda: Monitor(gym.make(ID, **arguments)) for _ in range(num_envs)])


def without_time(infos: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Return the infos without how long an episode took, which is checked to be there."""
    infos = copy.deepcopy(infos)
    for info in infos:
        if "episode" in info:
            assert 0 < info["episode"].pop("t") < 600
    return infos


@pytest.mark.parametrize("execution", ["robust", "as_built"])
def test_vec_env_equals_monitored_single_environments(execution: str) -> None:
    settings = {**QUICK, "nav2.abort_rate": 0.3} if execution == "as_built" else QUICK
    native = PacManBotVecEnv(5, settings={**settings, "execution.rules": execution})
    singles = make_dummy(5, settings={**settings, "execution.rules": execution})
    assert native.observation_space == singles.observation_space
    assert native.action_space == singles.action_space
    assert native.seed(3) == singles.seed(3)
    assert same(native.reset(), dict(singles.reset()))
    policy, rng, outcomes, cut = make_policy("nearest"), np.random.default_rng(0), [], 0
    for k in range(120):
        assert same(native.reset_infos, singles.reset_infos), k
        actions = policy.select(native.env.situation)
        actions[0] = rng.integers(native.env.single_action_space.n)
        observations, rewards, dones, infos = native.step(actions)
        theirs = singles.step(actions)
        assert same((observations, rewards, dones), (dict(theirs[0]), *theirs[1:3])), k
        assert same(without_time(infos), without_time(theirs[3])), k
        outcomes += [info["outcome"] for info in infos if "terminal_observation" in info]
        cut += sum(info["TimeLimit.truncated"] for info in infos)
    assert set(outcomes) >= {"caught", "timeout", "cleared" if execution == "as_built" else "complete"}
    assert cut == outcomes.count("timeout")


def test_infos_option_ends_changes_infos_only() -> None:
    whole, short = (
        PacManBotVecEnv(5, settings={**QUICK, "time_limit_s": 8.0, "observation.infos": i}) for i in ("all", "ends")
    )
    for env in (whole, short):
        env.seed(3)
    assert same(whole.reset(), short.reset())
    rng, ended = np.random.default_rng(0), 0
    for _ in range(60):
        actions = rng.integers(whole.env.single_action_space.n, size=5)
        result, other = whole.step(actions), short.step(actions)
        assert same(result[:3], other[:3])
        for done, info, told in zip(result[2], *map(without_time, (result[3], other[3])), strict=True):
            info.pop("terminal_observation", None)
            assert told == (info if done else {})
        ended += int(result[2].sum())
    assert ended > 5
    for bad in (
        {"settings": {"observation.infos": "none"}},
        {"settings": {"observation.infos": "ends"}, "autoreset_mode": "NextStep"},
    ):
        with pytest.raises(ValueError, match="infos = "):
            make_vector(2, **bad)


def test_seeds_and_options_hold_for_one_reset() -> None:
    native, singles = PacManBotVecEnv(2), make_dummy(2)
    for seed in (4, None, 4, None):
        for env in (native, singles):
            if seed is not None:
                env.seed(seed)
                env.set_options({"settings": {"clyde.speed_mps": 0.4}})
        assert same(native.reset(), dict(singles.reset()))
        assert native.env.config.clyde.speed_mps == (0.25 if seed is None else 0.4)
    for options, message in (
        ({"unknown": 1}, "unknown"),
        ([{"round_seed": 1}, {"round_seed": 2}], "same for all games"),
        ({"reset_mask": True}, "all games are reset"),
    ):
        native.set_options(options)
        with pytest.raises(ValueError, match=message):
            native.reset()


def test_masks_are_equal_by_every_call() -> None:
    env = PacManBotVecEnv(64)
    env.reset()
    masks = env.env_method("action_masks")
    np.testing.assert_array_equal(env.env_method("action_masks", indices=[2, 0]), [masks[2], masks[0]])
    np.testing.assert_array_equal([ask() for ask in env.get_attr("action_masks")], masks)


def test_attributes_equal_attributes_of_single_environments() -> None:
    env, dummy = PacManBotVecEnv(3, map="loop"), make_dummy(3, map="loop")
    for one in (env, dummy):
        one.seed(0)
        one.reset()
    for name in ("observation_space", "action_space", "render_mode", "config"):
        assert env.get_attr(name) == dummy.get_attr(name)
        assert env.get_attr(name, 1) == dummy.get_attr(name, 1)
    for ours, theirs in zip(env.get_attr("situation", [2, 0]), dummy.get_attr("situation", [2, 0]), strict=True):
        assert same(ours.arrays(), theirs.arrays())
    assert env.has_attr("batch")
    assert not env.has_attr("nothing")
    for ask, name in ((env.get_attr, "nothing"), (env.env_method, "fly")):
        with pytest.raises(AttributeError, match=name):
            ask(name)
    with pytest.raises(IndexError):
        env.get_attr("config", [0, 3])


def test_attributes_are_set_for_all_or_none() -> None:
    env = PacManBotVecEnv(2)
    env.set_attr("stage", 3)
    env.set_attr("stage", 4, indices=[1, 0])
    with pytest.raises(ValueError, match="stage: must be set for all games"):
        env.set_attr("stage", 5, indices=0)
    assert env.get_attr("stage") == [4, 4]


def test_render_mode_can_be_changed_after_construction() -> None:
    env = PacManBotVecEnv(2)
    env.seed(0)
    env.reset()
    with pytest.warns(UserWarning, match="render mode is None"):
        assert env.get_images() == [None, None]
    assert env.env_method("render") == [None, None]
    env.set_attr("render_mode", "rgb_array")
    assert env.get_attr("render_mode") == ["rgb_array"] * 2
    images = env.get_images()
    np.testing.assert_array_equal(env.env_method("render", indices=1)[0], images[1])
    tiled = env.render()
    assert tiled is not None
    assert tiled.shape == (2 * images[0].shape[0], *images[0].shape[1:])
    with pytest.raises(ValueError, match=r"'human'.*rgb_array"):
        env.set_attr("render_mode", "human")
    env.set_attr("render_mode", None)
    assert env.get_attr("render_mode") == [None, None]


def test_monitor_is_built_in_unless_turned_off() -> None:
    ours = PacManBotVecEnv(2, flat=True, map="loop", settings=QUICK)
    theirs = VecMonitor(PacManBotVecEnv(2, flat=True, map="loop", settings=QUICK, monitor=False))
    assert ours.env_is_wrapped(Monitor) == [True, True]
    assert theirs.env_is_wrapped(Monitor) == ours.env_is_wrapped(gym.wrappers.TimeLimit) == [False, False]
    with pytest.warns(UserWarning, match="already wrapped with a `Monitor`"):
        VecMonitor(ours)
    episodes: list[list[tuple[float, int]]] = []
    for env in (ours, theirs):
        env.reset()
        env.step(np.zeros(2, dtype=np.int64))
        env.seed(0)
        env.reset()  # in mid-episode: its count begins again
        steps = (env.step(np.zeros(2, dtype=np.int64))[-1] for _ in range(40))
        found = [info["episode"] for infos in steps for info in infos if "episode" in info]
        episodes.append([(pytest.approx(one["r"], abs=1e-5), one["l"]) for one in found])
    assert episodes[0] == episodes[1] != []


def test_given_vector_environment_is_used() -> None:
    vector = make_vector(3, map="loop", autoreset_mode=AutoresetMode.SAME_STEP, render_mode="rgb_array")
    env = PacManBotVecEnv(vector)
    assert env.env is vector
    assert env.num_envs == 3
    assert env.render_mode == "rgb_array"
    env.close()
    assert vector.closed


def given(**more: Any) -> PacManBotVecEnv:
    return PacManBotVecEnv(make_vector(2, autoreset_mode=AutoresetMode.SAME_STEP), **more)


@pytest.mark.parametrize(
    ("build", "error", "message"),
    [
        (lambda: PacManBotVecEnv(make_vector(2)), ValueError, r"NEXT_STEP.*needs AutoresetMode.SAME_STEP"),
        (lambda: PacManBotVecEnv(2, autoreset_mode=AutoresetMode.DISABLED), ValueError, "DISABLED"),
        (lambda: given(map="loop"), TypeError, r"\['map'\] must not be given with an existing environment"),
        (lambda: given(flat=True), TypeError, r"\['flat'\] must not be given with an existing environment"),
        (lambda: PacManBotVecEnv("house"), TypeError, "'house': must be a number of games"),
        (lambda: PacManBotVecEnv(True), TypeError, "True: must be a number"),
    ],
)
def test_unsuitable_argument_is_named(build: Callable[[], Any], error: type[Exception], message: str) -> None:
    with pytest.raises(error, match=message):
        build()
