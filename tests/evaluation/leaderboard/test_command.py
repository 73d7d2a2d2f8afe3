"""A tiny suite end to end: real rounds of two policies, on two houses and on a map."""

import json
import re
import shlex
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacman_env import __version__
from pacman_env.evaluation.compare.__main__ import main as compare
from pacman_env.evaluation.leaderboard import __main__ as command
from pacman_env.evaluation.leaderboard.__main__ import main
from pacman_env.evaluation.leaderboard.heat_map import draw
from pacman_env.evaluation.leaderboard.page import render
from pacman_env.evaluation.leaderboard.suites import SUITES, read_suites
from pacman_env.policies.learned import PRETRAINED

ROOT = Path(__file__).resolve().parents[3]
PAGE = ROOT / "docs" / "leaderboard.md"
#: Of all types that JSON has.
VALUES = st.recursive(
    st.none() | st.booleans() | st.integers(-2, 9) | st.floats() | st.text(max_size=3),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.text(max_size=3), inner, max_size=2),
    max_leaves=3,
)
SUITE = """\
tiny:
  test_levels: {levels: 2, rounds: 12}
  real_maps: {rounds: 6}
  ghosts: [[wander], [arcade, chase]]
  speeds_mps: [0.2]
  settings: {time_limit_s: 60.0, pellets.spacing_m: 3.0}
"""


def run(folder: Path, *more: str, policies: str = "nearest clyde_aware") -> Path:
    """Run the command in ``folder`` as a user would, and return the folder of its results."""
    (folder / "own.yaml").write_text(SUITE)
    arguments = ["--suites", "own.yaml", "--suite", "tiny", "--planner", "nearest", "--maps", "house"]
    assert main([*arguments, "--policies", *policies.split(), *more]) == 0
    return folder / "results"


