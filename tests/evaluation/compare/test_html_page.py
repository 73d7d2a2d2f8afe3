"""The page of a comparison in a browser: on a screen, on paper, and judged by axe-core."""

import json
import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from pacman_env.evaluation.compare.__main__ import main
from pacman_env.evaluation.compare.html_page import render_page
from pacman_env.evaluation.replay import make_parser as replay_parser
from pacman_env.evaluation.replay import record_games
from pacman_env.evaluation.rounds import scenarios
from tests.evaluation.helpers import comparison
from tests.web.browser import axe, chromium
from tests.web.test_page_accessible import RUN

__all__ = ["axe", "chromium"]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Path]:
    folder = tmp_path_factory.mktemp("page")
    page, film = folder / "page.html", folder / "film.mp4"
    views = ["--html", str(page), "--video", str(film), "--clyde-speed", "0.25", "0.4"]
    comparison(folder / "r.json", *views, "--policies", "clyde_aware", "random_pellet")
    return json.loads((folder / "r.json").read_text()), page


def test_page_is_self_contained_with_poster(made: tuple[dict[str, Any], Path]) -> None:
    text = made[1].read_text()
    assert not re.search(r'(src|href|poster)="(?!data:)|@import|url\(|<script|<link', text)
    assert 'poster="data:image/png;base64,' in text
    assert 'src="data:video/mp4;base64,' in text


def test_page_replays_rounds_completed_by_one_policy(made: tuple[dict[str, Any], Path]) -> None:
    report, page = made
    ours, theirs = (row["outcomes"]["end"] for row in report["rows"][:2])
    number = next(k for k, (a, b) in enumerate(zip(ours, theirs, strict=True)) if (a == "C") != (b == "C"))
    seed = report["seeds"][number]
    command = re.search(rf"pacman-env replay {seed} [^<]*--clyde-speed 0\.25 [^<]*", page.read_text())
    assert command is not None
    arguments = replay_parser().parse_args(shlex.split(command[0])[2:])
    (place,), (config,) = scenarios.from_arguments(arguments), scenarios.game_configs(arguments)
    for game, end in zip(
        record_games(place, config, scenarios.named_policies(arguments.policies), arguments.seed),
        (ours[number], theirs[number]),
        strict=True,
    ):
        while not game.over:
            game.step()
        assert game.outcome().startswith("complete") == (end == "C")


def test_page_escapes_every_text(made: tuple[dict[str, Any], Path]) -> None:
    text, evil = json.dumps(made[0]), "<script>alert('1')</script>\"&"
    for name in ("random_pellet", "clyde_aware", "house"):
        text = text.replace(f'"{name}"', json.dumps(evil + name))
    content = json.loads(text) | {"command": evil}
    page = render_page(content, None, None, None)
    assert "<script" not in page
    assert page.count("&lt;script&gt;") >= 6


def test_page_of_one_policy_compares_nothing(tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    short = ["--episodes", "2", "--time-limit", "5", "--json", str(tmp_path / "r.json"), "--html", str(page)]
    assert main([*short, "--policies", "nearest", "--endless"]) == 0
    assert "pellets per game" in page.read_text()


@pytest.mark.parametrize(("width", "scheme"), [(390, "dark"), (1280, "light")])
def test_axe_finds_no_fault_on_page(
    made: tuple[dict[str, Any], Path], chromium: Any, axe: str, width: int, scheme: str
) -> None:
    page = chromium.new_page(viewport={"width": width, "height": 844}, color_scheme=scheme)
    page.goto(made[1].as_uri())
    page.evaluate(axe)
    assert page.evaluate(RUN) == []
    assert page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    page.close()


def test_paper_shows_colours_and_every_column(made: tuple[dict[str, Any], Path], chromium: Any) -> None:
    page = chromium.new_page(viewport={"width": 1032, "height": 700}, color_scheme="dark")
    page.emulate_media(media="print", color_scheme="dark")
    page.goto(made[1].as_uri())
    hidden = "[...document.querySelectorAll('.wide')].filter((one) => one.scrollWidth > one.clientWidth).length"
    assert page.evaluate(hidden) == 0
    styles = page.evaluate(
        "['body', 'td'].map((one) => getComputedStyle(document.querySelector(one)))"
        ".map(({printColorAdjust, color}) => [printColorAdjust, color])"
    )
    assert styles == [["exact", "rgb(29, 36, 48)"]] * 2
    page.close()
