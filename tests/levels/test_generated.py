"""Generated levels: the split, which level an episode gets, and that every level can be played by its files alone."""

import pickle
import re
from pathlib import Path

import numpy as np
import pytest

from pacman_env.config import ConfigError, make_config
from pacman_env.levels.assets import MapAssets
from pacman_env.levels.house_families import HOUSES, LONG_HOUSES, WIDE_HOUSES, HouseFamily
from pacman_env.levels.level import Level
from pacman_env.levels.level_source import TEST_LEVEL, TEST_LEVELS, GeneratedMaps, prepare_level
from pacman_env.world.maps.occupancy import MapError
from pacman_env.world.navigation.paths import UNREACHABLE_CM
from tools.houses import judge

CONFIG = make_config()


@pytest.mark.parametrize(
    ("name", "start", "count", "first", "number"),
    [
        ("generated", None, None, 0, HOUSES.train_set),
        ("generated:train", None, 0, 0, TEST_LEVEL),
        ("generated", 500, None, 500, TEST_LEVEL - 500),
        ("generated:wide", 7, 3, 7, 3),
        ("generated:long", None, None, 0, LONG_HOUSES.train_set),
        ("generated:long:test", None, 0, TEST_LEVEL, TEST_LEVELS),
        ("generated:test", None, None, TEST_LEVEL, HOUSES.test_set),
        ("generated:test", None, 0, TEST_LEVEL, TEST_LEVELS),
        ("generated:test", TEST_LEVEL + 10, 20, TEST_LEVEL + 10, 20),
        ("generated", np.int64(7), np.int32(3), 7, 3),
    ],
)
def test_split_has_its_levels(name: str, start: int | None, count: int | None, first: int, number: int) -> None:
    maps = GeneratedMaps.named(name, CONFIG, start, count)
    assert (maps.start_level, maps.num_levels) == (first, number)
    drawn = maps.levels_of(np.arange(3000, dtype=np.uint64))
    assert first <= drawn.min() <= drawn.max() < first + number
    np.testing.assert_array_equal(maps.levels_of(np.array([17], dtype=np.uint64)), drawn[17:18])
    assert maps.has(np.array([first - 1, first])).tolist() == [False, True]


@pytest.mark.parametrize(
    ("name", "start", "count", "message"),
    [
        ("generated", -1, None, "start_level = -1: generated has the levels 0 to 999999"),
        ("generated", TEST_LEVEL, None, "start_level = 1000000"),
        ("generated", 999_999, 2, "num_levels = 2: generated has 1 levels from 999999 on"),
        ("generated", None, -1, "num_levels = -1"),
        ("generated", True, None, "start_level = True: must be a whole number"),
        ("generated:test", 0, None, "start_level = 0: generated:test has the levels 1000000 to 1000999"),
        ("generated:test", None, 1001, "num_levels = 1001"),
        ("generated:validation", None, None, "map = 'generated:validation': choose one of"),
        ("generated:3,x", None, None, "map = 'generated:3,x': '3,x' must be numbers of levels, separated by commas"),
        ("generated:3,1001000", None, None, "level 1001000: there are the levels 0 to 1000999"),
        ("generated:test:3", None, None, "map = 'generated:test:3': choose one of generated"),
        ("generated:long:test", 7, None, "start_level = 7: generated:long:test has the levels 1000000 to 1000999"),
        ("generated:long:1001000", None, None, "level 1001000: there are the levels 0 to 1000999"),
    ],
)
def test_levels_that_do_not_exist_are_refused(name: str, start: int | None, count: int | None, message: str) -> None:
    with pytest.raises(ConfigError, match=re.escape(message)):
        GeneratedMaps.named(name, CONFIG, start, count)


def test_number_of_named_levels_is_refused() -> None:
    with pytest.raises(ConfigError, match="start_level and num_levels: map = 'generated:3' names its levels"):
        GeneratedMaps.named("generated:3", make_config(num_levels=2))


@pytest.mark.parametrize("family", [HOUSES, WIDE_HOUSES, LONG_HOUSES])
def test_named_levels_alone_are_played(family: HouseFamily) -> None:
    split = family.name
    maps = GeneratedMaps.named(f"{split}:90,3,17", CONFIG)
    assert maps.family == family
    drawn = maps.levels_of(np.arange(300, dtype=np.uint64))
    assert dict(zip(*np.unique(drawn, return_counts=True), strict=True)).keys() == {3, 17, 90}
    assert np.bincount(drawn).max() < 150
    assert maps.has(np.array([3, 4, 17, 90, 91])).tolist() == [True, False, True, True, False]
    assert GeneratedMaps.named(split, CONFIG).has(np.array([5, 5000, TEST_LEVEL])).tolist() == [True, True, False]
    assert pickle.loads(pickle.dumps(maps)).levels.tolist() == [90, 3, 17]


@pytest.mark.parametrize(("family", "fewest", "most"), [(HOUSES, 4, 16), (LONG_HOUSES, 6, 24)])
@pytest.mark.parametrize("first", [0, TEST_LEVEL + 500])
def test_levels_are_playable(first: int, family: HouseFamily, fewest: int, most: int, tmp_path: Path) -> None:
    for level in range(first, first + 5):
        pellets, sealed = judge(level, tmp_path, family)
        assert not sealed
        assert fewest <= pellets <= most


def test_long_houses_keep_within_their_bounds() -> None:
    bounds = GeneratedMaps.named("generated:long", CONFIG)
    (low, high), most = bounds.extent()[0], bounds.most(CONFIG)
    for level in range(20):
        assets = prepare_level(level, CONFIG, LONG_HOUSES)
        plan = assets.occupancy
        assert 75 <= plan.game_free().sum() * plan.resolution**2 <= 160
        corners = plan.origin[:2] + np.array([(0, 0), plan.grey.shape[::-1]]) * plan.resolution
        assert low <= corners.min() <= corners.max() <= high
        assert all(size <= bound for size, bound in zip(Level.of(assets, CONFIG).facts, most, strict=True))


def test_other_spacings_have_room_for_all_pellets() -> None:
    for spacing in (1.0, 3.0):
        config = make_config(**{"pellets.spacing_m": spacing})
        for level in range(3):
            assert 1 <= prepare_level(level, config).pellets <= HOUSES.most_pellets(config)


def test_configuration_without_a_house_is_refused() -> None:
    with pytest.raises(MapError, match=r"generated level 0: none of 60 houses can be played; the last: .*pellet"):
        prepare_level(0, make_config(**{"pellets.spacing_m": 50.0}))


def test_wide_house_has_cells_twice_as_long() -> None:
    wide = prepare_level(5, make_config(**{"pellets.spacing_m": 4.0}), WIDE_HOUSES)
    plain = prepare_level(5, CONFIG)
    house = plain.occupancy
    np.testing.assert_array_equal(wide.occupancy.grey, house.grey)
    assert wide.occupancy.resolution == pytest.approx(2 * house.resolution)
    assert wide.occupancy.origin[:2] == pytest.approx([2 * x for x in house.origin[:2]])
    assert wide.occupancy.name == f"{house.name}-wide"
    assert WIDE_HOUSES.most_pellets(make_config(**{"pellets.spacing_m": 4.0})) == HOUSES.most_pellets(CONFIG) == 16
    assert 1.8 < longest_way(wide) / longest_way(plain) < 2.3


def longest_way(assets: MapAssets) -> float:
    return float(assets.length_cm[assets.length_cm != UNREACHABLE_CM].max())
