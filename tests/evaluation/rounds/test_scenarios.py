import argparse
import sys
from pathlib import Path

import numpy as np
import pytest

from pacman_env.config import Config, ConfigError, make_config
from pacman_env.episodes.rollout import episode_seeds
from pacman_env.evaluation.rounds import scenarios as sources
from pacman_env.evaluation.rounds.scenarios import (
    LEVELS_PLAYED,
    Levels,
    Scenario,
    add_game_arguments,
    describe_scenario,
    distinct,
    from_arguments,
    game_configs,
    load_policy,
    named_scenarios,
    open_scenario,
    parts_of_play,
    result_names,
    rule_changes,
    warn_of_short_time,
)
from pacman_env.levels.level_source import TEST_LEVEL, GeneratedMaps
from pacman_env.world.maps.occupancy import MapError, load_map
from tests.evaluation.helpers import CONFIG, LEVELS, LEVELS_CONFIG


def given(*words: str, several: bool = True) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_game_arguments(parser, several=several)
    return parser.parse_args(words)


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([], ["house"]),
        (["--map", "maze", "house", "maze"], ["maze", "house"]),
        (["--map", "generated:test"], [Levels("test", None, LEVELS_PLAYED)]),
        (["--map", "generated:long:test"], [Levels("long:test")]),
        (["--map", "generated", "--start-level", "7", "--num-levels", "3"], [Levels("train", 7, 3)]),
        (["--map", "maze", "generated:test"], ["maze", Levels("test")]),
    ],
)
def test_arguments_become_maps_and_levels(words: list[str], expected: list[object]) -> None:
    assert from_arguments(given(*words)) == expected


def test_each_speed_gets_configuration_with_all_other_settings() -> None:
    settings = ["--set", "clyde.ghosts=wander,arcade,chase", "--set", "randomize.clyde_speed_mps=none"]
    configs = game_configs(given("--clyde-speed", "0.3", "0.4", "0.3", "--endless", *settings))
    assert [config.clyde.speed_mps for config in configs] == [0.3, 0.4]
    for config in configs:
        assert config.endless
        assert config.clyde.ghosts == ("wander", "arcade", "chase")


@pytest.mark.parametrize("endless", [False, True])
def test_endless_games_can_be_a_setting(endless: bool) -> None:
    assert game_configs(given("--set", f"endless={endless}"))[0].endless == endless


def test_single_map_and_speed_become_lists() -> None:
    arguments = given("--map", "maze", "--clyde-speed", "0.3", several=False)
    assert (arguments.map, arguments.clyde_speed) == (["maze"], [0.3])
    assert len(game_configs(given(several=False))) == 1


def test_settings_are_parsed_by_their_fields() -> None:
    changes = rule_changes(given("--set", "refuges.nooks=0", "--set", "nav2.abort_rate=0.1"))
    assert changes == {"refuges.nooks": 0, "nav2.abort_rate": 0.1}


@pytest.mark.parametrize(
    ("specs", "names"),
    [
        (["clyde_aware:documented", "nearest"], ["clyde_aware:documented", "nearest"]),
        (["runs/a/best.onnx", "nearest", "final.zip"], ["best", "nearest", "final"]),
        (["runs/a/best.onnx", "runs/b/best.onnx"], ["runs/a/best.onnx", "runs/b/best.onnx"]),
        (["runs/best.onnx", "runs/best.zip", "nearest"], ["runs/best.onnx", "runs/best.zip", "nearest"]),
        (["ppo", "runs/ppo.onnx"], ["ppo", "runs/ppo.onnx"]),
    ],
)
def test_policy_files_are_named_by_stem_unless_ambiguous(specs: list[str], names: list[str]) -> None:
    assert result_names(specs) == dict(zip(specs, names, strict=True))


def test_checkpoint_without_torch_is_refused_by_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "torch", None)
    with pytest.raises(ValueError, match=r"run\.zip: needs torch: .*pip install"):
        load_policy("run.zip")


