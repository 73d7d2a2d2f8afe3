"""``reset(options=...)``: a round once more, a level, settings for an episode; and what is refused."""

from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import pacman_env
from pacman_env.config import ConfigError, make_config
from pacman_env.envs.infos import OUTCOMES
from pacman_env.envs.pacmanbot import PacManBotEnv
from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv
from pacman_env.envs.resets import ResetOptions
from pacman_env.episodes.rollout import episode_seeds, play
from pacman_env.levels.assets import map_assets
from pacman_env.observations.situation_writer import situation_of
from pacman_env.policies.registry import make_policy
from tests.envs.adapters import Parallel, ParallelVec, Sb3, Single, Turns, Vector
from tests.envs.helpers import same

VECTOR, VECTORS = partial(PacManBotVectorEnv, 4), partial(pacman_env.parallel_vec_env, 4)
MANY = (VECTOR, VECTORS)
INTERFACES = (PacManBotEnv, pacman_env.parallel_env, *MANY)
FAST: dict[str, Any] = {"settings": {"clyde.speed_mps": 0.4}}
SOME = np.array([True, False, False, False])
#: Interfaces, arguments of a reset and what is said of them.
WRONG: list[tuple[tuple[Any, ...], dict[str, Any], str]] = [
    *(
        (INTERFACES, {"options": options}, message)
        for options, message in (
            ({"levl": 1}, r"options\['levl'\]: choose among level, round_seed, settings"),
            ([1], r"options = \[1\]: must be a dictionary or None"),
            ({"round_seed": 2**64}, r"\['round_seed'\] = 18446744073709551616: must be .* to 18446744073709551615"),
            ({"level": "1"}, r"options\['level'\] = '1'"),
            ({"level": 2**63}, r"options\['level'\] = 9223372036854775808: must be a whole number"),
            ({"level": 3}, r"options\['level'\]: levels are for map='generated'"),
            ({"settings": [1]}, r"options\['settings'\] = \[1\]: must be values by the dotted names"),
            ({"settings": {"clyde.sped": 1}}, r"clyde.sped"),
            ({"settings": {"action": "velocity"}}, r"options\['settings'\]: action would change the spaces"),
            ({"settings": {"max_pellets": 40}}, r"options\['settings'\]: max_pellets would change the spaces"),
        )
    ),
    *(
        (INTERFACES, {"seed": seed, "options": FAST}, r"^seed = .*: must be a whole number of at least 0$")
        for seed in (-1, 1.5, np.float64(3.0), True, np.bool_(True), "3")
    ),
    (MANY, {"seed": [1, 2]}, "2 seeds for 4 games"),
    (MANY, {"seed": [1, 2, 3, -3], "options": FAST}, "^seed = -3: must be a whole number"),
    (MANY, {"options": {"level": [1, 2]}}, r"options\['level'\]: 2 numbers for 4 games"),
    ((INTERFACES[1], VECTORS), {"options": {"settings": {"clyde.ghosts": ("wander",)}}}, "clyde.ghosts would change"),
    ((VECTOR,), {"options": {"reset_mask": SOME, **FAST}}, "settings.* are for all games, which are not all reset"),
    ((VECTORS,), {"mask": SOME, "options": FAST}, "settings.* are for all games, which are not all reset"),
]
for mask, message in (
    (np.zeros(4, dtype=np.bool_), "at least one True"),
    (np.ones(2, dtype=np.bool_), r"bool array of shape \(4,\)"),
    (np.ones(4, dtype=np.int64), "bool array"),
    ([True] * 4, "bool array"),
):
    WRONG += [((VECTOR,), {"options": {"reset_mask": mask}}, message), ((VECTORS,), {"mask": mask}, message)]


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
    assert not same(first, second)
    assert same(episode(env, round_seed=first[0][1]["round_seed"]), first)
    env.reset(seed=5)
    env.reset(options={"round_seed": 1})
    assert same([env.reset()], second[:1])


def test_level_option_is_played_with_any_seed() -> None:
    env = PacManBotEnv(map="generated:test", settings={"num_levels": 50})
    shapes = set()
    for level in (1_000_003, 1_000_049, 1_000_000):
        _, info = env.reset(seed=1, options={"level": level})
        assert info["level"] == level
        shapes.add(env.batch.assets_of(0).occupancy.occupancy.shape)
    assert len(shapes) > 1


