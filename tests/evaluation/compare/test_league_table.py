"""A tiny suite end to end, real rounds of two policies on two houses and on maps, and its table."""

import json
import re
import shlex
import shutil
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from pacman_env.episodes.statistics import paired_difference
from pacman_env.evaluation.compare.__main__ import main
from pacman_env.evaluation.compare.cells import SUITES, read_suites
from pacman_env.evaluation.compare.league_table import against_best, means
from pacman_env.evaluation.rounds.summary import Row, make_row
from pacman_env.game.ends import CAUGHT, COMPLETE
from tests.evaluation.helpers import records

PAGE = Path(__file__).resolve().parents[3] / "docs" / "leaderboard.md"
SUITE = """\
tiny:
  test_levels: {levels: 2, rounds: 12}
  real_maps: {rounds: 6}
  ghosts: [[wander], [arcade, chase]]
  speeds_mps: [0.2]
  settings: {time_limit_s: 60.0, pellets.spacing_m: 3.0}
"""
ARGUMENTS = ["--suites", "own.yaml", "--suite", "tiny", "--map", "house", "maze", "--json", "league.json"]


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tiny")
    (folder / "own.yaml").write_text(SUITE)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        views = ["--markdown", "league.md", "--html", "league.html"]
        assert main([*ARGUMENTS, *views, "--policies", "nearest", "clyde_aware"]) == 0
    return folder


def read(folder: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((folder / "league.json").read_text())
    return content


def without_times(row: Row) -> Row:
    return {name: value for name, value in row.items() if not name.startswith("decision")}


def test_suite_has_row_of_every_policy_in_every_cell(tiny: Path) -> None:
    rows = read(tiny)["rows"]
    expected = [
        (group, place, ghosts, policy, rounds)
        for group, place, rounds in (("test levels", "generated:test", 12), ("given maps", None, 12))
        for ghosts in (["wander"], ["arcade", "chase"])
        for policy in ("nearest", "clyde_aware")
    ]
    names = ("group", "map", "ghosts", "policy", "episodes")
    assert [tuple(row[name] for name in names) for row in rows] == expected


def test_cell_equals_comparison_of_same_rounds(tiny: Path, tmp_path: Path) -> None:
    arguments = ["--map", "generated:test", "--num-levels", "2", "--episodes", "12", "--clyde-speed", "0.2"]
    arguments += ["--time-limit", "60", "--spacing", "3", "--set", "clyde.ghosts=arcade,chase"]
    path = tmp_path / "out.json"
    assert main([*arguments, "--policies", "nearest", "clyde_aware", "--json", str(path)]) == 0
    for alone, row in zip(json.loads(path.read_text())["rows"], read(tiny)["rows"][2:4], strict=True):
        assert without_times(alone).items() <= without_times(row).items()


def test_added_policy_keeps_rows_of_other_policies(
    tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(tiny, tmp_path, dirs_exist_ok=True)
    assert main([*ARGUMENTS, "--resume", "--policies", "nearest", "clyde_aware", "random_pellet"]) == 0
    assert "96 of 144 episodes are taken over" in capsys.readouterr().err.replace("\n", " ")
    kept = [row for row in read(tmp_path)["rows"] if row["policy"] != "random_pellet"]
    assert kept == read(tiny)["rows"]


def test_command_of_results_repeats_rounds(tiny: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shutil.copytree(tiny, tmp_path, dirs_exist_ok=True)
    before = read(tiny)
    assert main([*shlex.split(before["command"])[2:], "--json", "league.json", "--resume"]) == 0
    assert read(tmp_path)["rows"] == before["rows"]


def test_views_show_every_cell_of_every_policy(tiny: Path) -> None:
    rates = [f"{100 * row['completion_rate']:.0f}" for row in read(tiny)["rows"]]
    picture = ElementTree.parse(tiny / "league.svg")
    texts = [element.text for element in picture.iter("{http://www.w3.org/2000/svg}text")]
    assert sorted(text for text in texts if text in rates) == sorted(rates)
    assert {"nearest", "clyde_aware", "1 wander", "arcade, chase", "0.2"} <= set(texts)
    page = (tiny / "league.md").read_text()
    html = re.sub(r"<[^>]+>", " ", (tiny / "league.html").read_text())
    for row in read(tiny)["rows"]:
        assert f" {100 * row['completion_rate']:.1f} |" in page
        assert f" {100 * row['completion_rate']:.1f} " in html
    assert read(tiny)["command"] in page


def rows(*ends: str, group: str = "test levels", speed: float = 0.2) -> list[Row]:
    """Return the rows of a cell, whose policies complete the rounds marked with C."""
    played = [records([COMPLETE if end == "C" else CAUGHT for end in one], [8] * len(one)) for one in ends]
    about = {"group": group, "map": "home", "ghosts": ["wander"], "clyde_speed": speed}
    return [
        make_row({**about, "policy": f"p{k}"}, [(one, np.ones(1))], [played[0]] if k else None)
        for k, one in enumerate(played)
    ]


def test_first_policy_is_compared_with_best_other() -> None:
    first = "C" * 60 + "D" * 40
    others = ["D" * 100, "C" * 20 + "D" * 80, "D" * 80 + "C" * 20]
    difference, (low, high) = paired_difference(np.arange(100) < 60, np.arange(100) < 20)
    text = f"{100 * difference:+.1f} [{100 * low:+.1f}, {100 * high:+.1f}]"
    assert against_best(rows(first, *others)) == ("better", text)
    assert against_best(rows(others[0], first))[0] == "WORSE"
    assert against_best(rows(first, first))[0] == "not different"


def test_cell_means_have_equal_weights() -> None:
    table = means([*rows("CC"), *rows("CDDD", speed=0.3), *rows("DC", group="given maps")])
    assert table.rows == [
        ("test levels", "`p0`", "62.5", "25.0", "1 wander, 0.3 m/s"),
        ("given maps", "`p0`", "50.0", "50.0", "1 wander, 0.2 m/s"),
    ]


def test_documentation_page_states_its_command() -> None:
    made = re.search(
        r"Suite `(\w+)`, \d+ cells?, seed \d+, preset robot, execution robust, version [\d.]+", text := PAGE.read_text()
    )
    assert made is not None
    assert made[1] in read_suites(SUITES)
    assert re.search(rf"^pacman-env compare .*--suite {made[1]}$", text, re.MULTILINE)
