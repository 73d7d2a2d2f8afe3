"""Generated levels: the split, which level an episode gets, and that every level can be played by its files alone."""

from __future__ import annotations

import hashlib
import pickle
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from pacman_env.config import ConfigError, make_config
from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv
from pacman_env.evaluation.checks.generated_levels import judge
from pacman_env.sim.maps.assets import MapAssets
from pacman_env.sim.maps.level_source import (
    TEST_LEVEL,
    TEST_LEVELS,
    TEST_SET,
    TRAIN_SET,
    WIDE,
    GeneratedMaps,
    most_pellets,
    prepare_level,
)
from pacman_env.world.maps.occupancy import MapError
from pacman_env.world.navigation.paths import UNREACHABLE_CM

ROOT = Path(__file__).resolve().parents[3]
CONFIG = make_config()


@pytest.mark.parametrize(
    ("name", "start", "count", "first", "number"),
    [
        ("generated", None, None, 0, TRAIN_SET),
        ("generated:train", None, 0, 0, TEST_LEVEL),
        ("generated", 500, None, 500, TEST_LEVEL - 500),
        ("generated", 7, 3, 7, 3),
        ("generated", TEST_LEVEL - 1, 1, TEST_LEVEL - 1, 1),
        ("generated:wide", 7, 3, 7, 3),
        ("generated:test", None, None, TEST_LEVEL, TEST_SET),
        ("generated:test", None, 0, TEST_LEVEL, TEST_LEVELS),
        ("generated:test", TEST_LEVEL + 10, 20, TEST_LEVEL + 10, 20),
        ("generated", np.int64(7), np.int32(3), 7, 3),
    ],
)
def test_a_split_has_the_levels_asked_for(
    name: str, start: int | None, count: int | None, first: int, number: int
) -> None:
    maps = GeneratedMaps.named(name, CONFIG, start, count)
    assert (maps.start_level, maps.num_levels) == (first, number)
    drawn = maps.levels_of(np.arange(3000, dtype=np.uint64))
    assert first <= drawn.min() <= drawn.max() < first + number


def test_training_and_testing_have_no_level_in_common() -> None:
    train = GeneratedMaps.named("generated", CONFIG, None, None)
    test = GeneratedMaps.named("generated:test", CONFIG, None, None)
    assert train.start_level + train.num_levels <= test.start_level


@pytest.mark.parametrize(
    ("name", "start", "count", "message"),
    [
        ("generated", -1, None, "start_level = -1: generated has the levels 0 to 999999"),
        ("generated", TEST_LEVEL, None, "start_level = 1000000"),
        ("generated", 999_999, 2, "num_levels = 2: generated has 1 levels from 999999 on"),
        ("generated", None, -1, "num_levels = -1"),
        ("generated", None, 2.0, r"num_levels = 2\.0: must be a whole number"),
        ("generated", True, None, "start_level = True: must be a whole number"),
        ("generated:test", 0, None, "start_level = 0: generated:test has the levels 1000000 to 1000999"),
        ("generated:test", None, 1001, "num_levels = 1001"),
        ("generated:validation", None, None, "map = 'generated:validation': choose one of"),
    ],
)
def test_levels_outside_the_split_are_refused(name: str, start: int | None, count: int | None, message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        GeneratedMaps.named(name, CONFIG, start, count)


@pytest.mark.parametrize(("split", "scale"), [("generated", 1), ("generated:wide", WIDE)])
def test_levels_that_are_named_are_played_and_no_others(split: str, scale: int) -> None:
    maps = GeneratedMaps.named(f"{split}:90,3,17", CONFIG)
    assert maps.scale == scale
    drawn = maps.levels_of(np.arange(300, dtype=np.uint64))
    assert dict(zip(*np.unique(drawn, return_counts=True), strict=True)).keys() == {3, 17, 90}
    assert np.bincount(drawn).max() < 150
    assert maps.has(np.array([3, 4, 17, 90, 91])).tolist() == [True, False, True, True, False]
    assert pickle.loads(pickle.dumps(maps)).levels.tolist() == [90, 3, 17]


def test_levels_in_a_row_that_are_named_are_the_levels_of_the_settings() -> None:
    seeds = np.arange(100, dtype=np.uint64)
    named, set_up = GeneratedMaps.named("generated:7,8,9", CONFIG), GeneratedMaps(CONFIG, 7, 3)
    np.testing.assert_array_equal(named.levels_of(seeds), set_up.levels_of(seeds))


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        ("generated:3,x", {}, "map = 'generated:3,x': '3,x' must be numbers of levels, separated by commas"),
        ("generated:3,1001000", {}, "level 1001000: there are the levels 0 to 1000999"),
        ("generated:test:3", {}, "map = 'generated:test:3': choose one of generated"),
        ("generated:3", {"num_levels": 2}, "start_level and num_levels: map = 'generated:3' names its levels"),
    ],
)
def test_levels_that_are_named_wrongly_are_refused(name: str, settings: dict[str, int], message: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(message)):
        GeneratedMaps.named(name, make_config(**settings))