@pytest.mark.parametrize("split", ["test", "long:test"])
def test_levels_equal_levels_of_environment(split: str) -> None:
    ours = open_scenario(Levels(split, count=LEVELS.count), LEVELS_CONFIG)
    theirs = GeneratedMaps.named(f"generated:{split}", LEVELS_CONFIG, None, LEVELS.count)
    seeds = episode_seeds(1, 20)
    np.testing.assert_array_equal(ours.levels_of(seeds), theirs.levels_of(seeds))
    for level in (TEST_LEVEL, TEST_LEVEL + 1):
        assert ours.prepare(level).assets.occupancy.hash == theirs.prepare(level).assets.occupancy.hash
    assert ours.first.occupancy.hash == theirs.first.occupancy.hash


def test_level_is_prepared_once_for_all_ghosts() -> None:
    sources._prepared.cache_clear()
    for ghosts in (("wander",), ("chase",), ("arcade", "chase"), ("wander", "arcade", "chase", "wander")):
        changes = {"clyde.ghosts": ghosts, "clyde.speed_mps": 0.1 * len(ghosts), "endless": len(ghosts) > 1}
        config = LEVELS_CONFIG.with_fields(**changes)
        ours = open_scenario(LEVELS, config).prepare(TEST_LEVEL).assets
        assert "ghost_targets" in vars(ours)  # computed beforehand, not while games are played
    assert sources._prepared.cache_info().misses == 1
    theirs = GeneratedMaps.named("generated:test", config, None, LEVELS.count).prepare(TEST_LEVEL).assets
    for name, array in ours.ghost_targets._asdict().items():
        np.testing.assert_array_equal(array, getattr(theirs.ghost_targets, name))
    denser = open_scenario(LEVELS, LEVELS_CONFIG.with_fields(**{"pellets.spacing_m": 1.5})).prepare(TEST_LEVEL)
    assert denser.assets.pellets > ours.pellets


def test_scenarios_are_named_by_map_or_split(tmp_path: Path) -> None:
    file = str(load_map("maze").save(tmp_path / "maze.yaml"))
    named = {"house": "house", "maze": file, "generated:test": LEVELS}
    assert named_scenarios(["house", file, LEVELS], [LEVELS_CONFIG]) == named


@pytest.mark.parametrize("scenario", ["house", LEVELS])
def test_scenario_unplayable_in_one_configuration_is_refused(scenario: Scenario) -> None:
    with pytest.raises((ConfigError, MapError), match="clearance_m"):
        named_scenarios([scenario], [CONFIG, CONFIG.with_fields(**{"clyde.clearance_m": 50.0})])


@pytest.mark.parametrize(
    ("scenario", "config", "expected"),
    [
        ("maze", CONFIG, {"source": "maze"}),
        (LEVELS, LEVELS_CONFIG, {"source": "generated:test", "start_level": TEST_LEVEL, "num_levels": 2}),
    ],
)
def test_scenario_description_contains_source_and_hash(scenario: Scenario, config: Config, expected: dict) -> None:
    content_hash = open_scenario(scenario, config).first.occupancy.hash
    assert describe_scenario("x", scenario, config) == {"name": "x", "hash": content_hash, **expected}


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


def test_repeated_values_are_used_once_and_named(capsys: pytest.CaptureFixture[str]) -> None:
    from_arguments(given("--map", "maze", "house", "maze"))
    assert "maze" in capsys.readouterr().err
    assert distinct("--policies", ["nearest", "ppo"]) == ["nearest", "ppo"]
    assert capsys.readouterr().err == ""


def test_map_without_enough_time_is_noted(capsys: pytest.CaptureFixture[str]) -> None:
    warn_of_short_time({"home": "house"}, make_config("robot", time_limit_s=100.0))
    assert "home: 13 pellets" in capsys.readouterr().err
    warn_of_short_time({"home": "house"}, make_config("robot"))
    assert capsys.readouterr() == ("", "")
