"""``reset(options=...)``: a round once more, a level, settings for an episode; and what is refused."""

from __future__ import annotations

from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import pacman_env
from pacman_env.config import ConfigError, make_config
from pacman_env.envs.outcome import OUTCOMES
from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv
from pacman_env.envs.resets import ResetOptions
from pacman_env.episodes.rollout import episode_seeds, play
from pacman_env.policies.registry import make_policy
from pacman_env.sim.maps.assets import map_assets
from tests.envs.helpers import same

INTERFACES = [PacManBotEnv, partial(PacManBotVectorEnv, 2), pacman_env.parallel_env]


def episode(env: PacManBotEnv, *, seed: int | None = None, **options: Any) -> list[Any]:
    seen: list[Any] = [env.reset(seed=seed, options=options or None)]
    for k in range(40):
        seen.append(env.step(k % 5))
        if seen[-1][2]:
            break
    return seen


@pytest.mark.parametrize("source", ["loop", "generated"])
def test_round_seed_repeats_episode_and_draws_nothing(source: str) -> None:
    env = PacManBotEnv(map=source)
    first = episode(env, seed=5)
    second = episode(env)
    assert same(episode(env, round_seed=first[0][1]["round_seed"]), first)
    env.reset(seed=5)
    env.reset(options={"round_seed": 1})
    assert same([env.reset()], second[:1])


@pytest.mark.parametrize("kind", ["single", "vector", "sb3"])
def test_comparison_round_ends_alike_in_environment(kind: str) -> None:
    config = make_config(time_limit_s=60.0)
    records, _ = play(map_assets("loop", config), config, "nearest", episode_seeds(5, 12))
    records = records[records["seed"] >= 2**63]
    if kind == "sb3":
        pytest.importorskip("stable_baselines3")
        from pacman_env.sb3 import PacManBotVecEnv as Made
    else:
        Made = {"single": lambda _, **more: PacManBotEnv(**more), "vector": PacManBotVectorEnv}[kind]
    env: Any = Made(1, map="loop", settings=config)
    game = env.env if kind == "sb3" else env
    ends = []
    for record in records:
        policy, options = make_policy("nearest"), {"round_seed": int(record["seed"])}
        if kind == "sb3":
            env.set_options(options)
        env.reset(**({} if kind == "sb3" else {"options": options}))
        policy.reset(np.ones(1, dtype=np.bool_), config)
        assert game.situation.seed == record["seed"]
        outcome = "running"
        while outcome == "running":
            action = game.action_of(policy.select(game.situation))
            *_, infos = env.step(action[0] if kind == "single" else action)
            told = infos[0] if kind == "sb3" else infos
            outcome, collected, seed = (np.ravel(told[key])[0] for key in ("outcome", "collected", "round_seed"))
        ends.append((outcome, collected, seed))
    assert ends == [(OUTCOMES[one["end"]], one["collected"], one["seed"]) for one in records]
    assert len(set(ends)) > 1


def test_level_option_is_played_with_any_seed() -> None:
    env = PacManBotEnv(map="generated:test", settings={"num_levels": 50})
    shapes = set()
    for level in (1_000_003, 1_000_049, 1_000_000):
        _, info = env.reset(seed=1, options={"level": level})
        assert info["level"] == level
        shapes.add(env.batch.assets_of(0).occupancy.occupancy.shape)
    assert len(shapes) > 1
    with pytest.raises(ConfigError, match=r"'level'\] = 3: the environment has the levels 1000000 to 1000049"):
        env.reset(options={"level": 3})


def test_settings_hold_for_one_episode() -> None:
    env, fast = PacManBotEnv(map="loop"), {"clyde.speed_mps": 0.45}
    before = episode(env, seed=2)
    assert same(episode(env, seed=2, settings=fast), episode(PacManBotEnv(map="loop", settings=fast), seed=2))
    assert env.config.clyde.speed_mps == 0.45
    assert same(episode(env, seed=2), before)
    assert env.config.clyde.speed_mps == 0.25


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"levl": 1}, r"options\['levl'\]: choose among level, round_seed, settings"),
        ([1], r"options = \[1\]: must be a dictionary or None"),
        ({"round_seed": 2**64}, r"options\['round_seed'\] = 18446744073709551616: must be .* to 18446744073709551615"),
        ({"level": "1"}, r"options\['level'\] = '1'"),
        ({"level": 2**63}, r"options\['level'\] = 9223372036854775808: must be a whole number"),
        ({"level": 3}, r"options\['level'\]: levels are for map='generated'"),
        ({"settings": [1]}, r"options\['settings'\] = \[1\]: must be values by the dotted names"),
        ({"settings": {"clyde.sped": 1}}, r"clyde.sped"),
        ({"settings": {"clyde.speed_mps": -1}}, r"clyde.speed_mps"),
        ({"settings": {"action": "velocity"}}, r"options\['settings'\]: action would change the spaces"),
        ({"settings": {"max_pellets": 40}}, r"options\['settings'\]: max_pellets would change the spaces"),
    ],
)
def test_wrong_options_are_refused_and_change_nothing(options: Any, message: str) -> None:
    env, untouched = (PacManBotEnv(map="loop") for _ in range(2))
    for one in (env, untouched):
        one.reset(seed=3)
    with pytest.raises(ValueError, match=message):
        env.reset(options=options)
    assert same(env.step(1), untouched.step(1))
    assert same(env.reset(), untouched.reset())