def test_levels_are_drawn_uniformly_from_the_seeds() -> None:
    maps, seeds = GeneratedMaps(CONFIG, 50, 20), np.arange(8000, dtype=np.uint64)
    counts = np.bincount(maps.levels_of(seeds) - 50, minlength=20)
    assert counts.sum() == 8000
    assert ((counts - 400) ** 2 / 400).sum() < 44  # chi-squared, 19 degrees of freedom: one seed table in 1,000
    np.testing.assert_array_equal(maps.levels_of(seeds[17:18]), maps.levels_of(seeds)[17:18])


def test_info_names_the_level_that_is_played() -> None:
    env = PacManBotVectorEnv(6, map="generated", settings={"time_limit_s": 2.0, "start_level": 20, "num_levels": 4})
    infos = env.reset(seed=0)[1]
    seen = set()
    for k in range(25):
        expected = env.batch.source.levels_of(infos["round_seed"].astype(np.uint64))
        np.testing.assert_array_equal(infos["level"], expected)
        assert infos["level"].dtype == np.int64
        for i, level in enumerate(infos["level"].tolist()):
            assert env.batch.assets_of(i).occupancy.name == f"generated-{level}"
            assert infos["spawned"][i] == env.batch.assets_of(i).pellets
        seen |= set(infos["level"].tolist())
        infos = env.step(np.full(6, k % 3))[4]
    assert seen == {20, 21, 22, 23}


def level_digest() -> str:
    state = hashlib.sha256()
    for level in (0, 3, TEST_LEVEL, TEST_LEVEL + 8):
        assets = prepare_level(level, CONFIG)
        state.update(assets.occupancy.hash.encode())
        for array in (assets.goal_xy, assets.length_cm, assets.clyde.position, assets.spawn_cells, assets.grid.home):
            state.update(np.ascontiguousarray(array).tobytes())
    return state.hexdigest()


def test_a_level_is_the_same_map_in_another_process() -> None:
    code = "from tests.sim.maps.test_generated import level_digest; print(level_digest())"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == level_digest()


@pytest.mark.parametrize("first", [0, 100, TEST_LEVEL, TEST_LEVEL + 500])
def test_levels_are_playable_by_what_their_files_say(first: int, tmp_path: Path) -> None:
    for level in range(first, first + 6):
        pellets, reason = judge(level, tmp_path)
        assert not reason
        assert 4 <= pellets <= 16


def test_levels_differ() -> None:
    assert len({prepare_level(level, CONFIG).occupancy.hash for level in (0, 1, 2, 3, TEST_LEVEL, TEST_LEVEL + 1)}) == 6


@pytest.mark.parametrize("spacing", [1.0, 1.5, 3.0])
def test_other_spacings_have_room_for_all_pellets(spacing: float) -> None:
    config = make_config(**{"pellets.spacing_m": spacing})
    for level in range(5):
        assert 1 <= prepare_level(level, config).pellets <= most_pellets(config)


def test_a_configuration_that_no_house_fits_is_refused_with_the_reason() -> None:
    with pytest.raises(MapError, match=r"generated level 0: none of 60 houses can be played; the last: .*pellet"):
        prepare_level(0, make_config(**{"pellets.spacing_m": 50.0}))


def test_a_copy_has_the_same_levels() -> None:
    maps = GeneratedMaps(CONFIG, 5, 9)
    home = maps.first.grid.home
    other = pickle.loads(pickle.dumps(maps))
    seeds = np.arange(100, dtype=np.uint64)
    np.testing.assert_array_equal(other.levels_of(seeds), maps.levels_of(seeds))
    np.testing.assert_array_equal(other.first.grid.home, home)
    assert other.extent() == maps.extent()


@pytest.mark.parametrize("level", [0, 5])
def test_a_wide_house_is_the_same_picture_with_cells_twice_as_long(level: int) -> None:
    wide = prepare_level(level, make_config(**{"pellets.spacing_m": 4.0}), WIDE)
    plain = prepare_level(level, CONFIG)
    house = plain.occupancy
    np.testing.assert_array_equal(wide.occupancy.grey, house.grey)
    assert wide.occupancy.resolution == pytest.approx(2 * house.resolution)
    assert wide.occupancy.origin[:2] == pytest.approx([2 * x for x in house.origin[:2]])
    assert wide.occupancy.name == f"{house.name}-wide"
    assert 1.8 < longest_way(wide) / longest_way(plain) < 2.3


def longest_way(assets: MapAssets) -> float:
    return float(assets.length_cm[assets.length_cm != UNREACHABLE_CM].max())


def test_wide_levels_have_as_many_pellets_farther_apart_and_positions_within_the_space() -> None:
    env = PacManBotVectorEnv(6, map="generated:wide", settings={"pellets.spacing_m": 4.0, "num_levels": 6})
    plain = PacManBotVectorEnv(6, map="generated", settings={"num_levels": 6})
    assert env.batch.pellet_slots == plain.batch.pellet_slots == 16
    ways = []
    for each in (env, plain):
        each.reset(seed=0)
        ways.append(each.situation.path_robot[each.situation.mask].max())
    assert ways[0] > 1.5 * ways[1]
    for _ in range(20):
        observation, *_ = env.step(env.action_space.sample())
        assert env.observation_space.contains(observation)
    pellets = env.situation.pellets_left
    assert pellets.min() >= 1
    assert pellets.max() <= 16
