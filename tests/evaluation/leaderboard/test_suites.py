from pathlib import Path

import pytest

from pacman_env.evaluation.leaderboard.suites import GIVEN_MAPS, SUITES, TEST_LEVELS, cells, choose_suite, read_suites
from pacman_env.evaluation.rounds.scenarios import Levels
from pacman_env.game.ghosts import Behaviour, wander

SHY = Behaviour("shy", wander)
GOOD = """\
tiny:
  test_levels: {levels: 2, rounds: 8}
  real_maps: {rounds: 4}
  ghosts: [[wander], [arcade, chase]]
  speeds_mps: [0, 0.25]
"""


def written(folder: Path, text: str) -> Path:
    path = folder / "own.yaml"
    path.write_text(text)
    return path


def test_full_suite_has_documented_cells() -> None:
    suite = choose_suite(SUITES, "full")
    expected = {(name,) * number for name in ("wander", "arcade", "chase", "clyde:learned") for number in (1, 2, 4)}
    assert set(suite.ghosts) == expected | {("arcade", "chase"), ("wander", "arcade", "chase", "wander")}
    assert suite.speeds_mps == (0.15, 0.25, 0.35, 0.45)
    assert (suite.test_levels.rounds, suite.real_maps.rounds) == (1000, 200)
    found = cells(suite, {"one": "house", "two": "maze"})
    assert [cell.group for cell in found] == [TEST_LEVELS] * 56 + [GIVEN_MAPS] * 56
    assert found[0].scenarios == {"generated:test": Levels("test", None, 100)}
    assert found[-1].scenarios == {"one": "house", "two": "maze"}
    assert {(cell.config.clyde.ghosts, cell.config.clyde.speed_mps) for cell in found[:56]} == {
        (ghosts, speed) for ghosts in suite.ghosts for speed in suite.speeds_mps
    }


def test_quick_and_search_suites_are_parts_of_full_suite() -> None:
    full, quick, search = (choose_suite(SUITES, name) for name in ("full", "quick", "search"))
    assert set(quick.ghosts) < set(full.ghosts)
    assert set(quick.speeds_mps) < set(full.speeds_mps)
    assert sum(cell.rounds for cell in cells(quick, {})) <= 400
    assert {name for ghosts in search.ghosts for name in ghosts} == {name for ghosts in full.ghosts for name in ghosts}
    assert {ghosts for ghosts in full.ghosts if len(set(ghosts)) > 1} < set(search.ghosts) < set(full.ghosts)
    assert (len(cells(search, {})), search.test_levels.rounds) == (16, 50)


def test_settings_reach_every_cell(tmp_path: Path) -> None:
    suite = choose_suite(written(tmp_path, GOOD + "  settings: {time_limit_s: 4e1, refuges.spread: 0}\n"), "tiny")
    found = cells(suite, {})
    assert len(found) == 4
    assert {(cell.config.time_limit_s, cell.config.refuges.spread) for cell in found} == {(40.0, 0)}
    assert {cell.config.nav2.controller for cell in cells(suite, {}, "robot_0_15")} == {"pure_pursuit"}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("tiny:", "- tiny:", "must have suites by name"),
        (GOOD, "", "must have suites by name"),
        ("{levels: 2, ", "{levels: 2; ", "cannot be read"),
        ("rounds: 8", "rounds: 0", "tiny.test_levels.rounds = 0: Expected `int` >= 1"),
        ("speeds_mps:", "speed:", "unknown field `speed`"),
        ("[0, 0.25]", "[]", "tiny.speeds_mps = []: Expected `array` of length >= 1"),
        ("[0, 0.25]", "[0.25, 0.25]", "tiny.speeds_mps[1] = 0.25: is repeated"),
        ("[0, 0.25]", "[0.25, -1]", "tiny.speeds_mps[1] = -1"),
        ("[0, 0.25]", "[0.25, 9]", "tiny.speeds_mps[1]: clyde.speed_mps = 9.0"),
        ("[wander]", "[]", "tiny.ghosts[0] = []: Expected `array` of length >= 1"),
        ("[wander]", "[arcade, chase]", "tiny.ghosts[1] = ('arcade', 'chase'): is repeated"),
        ("[wander]", "['clyde:unknown']", "tiny.ghosts[0]: ghost behaviour 'clyde:unknown': module clyde"),
        ("[wander]", "[policy]", "tiny.ghosts[0]: clyde.ghosts[0] = 'policy': name the .onnx file"),
        *(
            ("  ghosts:", f"  settings: {{{setting}}}\n  ghosts:", message)
            for setting, message in (
                ("nav2.haste: 1", "tiny.settings: unknown configuration field 'nav2.haste'"),
                ("clyde.speed_mps: 1", "settings.clyde.speed_mps: must not be set here"),
                ("randomize.clyde_speed_mps: [0.1, 0.2]", "settings.randomize.clyde_speed_mps: must not be set here"),
            )
        ),
        ("  ghosts:", "  ghosts: [[chase]]\n  ghosts:", "key 'ghosts' is repeated"),
    ],
)
def test_wrong_suite_is_refused_with_file_and_field(old: str, new: str, message: str, tmp_path: Path) -> None:
    assert old in GOOD
    path = written(tmp_path, GOOD.replace(old, new))
    with pytest.raises(ValueError) as caught:  # noqa: PT011 (the message is compared below)
        read_suites(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)


def test_behaviour_of_another_package_is_accepted(tmp_path: Path) -> None:
    suite = choose_suite(written(tmp_path, GOOD.replace("[wander]", f"['{__name__}:SHY']")), "tiny")
    assert cells(suite, {})[0].config.clyde.ghosts == (f"{__name__}:SHY",)