@pytest.fixture(scope="module")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tiny")
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        return run(folder)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def table(results: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((results / "leaderboard.json").read_text())
    return content


def places(content: Any, inside: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """The keys and numbers that lead to each value of plain data."""
    entries = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in entries:
        yield (*inside, key)
        yield from places(value, (*inside, key))


def test_table_contains_every_policy_in_every_cell(tiny: Path) -> None:
    found = table(tiny)
    assert [(cell["group"], cell["ghosts"], cell["rounds"]) for cell in found["cells"]] == [
        ("test levels", ["wander"], 12),
        ("test levels", ["arcade", "chase"], 12),
        ("given maps", ["wander"], 6),
        ("given maps", ["arcade", "chase"], 6),
    ]
    for cell in found["cells"]:
        assert [row["policy"] for row in cell["policies"]] == ["nearest", "clyde_aware"]
        ours, theirs = (row["completion_rate"] for row in cell["policies"])
        assert cell["against"]["other"] == "clyde_aware"
        assert cell["against"]["difference"] == pytest.approx(ours - theirs)
    assert found["version"] == __version__
    assert (found["suite"], found["seed"], found["preset"], found["execution"]) == ("tiny", 0, "robot", "robust")


def test_cell_equals_comparison_of_same_rounds(tiny: Path, folder: Path) -> None:
    arguments = ["--levels", "test", "--num-levels", "2", "--episodes", "12", "--clyde-speed", "0.2"]
    arguments += ["--time-limit", "60", "--spacing", "3", "--set", "clyde.ghosts=arcade,chase"]
    assert compare([*arguments, "--policies", "clyde_aware", "nearest", "--json", "out.json"]) == 0
    _, row = json.loads((folder / "out.json").read_text())["rows"]
    cell = table(tiny)["cells"][1]
    ours = cell["policies"][0]
    assert ours["pellets_share"] > 0
    for name in ("completion_rate", "completion_ci", "death_rate", "timeout_rate", "win_time_mean_s"):
        assert ours[name] == row[name]
    assert (cell["against"]["difference"], cell["against"]["ci"]) == (row["paired_difference"], row["paired_ci"])


def test_added_policy_keeps_rows_of_other_policies(
    tiny: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(tiny / "leaderboard", folder / "results" / "leaderboard")
    more = ["--resume", "--workers", "2", "--apart", "random_pellet"]
    found = table(run(folder, *more, policies="nearest random_pellet clyde_aware"))
    assert "36/36" in capsys.readouterr().err  # the rounds of one policy
    for ours, cell in zip(found["cells"], table(tiny)["cells"], strict=True):
        assert [row["policy"] for row in ours["policies"]] == ["nearest", "random_pellet", "clyde_aware"]
        assert [ours["policies"][0], ours["policies"][2]] == cell["policies"]
        assert ours["against"] == cell["against"]  # random_pellet is reported apart
    assert [entry["apart"] for entry in found["policies"]] == [False, True, False]
    assert "(`random_pellet` is reported apart)" in (folder / "results" / "leaderboard.md").read_text()


def test_planner_file_is_listed_with_hash_and_command(folder: Path) -> None:
    (folder / "mine.onnx").write_bytes(PRETRAINED.read_bytes())
    (folder / "mine.json").write_bytes(PRETRAINED.with_suffix(".json").read_bytes())
    text = SUITE.replace("[wander], ", "").replace("rounds: 12", "rounds: 4").replace("60.0", "20.0")
    (folder / "own.yaml").write_text(text)
    arguments = ["--suites", "own.yaml", "--suite", "tiny", "--policies", "mine.onnx", "--planner", "mine.onnx"]
    assert main([*arguments, "--preset", "robot_0_15"]) == 0
    assert table(folder / "results")["preset"] == "robot_0_15"
    (entry,) = table(folder / "results")["policies"]
    assert (entry["name"], entry["spec"]) == ("mine", "mine.onnx")
    page = (folder / "results" / "leaderboard.md").read_text()
    assert entry["sha256"] in page
    assert entry["command"] in page
    before = table(folder / "results")
    assert main([*shlex.split(entry["command"])[2:], "--resume"]) == 0
    assert table(folder / "results") == before


def test_page_is_rendered_from_json_alone(tiny: Path, folder: Path) -> None:
    numbers = folder / "numbers.json"
    numbers.write_bytes((tiny / "leaderboard.json").read_bytes())
    assert main(["--from", "numbers.json", "--out", "page.md"]) == 0
    assert (folder / "page.md").read_text().replace("page.svg", "leaderboard.svg") == (
        tiny / "leaderboard.md"
    ).read_text()
    assert (folder / "page.svg").read_bytes() == (tiny / "leaderboard.svg").read_bytes()
    assert sorted(path.name for path in folder.iterdir()) == ["numbers.json", "page.md", "page.svg"]


def test_heat_map_shows_every_cell_of_every_policy(tiny: Path) -> None:
    picture = ElementTree.parse(tiny / "leaderboard.svg")
    texts = [element.text for element in picture.iter("{http://www.w3.org/2000/svg}text")]
    rates = [f"{100 * row['completion_rate']:.0f}" for cell in table(tiny)["cells"] for row in cell["policies"]]
    assert sorted(text for text in texts if text in rates) == sorted(rates)
    assert {"nearest", "clyde_aware", "1 wander", "arcade, chase", "0.2"} <= set(texts)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"schema": 1}, "schema = 1"),
        ({"planner": "nobody"}, "planner = 'nobody': must be one of policies"),
        ({"maps": []}, "maps: must hold the test levels"),
        ({"maps": [{"name": "x", "hash": "0", "source": "x", "num_levels": 2}]}, "maps[0]: must have both start_level"),
    ],
)
def test_wrong_field_of_the_json_is_named(
    change: dict[str, Any], message: str, tiny: Path, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (folder / "numbers.json").write_text(json.dumps(table(tiny) | change))
    assert main(["--from", "numbers.json", "--out", "page.md"]) == 2
    assert f"numbers.json: {message}" in capsys.readouterr().err
    assert not (folder / "page.md").exists()


@settings(max_examples=100, deadline=None, derandomize=True)
@given(data=st.data())
def test_damaged_json_is_refused_or_rendered(tiny: Path, data: st.DataObject) -> None:
    content = table(tiny)
    *inside, last = data.draw(st.sampled_from(list(places(content))))
    owner: Any = content
    for key in inside:
        owner = owner[key]
    if data.draw(st.booleans()):
        del owner[last]
    else:
        owner[last] = data.draw(VALUES)
    path = tiny.parent / "damaged.json"
    path.write_text(json.dumps(content))
    refused = ""
    try:
        render(command.read_table(path), "page.svg")
        draw(command.read_table(path))
    except ValueError as error:
        refused = str(error)
    assert not refused or re.match(rf"{re.escape(str(path))}: \w", refused)


def test_documentation_page_states_its_command() -> None:
    page = PAGE.read_text()
    made = re.search(
        r"Suite `(\w+)`, \d+ cells?, seed \d+, preset robot, execution robust, version [\d.]+, commits? `[0-9a-f]{12}",
        page,
    )
    assert made is not None
    first, *others = re.findall(r"^pacman-env leaderboard .*", page, re.MULTILINE)
    assert f"--suite {made[1]} " in first
    assert made[1] in read_suites(SUITES)
    policies = re.search(r"--policies (.*) --planner", first)
    assert policies is not None
    assert [re.search(r"--policies (\S+)", one)[1] for one in others] == policies[1].split()  # type: ignore[index]
    for section in ("## Summary", "## What the numbers are", "## Test levels", "## How it was made"):
        assert f"\n{section}\n" in page
