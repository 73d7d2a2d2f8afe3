from __future__ import annotations

import json
import re
import shlex
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from pacman_env import __version__
from pacman_env.episodes.statistics import wilson
from pacman_env.evaluation.replay import main as replay
from pacman_env.evaluation.report.__main__ import main
from pacman_env.evaluation.report.page import headline, render_page
from pacman_env.game.execution import COMPLETE
from pacman_env.world.maps.occupancy import load_map
from tests.evaluation.helpers import CONFIG, refused_in_one_line

SHORT = ["--set", "pellets.spacing_m=3", "--set", "time_limit_s=120", "--execution", "as_built"]
FEW = [*SHORT, "--episodes", "12", "--endless", "3", "--speeds", "0.25", "0.4", "--seed", "5"]
POLICIES = ["--policies", "clyde_aware", "random", "--baseline", "random"]
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
    assert sorted(path.name for path in page.parent.iterdir()) == ["page.html", "page_films"]
    return json.loads((folder / "r.json").read_text()), page


def rounds(report: dict[str, Any], policy: str, part: str = "rounds", speed: float = 0.25) -> dict[str, Any]:
    (row,) = (r for r in report["rounds"] if (r["part"], r["policy"], r["speed"]) == (part, policy, speed))
    result: dict[str, Any] = row
    return result


def test_the_json_says_what_was_played(made: tuple[dict[str, Any], Path]) -> None:
    report, page = made
    assert (report["version"], report["seed"], report["execution"]) == (__version__, 5, "as_built")
    occupancy = load_map("house")
    assert [(m["name"], m["hash"]) for m in report["maps"]] == [("house", occupancy.hash)]
    assert report["command"].startswith("pacman-env report --set pellets.spacing_m=3")
    assert f"--out {page}" in report["command"]
    assert report["config"] == json.loads(json.dumps(CONFIG.as_dict()))
    assert [(p["name"], p["baseline"]) for p in report["policies"]] == [("clyde_aware", False), ("random", True)]


def test_the_figures_are_those_of_the_rounds(made: tuple[dict[str, Any], Path]) -> None:
    report, _ = made
    for row in report["summary"]:
        ends = rounds(report, row["policy"])["end"]
        assert len(ends) == 12
        complete = ends.count(COMPLETE)
        assert row["all"] == row["maps"]["house"] == {"rate": complete / 12, "ci": list(wilson(complete, 12))}
        assert row["iqm"] == pytest.approx(complete / 12)
    for row in report["curve"]:
        assert row["rate"] == rounds(report, row["policy"], speed=row["speed"])["end"].count(COMPLETE) / 12
    for row in report["endless"]:
        pellets = rounds(report, row["policy"], "endless games")["collected"]
        assert row["pellets_mean"] == pytest.approx(sum(pellets) / 3)
        assert row["pellets_median"] == sorted(pellets)[1]
        assert min(pellets) <= row["pellets_ci"][0] <= row["pellets_ci"][1] <= max(pellets)
    for row in report["variants"]:
        ends = rounds(report, row["policy"], "no refuges")["end"]
        plain = rounds(report, row["policy"])["end"]
        assert row["difference"] == pytest.approx((ends.count(COMPLETE) - plain.count(COMPLETE)) / 12)
    for row in report["endings"]:
        assert sum(row["ends"].values()) == pytest.approx(1)
    for row in report["decisions"]:
        assert 0 < row["p50_ms"] <= row["p99_ms"]


def test_improvement_counts_every_pair_of_rounds(made: tuple[dict[str, Any], Path]) -> None:
    report, _ = made
    ours, theirs = (rounds(report, policy)["collected"] for policy in ("clyde_aware", "random"))
    pairs = [(a > b) + (a == b) / 2 for a in ours for b in theirs]
    row, baseline = report["summary"]
    assert row["improvement"] == pytest.approx(sum(pairs) / len(pairs))
    assert row["improvement_ci"][0] <= row["improvement"] <= row["improvement_ci"][1]
    assert "improvement" not in baseline


def test_the_pair_holds_exactly_the_rounds_that_part_them(made: tuple[dict[str, Any], Path]) -> None:
    report, page = made
    ours, theirs = (rounds(report, policy)["end"] for policy in ("clyde_aware", "random"))
    won = [(a == COMPLETE) - (b == COMPLETE) for a, b in zip(ours, theirs, strict=True)]
    for name, sign in (("wins", 1), ("losses", -1)):
        expected = [seed for seed, side in zip(report["seeds"], won, strict=True) if side == sign]
        assert [row["seed"] for row in report["pair"][name]] == expected
    assert len(report["pair"]["wins"]) > 0
    row = report["pair"]["wins"][0]
    assert (row["ours"]["end"], row["theirs"]["end"] != "complete") == ("complete", True)
    assert row["command"].startswith(f"pacman-env replay {row['seed']} --map house")
    assert row["command"] in " ".join("".join(Tags(page.read_text()).text).split())


