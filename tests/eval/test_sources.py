from __future__ import annotations

import argparse
import re

import numpy as np
import pytest

from eval import sources
from eval.arguments import LEVELS_PLAYED, add_game_arguments
from eval.episodes import episode_seeds
from eval.sources import Levels, open_place, parts_of_play, place_name, places
from pacman_env.config import ConfigError
from pacman_env.sim.generated import TEST_LEVEL, GeneratedMaps
from tests.eval.helpers import CONFIG, LEVELS, LEVELS_CONFIG


def given(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_game_arguments(parser, several=True)
    return parser.parse_args(words)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([], ["house"]),
        (["--map", "maze", "house", "maze"], ["maze", "house"]),
        (["--levels", "test"], [Levels("test", None, LEVELS_PLAYED)]),
        (["--levels", "train", "--start-level", "7", "--num-levels", "3"], [Levels("train", 7, 3)]),
        (["--map", "maze", "--levels", "test"], ["maze", Levels("test")]),
    ],
)
def test_places_are_what_was_asked_for(words: list[str], expected: list[object]) -> None:
    assert places(given(*words)) == expected


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--map", "generated"], "generated houses are given as --levels"),
        (["--map", "house", "generated:test"], "--map generated:test: generated houses are given as --levels"),
        (["--num-levels", "3"], "--num-levels: is for --levels"),
        (["--start-level", "0"], "--start-level: is for --levels"),
    ],
)
def test_what_cannot_be_meant_is_refused(words: list[str], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        places(given(*words))


def test_levels_that_the_split_does_not_have_are_refused() -> None:
    with pytest.raises(ConfigError, match="num_levels = 1001"):
        open_place(Levels("test", None, 1001), CONFIG)
    with pytest.raises(ConfigError, match="start_level = 3"):
        open_place(Levels("test", 3, 1), CONFIG)


def test_levels_are_drawn_and_prepared_as_an_environment_does() -> None:
    ours = open_place(LEVELS, LEVELS_CONFIG)
    theirs = GeneratedMaps.named("generated:test", LEVELS_CONFIG, None, LEVELS.count)
    seeds = episode_seeds(1, 20)
    np.testing.assert_array_equal(ours.levels_of(seeds), theirs.levels_of(seeds))
    for level in (TEST_LEVEL, TEST_LEVEL + 1):
        assert ours.prepare(level).occupancy.hash == theirs.prepare(level).occupancy.hash
    assert ours.first.occupancy.hash == theirs.first.occupancy.hash


def test_a_level_is_prepared_once_for_all_of_clydes_speeds_but_not_for_another_game() -> None:
    sources._prepared.cache_clear()
    for speed in (0.25, 0.4):
        open_place(LEVELS, LEVELS_CONFIG.with_fields(**{"clyde.speed_mps": speed})).prepare(TEST_LEVEL)
    assert sources._prepared.cache_info().misses == 1
    denser = open_place(LEVELS, LEVELS_CONFIG.with_fields(**{"pellets.spacing_m": 1.5})).prepare(TEST_LEVEL)
    assert denser.pellets > open_place(LEVELS, LEVELS_CONFIG).prepare(TEST_LEVEL).pellets


def test_names_are_the_maps_own_and_that_of_the_split() -> None:
    assert [place_name(place, open_place(place, LEVELS_CONFIG)) for place in ("house", LEVELS)] == [
        "house",
        "generated:test",
    ]


def test_parts_hold_every_round_once_and_rounds_of_a_level_together() -> None:
    seeds, many = episode_seeds(0, 400), Levels("test", None, 250)
    levels = open_place(many, LEVELS_CONFIG).levels_of(seeds)
    parts = parts_of_play(many, LEVELS_CONFIG, seeds, 2)
    assert sorted(np.concatenate(parts)) == list(range(400))
    assert len(parts) > 2
    assert all(len(set(levels[part])) < sources._KEPT_LEVELS for part in parts)
    assert (np.diff(levels[np.concatenate(parts)]) >= 0).all()


def test_rounds_on_one_map_are_played_as_they_come() -> None:
    parts = parts_of_play("house", CONFIG, episode_seeds(0, 5), 2)
    assert [part.tolist() for part in parts] == [[0, 1, 2], [3, 4]]
    assert len(parts_of_play("house", CONFIG, episode_seeds(0, 2), 5)) == 2


def test_the_help_names_what_is_played_on_by_default() -> None:
    parser = argparse.ArgumentParser()
    add_game_arguments(parser, several=True)
    assert re.search(rf"{LEVELS_PLAYED}\b", parser.format_help())
