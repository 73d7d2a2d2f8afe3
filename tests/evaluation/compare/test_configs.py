from __future__ import annotations

import argparse

import pytest

from pacman_env.cli.command import whole_number
from pacman_env.config import ConfigError, make_config
from pacman_env.evaluation.rounds.scenarios import add_game_arguments, check_goals, game_configs, rule_changes


def parse(*words: str, several: bool = True) -> argparse.Namespace:
    parser = argparse.ArgumentParser()
    add_game_arguments(parser, several=several)
    return parser.parse_args(words)


def test_whole_number_accepts_only_its_range() -> None:
    number = whole_number(1, 2**64 - 1)
    assert number("1") == 1
    assert number("18446744073709551615") == 2**64 - 1
    for text, message in (("0", "at least 1"), ("18446744073709551616", "at most"), ("1.5", "no whole number")):
        with pytest.raises(argparse.ArgumentTypeError, match=message):
            number(text)


def test_each_speed_gets_configuration_with_all_other_settings() -> None:
    configs = game_configs(
        parse("--clyde-speed", "0.3", "0.4", "0.3", "--endless", "--set", "clyde.ghosts=wander,arcade,chase")
    )
    assert [config.clyde.speed_mps for config in configs] == [0.3, 0.4]
    for config in configs:
        assert config.endless
        assert config.clyde.ghosts == ("wander", "arcade", "chase")


def test_endless_is_set_by_option_or_setting_only() -> None:
    assert game_configs(parse("--set", "endless=true"))[0].endless
    assert not game_configs(parse("--set", "endless=false"))[0].endless
    with pytest.raises(ConfigError, match="endless: given twice"):
        game_configs(parse("--endless", "--set", "endless=true"))


def test_single_map_and_speed_become_lists() -> None:
    arguments = parse("--map", "maze", "--clyde-speed", "0.3", several=False)
    assert (arguments.map, arguments.clyde_speed) == (["maze"], [0.3])
    assert len(game_configs(parse(several=False))) == 1


def test_settings_are_parsed_but_ghost_speed_is_refused() -> None:
    assert rule_changes(parse("--set", "refuges.nooks=0", "--set", "nav2.abort_rate=0.1")) == {
        "refuges.nooks": 0,
        "nav2.abort_rate": 0.1,
    }
    with pytest.raises(ConfigError, match="--clyde-speed"):
        rule_changes(parse("--set", "clyde.speed_mps=0.3"))


def test_random_ghost_speed_is_refused_in_comparison() -> None:
    assert len(game_configs(parse("--set", "randomize.clyde_speed_mps=none", "--clyde-speed", "0.25", "0.45"))) == 2
    for more in ([], ["--clyde-speed", "0.25", "0.45"]):
        with pytest.raises(ConfigError, match=r"randomize\.clyde_speed_mps = \(0\.1, 0\.2\).* --clyde-speed"):
            game_configs(parse("--set", "randomize.clyde_speed_mps=0.1,0.2", *more))


def test_games_without_goal_actions_are_refused() -> None:
    check_goals(make_config())
    with pytest.raises(ConfigError, match="action = 'velocity'"):
        check_goals(make_config(action="velocity"))
    with pytest.raises(ConfigError, match=r"clyde\.ghosts"):
        check_goals(make_config(**{"clyde.ghosts": ("wander", "policy")}))