@pytest.mark.parametrize("side", ["wins", "losses"])
def test_the_command_beside_a_round_plays_it_again(
    side: str,
    made: tuple[dict[str, Any], Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    pair = made[0]["pair"]
    row = pair[side][0]
    words = shlex.split(row["command"])
    assert words[:2] == ["pacman-env", "replay"]
    monkeypatch.chdir(tmp_path)
    assert replay(words[2:]) == 0
    assert (tmp_path / "results" / f"replay-{row['seed']}.mp4").stat().st_size > 1000
    text = capsys.readouterr().out
    for policy, outcome in ((pair["policy"], row["ours"]), (pair["baseline"], row["theirs"])):
        words = f"after {outcome['time_s']:.1f} s, {outcome['collected']} of {outcome['pellets']} pellets"
        assert re.search(rf"^{policy}: \w+ {words}", text, re.M)


def test_films_lie_beside_the_page(made: tuple[dict[str, Any], Path]) -> None:
    report, page = made
    films = [row["film"] for row in report["pair"]["wins"] + report["pair"]["losses"] if "film" in row]
    assert len(films) == 2
    assert {link for link in Tags(page.read_text()).links if not link.startswith("#")} == set(films)
    for film in films:
        assert (page.parent / film).stat().st_size > 1000


def test_a_round_against_a_ghost_that_a_policy_moves_is_filmed_too(tmp_path: Path) -> None:
    files = ["--out", str(tmp_path / "p.html"), "--json", str(tmp_path / "p.json")]
    ghosts = ["--set", "clyde.ghosts=clyde:learned", "--clyde-speed", "0.1", "--speeds", "0.1"]
    few = ["--endless", "0", "--variant", "--replays", "1"]
    assert main([*FEW, *POLICIES, *ghosts, *few, *files]) == 0
    pair = json.loads((tmp_path / "p.json").read_text())["pair"]
    (film,) = [row["film"] for row in pair["wins"] + pair["losses"] if "film" in row]
    assert (tmp_path / film).stat().st_size > 1000


def test_a_film_that_fails_loses_no_numbers_and_leaves_no_folder(
    made: tuple[dict[str, Any], Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    for name in ("imageio", "imageio.v2"):
        monkeypatch.setitem(sys.modules, name, None)
    files = ["--out", str(tmp_path / "p.html"), "--json", str(tmp_path / "p.json")]
    few = ["--endless", "0", "--variant", "--speeds", "0.4", "--replays", "1"]
    assert main([*FEW, *POLICIES, *few, *files]) == 2
    assert "needs imageio" in capsys.readouterr().err.splitlines()[-1]
    assert sorted(path.name for path in tmp_path.iterdir()) == ["p.html", "p.json"]
    assert json.loads((tmp_path / "p.json").read_text())["summary"] == made[0]["summary"]
    assert "_films" not in (tmp_path / "p.html").read_text()


def test_the_page_needs_nothing_else_and_explains_itself(made: tuple[dict[str, Any], Path]) -> None:
    page = made[1].read_text()
    assert not re.search(r"https?:|//[\w-]+\.|@import|url\(|<script|<link", page)
    text = " ".join(" ".join(Tags(page).text).split())
    for words in ("Higher is better", "complete when every pellet", "95 % interval", "lower is better", "50 = no diff"):
        assert words in text


def test_every_text_is_escaped(made: tuple[dict[str, Any], Path]) -> None:
    report, _ = made
    evil = "<script>alert('1')</script>\"&"
    text = json.dumps(report)
    for name in ("random", "clyde_aware", "house", "no refuges", "a refuge", "as_built"):
        text = text.replace(f'"{name}"', json.dumps(evil + name))
    changed = json.loads(text)
    changed["policies"][0]["facts"] = {evil: evil}
    changed["settings"] = [evil]
    changed["command"] = evil
    page = render_page(changed)
    assert "<script" not in page
    assert Tags(page).text.count(evil) >= 4


def test_other_workers_and_no_extras(made: tuple[dict[str, Any], Path], tmp_path: Path) -> None:
    report, _ = made
    files = ["--out", str(tmp_path / "p.html"), "--json", str(tmp_path / "p.json")]
    few = ["--endless", "0", "--variant", "--speeds", "0.4"]
    assert main([*FEW, *POLICIES, *few, "--workers", "2", *files]) == 0
    other = json.loads((tmp_path / "p.json").read_text())
    assert other["summary"] == report["summary"]
    assert other["pair"]["wins"] == [{k: v for k, v in row.items() if k != "film"} for row in report["pair"]["wins"]]
    assert (other["endless"], other["variants"]) == ([], [])
    page = (tmp_path / "p.html").read_text()
    assert "Endless games" not in page
    assert "other settings" not in page
    assert sorted(path.name for path in tmp_path.iterdir()) == ["p.html", "p.json"]


def test_endless_games_of_all_maps_are_counted_together(tmp_path: Path) -> None:
    files = ["--out", str(tmp_path / "p.html"), "--json", str(tmp_path / "p.json")]
    short = ["--episodes", "2", "--endless", "4", "--speeds", "0.25", "--variant", "--policies", "nearest"]
    assert main([*SHORT, *short, "--map", "house", "loop", *files]) == 0
    report = json.loads((tmp_path / "p.json").read_text())
    house, loop, together = (row for row in report["endless"] if row["policy"] == "nearest")
    assert (house["map"], loop["map"], together["map"], together["games"]) == ("house", "loop", None, 8)
    assert together["pellets_mean"] == pytest.approx((house["pellets_mean"] + loop["pellets_mean"]) / 2)
    baseline = report["endless"][-1]
    assert baseline["policy"] == "clyde_aware"
    assert together["difference"] == pytest.approx(together["pellets_mean"] - baseline["pellets_mean"])


def test_the_quick_report_has_its_own_numbers_and_levels_are_a_map(tmp_path: Path) -> None:
    files = ["--out", str(tmp_path / "p.html"), "--json", str(tmp_path / "p.json")]
    short = ["--set", "time_limit_s=5", "--policies", "random", "--baseline", "random", "--levels", "test"]
    assert main(["--quick", *short, "--num-levels", "2", "--variant", *files]) == 0
    report = json.loads((tmp_path / "p.json").read_text())
    assert (report["episodes"], report["endless_games"]) == (24, 12)
    assert [row["speed"] for row in report["curve"]] == [0.15, 0.35, 0.6]
    (about,) = report["maps"]
    assert (about["name"], about["source"], about["num_levels"]) == ("generated:test", "--levels test", 2)
    assert report["pair"] is None
    page = Tags((tmp_path / "p.html").read_text())
    assert "2 generated houses" in "".join(page.text)


@pytest.mark.parametrize(
    ("interval", "words"),
    [
        ((0.1, 0.3), "20.0 percentage points more"),
        ((-0.3, -0.1), "20.0 percentage points fewer"),
        ((-0.1, 0.5), "not significant"),
    ],
)
def test_the_headline_claims_no_more_than_the_interval(
    interval: tuple[float, float], words: str, made: tuple[dict[str, Any], Path]
) -> None:
    report = json.loads(json.dumps(made[0]))
    report["summary"][0] |= {"difference": 0.2, "difference_ci": interval}
    assert words in headline(report)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--map", "nowhere"], "nowhere"),
        (["--map", "generated:test"], "--levels test"),
        (["--levels", "all"], "invalid choice: 'all'"),
        (["--levels", "test", "--num-levels", "5000"], "num_levels = 5000"),
        (["--policies", "nearst"], "unknown policy 'nearst'"),
        (["--baseline", "nearst"], "unknown policy 'nearst'"),
        (["--episodes", "1"], "must be at least 2"),
        (["--speeds", "-1"], "clyde.speed_mps"),
        (["--clyde-speed", "nan"], "'nan' is not a finite number"),
        (["--set", "clyde.speed_mps=1"], "--clyde-speed"),
        (["--set", "randomize.clyde_speed_mps=0.1,0.2"], "randomize.clyde_speed_mps = (0.1, 0.2): must be None"),
        (["--policies", "run.zip"], "run.zip: "),
        (["--set", "endless=true"], "endless = True: is what --endless N plays"),
        (["--set", "nav2.haste=1"], "unknown configuration field 'nav2.haste'"),
        (["--variant", "calm"], "must be NAME=SETTINGS"),
        (["--variant", "v=action=velocity"], "--variant v: action = 'velocity'"),
        (["--variant", "v=refuges.nooks=0", "v=refuges.nooks=1"], "--variant v: given twice"),
        (["--variant", "v=clyde.spawn_distance_m=-1"], "spawn_distance_m"),
        (["--out", "page.htm"], "must end in .html"),
        (["--json", "page.html", "--out", "page.html"], "is the page's file too"),
    ],
)
def test_errors_are_one_line_and_nothing_is_written(
    arguments: list[str],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    refused_in_one_line(main, ["--quick", *arguments], message, tmp_path, monkeypatch, capsys)


def test_two_maps_of_one_name_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    load_map("house").save(tmp_path / "house.yaml")
    assert main([*FEW, "--map", "house", str(tmp_path / "house.yaml")]) == 2
    assert "two maps are called house" in capsys.readouterr().err


def test_help_tells_what_decision_times_hold(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    assert "policy alone" in " ".join(capsys.readouterr().out.split())