def test_batches_take_one_value_or_one_per_game() -> None:
    env = PacManBotVectorEnv(3, map="generated", autoreset_mode="SameStep")
    observations, infos = env.reset(seed=0, options={"round_seed": [7, 8, 9], "level": np.array([3, 4, 3])})
    assert infos["round_seed"].tolist() == [7, 8, 9]
    assert infos["level"].tolist() == [3, 4, 3]
    single = PacManBotEnv(map="generated")
    for k, level in enumerate((3, 4, 3)):
        observation, _ = single.reset(options={"round_seed": 7 + k, "level": level})
        assert same({key: array[k] for key, array in observations.items()}, observation)
    with pytest.raises(ValueError, match=r"options\['level'\]: 2 numbers for 3 games"):
        env.reset(options={"level": [1, 2]})


def test_batch_settings_hold_until_all_are_reset() -> None:
    env = PacManBotVectorEnv(2, map="loop", autoreset_mode="Disabled")
    env.reset(seed=0, options={"settings": {"clyde.speed_mps": 0.4}})
    mask = np.array([True, False])
    env.reset(options={"reset_mask": mask})
    assert env.config.clyde.speed_mps == 0.4
    with pytest.raises(ValueError, match=r"settings.* are for all games, which are not all reset"):
        env.reset(options={"reset_mask": mask, "settings": {"clyde.speed_mps": 0.3}})
    env.reset()
    assert env.config.clyde.speed_mps == 0.25


def test_environments_of_several_agents_take_same_options() -> None:
    env = pacman_env.parallel_env(map="loop")
    _, infos = env.reset(options={"round_seed": 2**64 - 11, "settings": {"clyde.speed_mps": 0.4}})
    assert infos["pacman"]["round_seed"] == 2**64 - 11
    assert env.config.clyde.speed_mps == 0.4
    with pytest.raises(ValueError, match="levl"):
        env.reset(options={"levl": 1})
    turns = pacman_env.env(map="loop")
    turns.reset(options={"round_seed": 11})
    assert turns.infos["pacman"]["round_seed"] == 11


@settings(max_examples=40)
@given(st.one_of(st.integers(), st.floats(), st.text(), st.none(), st.booleans(), st.lists(st.integers(), max_size=4)))
@example(-1)
@example(True)
@example(2**64 - 1)
@example([16452687389592421897, 0, 2**63])
def test_round_seed_is_accepted_or_refused_with_reason(given_: Any) -> None:
    try:
        taken = ResetOptions.of({"round_seed": given_}, 3).round_seed
    except ValueError as error:
        assert "options['round_seed']" in str(error)  # noqa: PT017
        return
    if given_ is None:
        assert taken is None
        return
    assert taken is not None
    assert not isinstance(given_, bool)
    assert taken.tolist() == (given_ if isinstance(given_, list) else [given_] * 3)
    assert all(0 <= one < 2**64 for one in taken.tolist())


@pytest.mark.parametrize("make", INTERFACES)
def test_level_must_belong_to_settings_of_reset(make: Any) -> None:
    env = make(map="generated", settings={"num_levels": 6})
    env.reset(seed=0)
    with pytest.raises(ConfigError, match=r"options\['level'\] = 5: the environment has the levels 0 to 4"):
        env.reset(options={"settings": {"num_levels": 5}, "level": 5})
    assert env.config.num_levels == 6
    env.reset(options={"settings": {"num_levels": 9}, "level": 8})
    assert env.config.num_levels == 9
    assert set(env.batch.level_numbers().tolist()) == {8}


@pytest.mark.parametrize("make", INTERFACES)
def test_wrong_seed_with_settings_changes_nothing(make: Any) -> None:
    env, other = make(map="loop"), make(map="loop")
    assert same(env.reset(seed=0), other.reset(seed=0))
    for seed, message in ((-1, "-1"), (1.5, "integer|seed = 1.5: must be a whole number")):
        with pytest.raises((ValueError, gym.error.Error), match=message):
            env.reset(seed=seed, options={"settings": {"clyde.speed_mps": 0.4}})
        assert env.config.clyde.speed_mps == other.config.clyde.speed_mps
    assert same(env.reset(), other.reset())
