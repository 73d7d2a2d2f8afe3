from pathlib import Path

import pytest

from pacman_env.evaluation.compare.__main__ import make_parser
from pacman_env.evaluation.compare.cells import GIVEN_MAPS, SUITES, TEST_LEVELS, Cell, make_cells, read_suites
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


def cells(*words: str) -> list[Cell]:
    return make_cells(make_parser().parse_args(words))


def test_arguments_make_cell_of_each_map_and_speed() -> None:
    found = cells("--map", "maze", "house", "--clyde-speed", "0.2", "0.3", "--episodes", "5")
    played = [(list(cell.scenarios), cell.config.clyde.speed_mps, cell.rounds) for cell in found]
    assert played == [(["maze"], 0.2, 5), (["maze"], 0.3, 5), (["house"], 0.2, 5), (["house"], 0.3, 5)]


def test_shipped_suites_have_documented_cells() -> None:
    full, maps = read_suites(SUITES)["full"], {"house": "house", "maze": "maze"}
    expected = {(name,) * number for name in ("wander", "arcade", "chase", "clyde:learned") for number in (1, 2, 4)}
    assert set(full.ghosts) == expected | {("arcade", "chase"), ("wander", "arcade", "chase", "wander")}
    found = cells("--suite", "quick", "--map", *maps, "--preset", "robot_0_15")
    assert [(cell.group, cell.rounds) for cell in found] == [(TEST_LEVELS, 60)] * 6 + [(GIVEN_MAPS, 20)] * 6
    assert (found[0].scenarios, found[-1].scenarios) == ({"generated:test": Levels("test", None, 10)}, maps)
    assert {cell.config.nav2.controller for cell in found} == {"pure_pursuit"}
    assert {cell.config.clyde.speed_mps for cell in found} == {0.25, 0.35}
    assert {cell.rounds for cell in cells("--suite", "quick", "--episodes", "3")} == {3}


def test_settings_of_suite_reach_every_configuration(tmp_path: Path) -> None:
    text = GOOD + "  settings: {power.pellets: 4}\n"
    suite = ("--suite", "tiny", "--suites", str(written(tmp_path, text)), "--set", "pellets.spacing_m=3")
    rules = {(cell.config.power.pellets, cell.config.pellets.spacing_m) for cell in cells(*suite)}
    assert rules == {(4, 3.0)}


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("tiny:", "- tiny:", "must have suites by name"),
        (GOOD, "", "must have suites by name"),
        ("{levels: 2, ", "{levels: 2; ", "cannot be read"),
        ("rounds: 8", "rounds: 0", "tiny.test_levels.rounds = 0: Expected `int` >= 1"),
        ("speeds_mps:", "speed:", "unknown field `speed`"),
        ("[0, 0.25]", "[0.25, 0.25]", "tiny.speeds_mps[1] = 0.25: is repeated"),
        ("[0, 0.25]", "[0.25, 9]", "tiny.speeds_mps[1]: clyde.speed_mps = 9.0"),
        ("[wander]", "[]", "tiny.ghosts[0] = []: Expected `array` of length >= 1"),
        ("[wander]", "['clyde:unknown']", "tiny.ghosts[0]: ghost behaviour 'clyde:unknown': module clyde"),
        ("[wander]", "[policy]", "tiny.ghosts[0]: clyde.ghosts[0] = 'policy': name the .onnx file"),
        ("  ghosts:", "  settings: {nav2.haste: 1}\n  ghosts:", "tiny.settings: unknown configuration field"),
        ("  ghosts:", "  settings: {clyde.speed_mps: 1}\n  ghosts:", "clyde.speed_mps: must not be set here"),
    ],
)
def test_wrong_suite_is_refused_with_file_and_field(old: str, new: str, message: str, tmp_path: Path) -> None:
    path = written(tmp_path, GOOD.replace(old, new))
    with pytest.raises(ValueError) as caught:  # noqa: PT011 (the message is compared below)
        read_suites(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert message in str(caught.value)


def test_behaviour_of_another_package_is_accepted(tmp_path: Path) -> None:
    path = written(tmp_path, GOOD.replace("[wander]", f"['{__name__}:SHY']"))
    assert cells("--suite", "tiny", "--suites", str(path))[0].config.clyde.ghosts == (f"{__name__}:SHY",)
