import copy
import json
import re
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from pacman_env import __version__
from pacman_env.evaluation.report.__main__ import main, model_facts
from pacman_env.evaluation.report.page import headline, render_page
from pacman_env.policies.learned import PRETRAINED
from pacman_env.policies.metadata import read_planner
from pacman_env.world.maps.occupancy import load_map
from tests.evaluation.helpers import CONFIG

SHORT = ["--set", "pellets.spacing_m=3", "--set", "time_limit_s=120", "--execution", "as_built"]
FEW = [*SHORT, "--episodes", "12", "--endless", "3", "--speeds", "0.25", "0.4", "--seed", "5"]
POLICIES = ["--policies", "clyde_aware", "random_pellet", "--baseline", "random_pellet"]
VOID = {"meta", "br", "path", "circle", "rect", "polyline", "polygon", "i"}


class Tags(HTMLParser):
    """Every tag is closed in its scenario; attributes that name files are kept."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.links: list[str] = []
        self.text: list[str] = []
        self.feed(page)
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.links += [value or "" for name, value in attrs if name in ("src", "href", "data", "poster")]
        if tag not in ("meta", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        assert tag in VOID

    def handle_data(self, data: str) -> None:
        self.text.append(data)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    folder = tmp_path_factory.mktemp("report")
    page = folder / "new" / "page.html"
    variant = ["--variant", "no refuges=refuges.spread=0,refuges.nooks=0"]
    arguments = [*FEW, *POLICIES, *variant, "--replays", "2", "--out", str(page), "--json", str(folder / "r.json")]
    assert main(arguments) == 0
    assert sorted(path.name for path in page.parent.iterdir()) == ["page.html", "page.parts", "page_films"]
    return json.loads((folder / "r.json").read_text()), page


def row_of(
    report: dict[str, Any], policy: str, part: str = "rounds", speed: float = 0.25, map: str | None = None
) -> dict[str, Any]:
    names = ("part", "policy", "clyde_speed", "map")
    (row,) = (r for r in report["rows"] if tuple(r[name] for name in names) == (part, policy, speed, map))
    result: dict[str, Any] = row
    return result


def outcomes(report: dict[str, Any], policy: str) -> dict[str, Any]:
    result: dict[str, Any] = row_of(report, policy, map="house")["outcomes"]
    return result


def test_json_describes_played_rounds(made: tuple[dict[str, Any], Path]) -> None:
    report, page = made
    assert (report["version"], report["seed"], report["execution"]) == (__version__, 5, "as_built")
    occupancy = load_map("house")
    assert [(m["name"], m["hash"]) for m in report["maps"]] == [("house", occupancy.hash)]
    assert report["command"].startswith("pacman-env report --set pellets.spacing_m=3")
    assert f"--out {page}" in report["command"]
    assert report["config"] == json.loads(json.dumps(CONFIG.as_dict()))
    assert [(p["name"], p["baseline"]) for p in report["policies"]] == [("clyde_aware", False), ("random_pellet", True)]


def test_rows_compare_with_baseline_and_variants_with_policy(made: tuple[dict[str, Any], Path]) -> None:
    report, _ = made
    for part, speed in (("rounds", 0.25), ("rounds", 0.4), ("endless games", 0.25), ("no refuges", 0.25)):
        ours, theirs = (row_of(report, policy, part, speed) for policy in ("clyde_aware", "random_pellet"))
        if part == "no refuges":
            theirs = row_of(report, "clyde_aware")
        name = "pellets_mean" if part == "endless games" else "completion_rate"
        assert ours["paired_difference"] == pytest.approx(ours[name] - theirs[name])
        assert ours["episodes"] == (3 if part == "endless games" else 12)
        alone = row_of(report, "clyde_aware", part, speed, "house")
        assert {**alone, "map": None, "outcomes": None} == {**ours, "outcomes": None}  # one map is all maps
    assert [row["iqm"] for row in report["summary"]] == [
        pytest.approx(row_of(report, policy)["completion_rate"]) for policy in ("clyde_aware", "random_pellet")
    ]


def test_page_shows_caught_ghosts_if_there_are_power_pellets(made: tuple[dict[str, Any], Path]) -> None:
    report, _ = made
    power = copy.deepcopy(report)
    power["config"]["power"]["pellets"] = 4
    row_of(power, "clyde_aware").update(ghosts_caught_mean=1.25, ghosts_caught_ci=[0.5, 2.5])
    plain, shown = ("".join(Tags(render_page(one)).text) for one in (report, power))
    assert "1.250.5 to 2.5" in shown
    assert "ghosts caught" in shown
    assert "ghosts caught" not in plain


def test_pair_lists_rounds_completed_by_one_policy_only(made: tuple[dict[str, Any], Path]) -> None:
    report, page = made
    ours, theirs = (outcomes(report, policy)["end"] for policy in ("clyde_aware", "random_pellet"))
    won = [(a == "C") - (b == "C") for a, b in zip(ours, theirs, strict=True)]
    for name, sign in (("wins", 1), ("losses", -1)):
        expected = [seed for seed, side in zip(report["seeds"], won, strict=True) if side == sign]
        assert [row["seed"] for row in report["pair"][name]] == expected
    assert len(report["pair"]["wins"]) > 0
    row = report["pair"]["wins"][0]
    assert (row["ours"]["end"], row["theirs"]["end"] != "complete") == ("complete", True)
    assert row["command"].startswith(f"pacman-env replay {row['seed']} --map house")
    assert row["command"] in " ".join("".join(Tags(page.read_text()).text).split())


def test_films_are_written_next_to_page(made: tuple[dict[str, Any], Path]) -> None:
    report, page = made
    films = [row["film"] for row in report["pair"]["wins"] + report["pair"]["losses"] if "film" in row]
    assert len(films) == 2
    assert {link for link in Tags(page.read_text()).links if not link.startswith("#")} == set(films)
    for film in films:
        assert (page.parent / film).stat().st_size > 1000


def test_failed_film_keeps_numbers_played_by_two_workers(
    made: tuple[dict[str, Any], Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name in ("imageio", "imageio.v2"):
        monkeypatch.setitem(sys.modules, name, None)
    files = ["--out", str(tmp_path / "p.html"), "--json", str(tmp_path / "p.json")]
    few = ["--endless", "0", "--variant", "--speeds", "0.4", "--replays", "1", "--workers", "2"]
    assert main([*FEW, *POLICIES, *few, *files]) == 2
    assert "needs imageio" in capsys.readouterr().err.splitlines()[-1]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["p.html", "p.json", "p.parts"]
    report, page = json.loads((tmp_path / "p.json").read_text()), (tmp_path / "p.html").read_text()
    assert report["summary"] == made[0]["summary"]
    expected = [{k: v for k, v in row.items() if k != "film"} for row in made[0]["pair"]["wins"]]
    assert report["pair"]["wins"] == expected
    assert {row["part"] for row in report["rows"]} == {"rounds"}
    for absent in ("_films", "Endless games", "other settings"):
        assert absent not in page


def test_page_is_self_contained_and_explained(made: tuple[dict[str, Any], Path]) -> None:
    page = made[1].read_text()
    assert not re.search(r"https?:|//[\w-]+\.|@import|url\(|<script|<link", page)
    text = " ".join(" ".join(Tags(page).text).split())
    for words in ("Higher is better", "complete when every pellet", "95 % interval", "lower is better", "50 = no diff"):
        assert words in text


def test_metadata_of_planner_file_are_shown(tmp_path: Path) -> None:
    shown, metadata = model_facts(str(PRETRAINED)), read_planner(PRETRAINED)[0]
    assert shown["sha256"] == metadata.sha256
    assert shown["candidate_features"].startswith(", ".join(metadata.candidate_features[:3]))
    assert len(shown["candidate_features"]) == 80  # shortened
    assert all(isinstance(text, str) for text in shown.values())
    assert model_facts("clyde_aware") == model_facts("run.zip") == {}


def test_page_escapes_every_text(made: tuple[dict[str, Any], Path]) -> None:
    report, _ = made
    evil = "<script>alert('1')</script>\"&"
    text = json.dumps(report)
    for name in ("random_pellet", "clyde_aware", "house", "no refuges", "a refuge", "as_built"):
        text = text.replace(f'"{name}"', json.dumps(evil + name))
    changed = json.loads(text)
    changed["policies"][0]["facts"] = {evil: evil}
    changed["settings"] = [evil]
    changed["command"] = evil
    page = render_page(changed)
    assert "<script" not in page
    assert Tags(page).text.count(evil) >= 4


def test_quick_report_plays_few_rounds_on_levels(tmp_path: Path) -> None:
    files = ["--out", str(tmp_path / "p.html"), "--json", str(tmp_path / "p.json")]
    names = ["--policies", "random_pellet", "--baseline", "random_pellet"]
    short = ["--set", "time_limit_s=5", *names, "--levels", "test"]
    assert main(["--quick", *short, "--num-levels", "2", "--variant", *files]) == 0
    report = json.loads((tmp_path / "p.json").read_text())
    assert (report["episodes"], report["endless_games"]) == (24, 12)
    assert report["speeds"] == [0.15, 0.35, 0.6]
    (about,) = report["maps"]
    assert (about["name"], about["source"], about["num_levels"]) == ("generated:test", "--levels test", 2)
    assert report["pair"] is None
    assert "2 generated houses" in "".join(Tags((tmp_path / "p.html").read_text()).text)


@pytest.mark.parametrize(
    ("interval", "words"),
    [
        ((0.1, 0.3), "20.0 percentage points more"),
        ((-0.3, -0.1), "20.0 percentage points fewer"),
        ((-0.1, 0.5), "not significant"),
    ],
)
def test_headline_follows_confidence_interval(
    interval: tuple[float, float], words: str, made: tuple[dict[str, Any], Path]
) -> None:
    report = json.loads(json.dumps(made[0]))
    row_of(report, "clyde_aware").update(paired_difference=0.2, paired_ci=interval)
    assert words in headline(report)