def test_settings_hold_for_one_episode() -> None:
    env, fast = PacManBotEnv(map="loop"), {"clyde.speed_mps": 0.45}
    before = episode(env, seed=2)
    assert same(episode(env, seed=2, settings=fast), episode(PacManBotEnv(map="loop", settings=fast), seed=2))
    assert env.config.clyde.speed_mps == 0.45
    assert same(episode(env, seed=2), before)
    assert env.config.clyde.speed_mps == 0.25


@pytest.mark.parametrize(("makes", "arguments", "message"), WRONG)
def test_wrong_reset_is_refused_and_changes_nothing(makes: Any, arguments: dict[str, Any], message: str) -> None:
    for make in makes:
        env, untouched = make(map="loop"), make(map="loop")
        for one in (env, untouched):
            one.reset(seed=3)
        with pytest.raises((ValueError, gym.error.Error), match=message):
            env.reset(**arguments)
        assert env.config == untouched.config
        assert same(situation_of(env.batch).arrays(), situation_of(untouched.batch).arrays())
        assert same(env.reset(), untouched.reset())


@pytest.mark.parametrize("adapter", [Single, Vector, Sb3, Parallel, Turns, ParallelVec])
def test_seed_of_any_integer_type_gives_same_episode(adapter: Any) -> None:
    one = adapter(map="loop")
    one.reset(seed=250)
    expected = one.core.batch.games["seed"].copy()
    for seed in (np.int64(250), np.uint8(250)):
        one.reset(seed=seed)
        np.testing.assert_array_equal(one.core.batch.games["seed"], expected)
    with pytest.raises(ValueError, match=r"seed = .*250.*: must be a whole number"):
        one.reset(seed=np.float32(250.0))


@pytest.mark.parametrize(
    ("make", "masked"),
    [(VECTOR, lambda mask: {"options": {"reset_mask": mask}}), (VECTORS, lambda mask: {"mask": mask})],
)
def test_batch_options_are_for_each_game_or_until_all_are_reset(make: Any, masked: Any) -> None:
    env = make(map="generated", autoreset_mode="Disabled", settings={"num_levels": 9})
    with pytest.raises(gym.error.ResetNeeded, match="all games"):
        env.reset(**masked(SOME))
    _, infos = env.reset(seed=0, options={"round_seed": [7, 8, 9, 2**64 - 9], "level": np.array([3, 4, 3, 0])})
    assert infos["round_seed"].tolist() == [7, 8, 9, 2**64 - 9]
    assert infos["level"].tolist() == [3, 4, 3, 0]
    env.reset(**masked(np.ones(4, dtype=np.bool_)), seed=0)
    env.reset(options=FAST)
    env.reset(**masked(SOME))
    assert env.config.clyde.speed_mps == 0.4
    env.reset()
    assert env.config.clyde.speed_mps == 0.25


def test_environments_of_several_agents_take_same_options() -> None:
    env = pacman_env.parallel_env(map="loop")
    _, infos = env.reset(options={"round_seed": 2**64 - 11, "settings": {"clyde.speed_mps": 0.4}})
    assert infos["pacman"]["round_seed"] == 2**64 - 11
    assert env.config.clyde.speed_mps == 0.4
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


@pytest.mark.parametrize("when", ["tick", "event"])
def test_comparison_rounds_end_alike_in_environment(when: str) -> None:
    config = make_config(**{"time_limit_s": 60.0, "decisions.when": when})
    records, _ = play(map_assets("loop", config), config, "nearest", episode_seeds(5, 12))
    env, policy = PacManBotVectorEnv(12, map="loop", settings=config, autoreset_mode="Disabled"), make_policy("nearest")
    env.reset(options={"round_seed": records["seed"]})
    infos: dict[str, Any] = {"outcome": np.full(12, "running")}
    while (infos["outcome"] == "running").any():
        *_, infos = env.step(policy.select(env.situation))
    assert infos["outcome"].tolist() == [OUTCOMES[end] for end in records["end"]]
    for name, key in (("collected", "collected"), ("seed", "round_seed")):
        np.testing.assert_array_equal(infos[key], records[name])
    assert len(set(records["end"])) > 1
