from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pytest

from pacman_env.config import ConfigError
from pacman_env.episodes.rollout import episode_seeds
from pacman_env.evaluation.rounds import scenarios as sources
from pacman_env.evaluation.rounds.scenarios import (
    LEVELS_PLAYED,
    Levels,
    add_game_arguments,
    describe_scenario,
    from_arguments,
    named_scenarios,
    open_scenario,
    parts_of_play,
)
from pacman_env.sim.maps.level_source import TEST_LEVEL, GeneratedMaps
from pacman_env.world.maps.occupancy import MapError, load_map
from tests.evaluation.helpers import CONFIG, LEVELS, LEVELS_CONFIG


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
def test_arguments_become_maps_and_levels(words: list[str], expected: list[object]) -> None:
    assert from_arguments(given(*words)) == expected


def test_levels_equal_levels_of_environment() -> None:
    ours = open_scenario(LEVELS, LEVELS_CONFIG)
    theirs = GeneratedMaps.named("generated:test", LEVELS_CONFIG, None, LEVELS.count)
    seeds = episode_seeds(1, 20)
    np.testing.assert_array_equal(ours.levels_of(seeds), theirs.levels_of(seeds))
    for level in (TEST_LEVEL, TEST_LEVEL + 1):
        assert ours.prepare(level).assets.occupancy.hash == theirs.prepare(level).assets.occupancy.hash
    assert ours.first.occupancy.hash == theirs.first.occupancy.hash


def test_level_is_prepared_once_for_all_ghost_speeds() -> None:
    sources._prepared.cache_clear()
    for speed in (0.25, 0.4):
        config = LEVELS_CONFIG.with_fields(**{"clyde.speed_mps": speed, "endless": speed > 0.3})
        open_scenario(LEVELS, config).prepare(TEST_LEVEL)
    assert sources._prepared.cache_info().misses == 1
    denser = open_scenario(LEVELS, LEVELS_CONFIG.with_fields(**{"pellets.spacing_m": 1.5})).prepare(TEST_LEVEL)
    assert denser.assets.pellets > open_scenario(LEVELS, LEVELS_CONFIG).prepare(TEST_LEVEL).assets.pellets


def test_level_is_prepared_once_for_all_ghost_behaviours() -> None:
    sources._prepared.cache_clear()
    for ghosts in (("wander",), ("chase",), ("arcade", "chase"), ("wander", "arcade", "chase", "wander")):
        config = LEVELS_CONFIG.with_fields(**{"clyde.ghosts": ghosts})
        ours = open_scenario(LEVELS, config).prepare(TEST_LEVEL).assets
        assert "ghost_targets" in vars(ours)  # computed beforehand, not while games are played
    assert sources._prepared.cache_info().misses == 1
    theirs = GeneratedMaps.named("generated:test", config, None, LEVELS.count).prepare(TEST_LEVEL).assets
    assert ours.occupancy.hash == theirs.occupancy.hash
    for name, array in ours.ghost_targets._asdict().items():
        np.testing.assert_array_equal(array, getattr(theirs.ghost_targets, name))


def test_scenarios_are_named_by_map_or_split(tmp_path: Path) -> None:
    file = str(load_map("maze").save(tmp_path / "maze.yaml"))
    assert named_scenarios(["house", file, LEVELS], [LEVELS_CONFIG]) == {
        "house": "house",
        "maze": file,
        "generated:test": LEVELS,
    }


def test_ambiguous_or_unplayable_scenarios_are_refused(tmp_path: Path) -> None:
    load_map("maze").save(tmp_path / "maze.yaml")
    with pytest.raises(ValueError, match="two maps are called maze"):
        named_scenarios(["maze", "house", str(tmp_path / "maze.yaml")], [CONFIG])
    far = CONFIG.with_fields(**{"clyde.clearance_m": 50.0})
    for scenario in ("house", LEVELS):
        with pytest.raises((ConfigError, MapError), match="clearance_m"):
            named_scenarios([scenario], [CONFIG, far])


def test_scenario_description_contains_source_and_hash() -> None:
    assert describe_scenario("maze", "maze", CONFIG) == {
        "name": "maze",
        "source": "maze",
        "hash": load_map("maze").hash,
    }
    about = describe_scenario("x", LEVELS, LEVELS_CONFIG)
    assert about["hash"] == open_scenario(LEVELS, LEVELS_CONFIG).first.occupancy.hash
    del about["hash"]
    assert about == {"name": "x", "source": "--levels test", "start_level": TEST_LEVEL, "num_levels": 2}


def test_parts_contain_every_round_once_grouped_by_level() -> None:
    seeds, many = episode_seeds(0, 400), Levels("test", None, 250)
    levels = open_scenario(many, LEVELS_CONFIG).levels_of(seeds)
    parts = parts_of_play(many, LEVELS_CONFIG, seeds, 2)
    assert sorted(np.concatenate(parts)) == list(range(400))
    assert len(parts) > 2
    assert all(len(set(levels[part])) < sources._CACHED_LEVELS for part in parts)
    assert (np.diff(levels[np.concatenate(parts)]) >= 0).all()


def test_rounds_on_one_map_keep_their_order() -> None:
    parts = parts_of_play("house", CONFIG, episode_seeds(0, 5), 2)
    assert [part.tolist() for part in parts] == [[0, 1, 2], [3, 4]]
    assert len(parts_of_play("house", CONFIG, episode_seeds(0, 2), 5)) == 2
