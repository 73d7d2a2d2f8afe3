"""The site for its readers: what a search finds, and what axe-core says of it on a phone and on screens."""

import functools
import http.server
import re
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from pacman_env.envs.registration import IDS
from tests.web.test_page_accessible import SERIOUS
from tools.ids import file_name

pytestmark = pytest.mark.daily

PAGES = (
    *("index.html", "environments/ids.html", "environments/ids/PacManBotFlat-v2.html", "reference/environments.html"),
    *("commands.html", "architecture.html", "leaderboard.html", "search.html?q=ppo"),
    *("notebooks/own_policy.html", "notebooks/game.html", "replay.html"),
)
#: Words of names in tables that are on two lines.
CUT = """() => [...document.querySelectorAll('td code .pre')].flatMap((name) => [...name.childNodes])
.filter((piece) => {
  const range = document.createRange();
  range.selectNode(piece);
  return /^[\\w."-]+$/.test(piece.data) && range.getClientRects().length > 1;
}).map(({data}) => data)"""


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, format: str, *args: Any) -> None:
        pass


@pytest.fixture(scope="module")
def address(site: Path) -> Iterator[str]:
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(site)))
    thread = threading.Thread(target=server.serve_forever)
    thread.start()
    yield f"http://127.0.0.1:{server.server_port}/"
    server.shutdown()
    thread.join()
    server.server_close()


@pytest.mark.parametrize(
    ("query", "page"),
    [
        *((file_name(env_id), f"environments/ids/{file_name(env_id)}.html") for env_id in IDS),
        ("make_policy", "reference/policies.html#pacman_env.make_policy"),
        ("PacManBotVecEnv", "reference/sb3.html#pacman_env.sb3.PacManBotVecEnv"),
        ("pacman-env compare", "commands.html#pacman-env-compare"),
    ],
)
def test_search_finds_page(chromium: Any, address: str, query: str, page: str) -> None:
    with chromium.new_context() as context:
        tab = context.new_page()
        tab.goto(f"{address}search.html?q={query}")
        tab.wait_for_selector("#search-results ul.search li a")
        tab.wait_for_function("document.querySelector('.search-summary')?.textContent.includes('found')")
        found = [link.get_attribute("href") for link in tab.locator("#search-results ul.search li > a").all()[:5]]
    assert page in [link.removeprefix(address).removesuffix("#" + page.rpartition("/")[2]) for link in found if link]


def test_search_from_disk_reports_no_error(chromium: Any, site: Path) -> None:
    errors: list[str] = []
    with chromium.new_context() as context:
        tab = context.new_page()
        tab.on("console", lambda message: errors.append(message.text) if message.type == "error" else None)
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.goto(f"{(site / 'search.html').as_uri()}?q=ppo")
        tab.wait_for_function("document.querySelector('.search-summary')?.textContent.includes('found')")
        tab.wait_for_load_state("networkidle")
        assert tab.locator("#search-results ul.search li a").count() > 5
    assert errors == []


@pytest.mark.parametrize(("width", "scheme"), [(390, "dark"), (1024, "light"), (1920, "dark")])
def test_pages_are_accessible_uncut_and_load_nothing_foreign(
    chromium: Any, address: str, axe: str, width: int, scheme: str
) -> None:
    found: dict[str, Any] = {}
    foreign: list[str] = []
    errors: list[str] = []
    with chromium.new_context(color_scheme=scheme, viewport={"width": width, "height": 900}) as context:
        tab = context.new_page()
        tab.on("request", lambda asked: foreign.append(asked.url) if not asked.url.startswith(address) else None)
        tab.on("pageerror", lambda error: errors.append(str(error)))
        for page in PAGES:
            tab.goto(address + page)
            tab.evaluate(axe)
            if serious := tab.evaluate(SERIOUS):
                found[page] = serious
            if tab.evaluate("document.documentElement.scrollWidth > innerWidth"):
                found[page] = "is wider than the window"
            if cut := tab.evaluate(CUT):
                found[page] = cut
    assert found == {}
    assert errors == []
    assert [url for url in foreign if not url.startswith("data:")] == []


@pytest.mark.parametrize(("width", "height"), [(390, 844), (360, 740), (195, 422), (844, 390), (640, 360)])
def test_replay_fits_both_maps_above_player_on_telephone(chromium: Any, site: Path, width: int, height: int) -> None:
    with chromium.new_context(viewport={"width": width, "height": height}, reduced_motion="reduce") as context:
        tab = context.new_page()
        tab.goto((site / "replay.html").as_uri())
        tab.click(".replay-player #story-next")
        maps = tab.locator(".replay-round #map")
        header = tab.locator("header:visible").first.bounding_box()
        top = min(one.bounding_box()["y"] for one in maps.all())
        tab.evaluate("(pixels) => scrollBy(0, pixels)", top - header["height"])
        player, *boxes = (one.bounding_box() for one in (tab.locator(".replay-player"), *maps.all()))
        assert player["height"] < 95
        assert player["y"] + player["height"] == pytest.approx(height, abs=1)
        for box in boxes:
            assert box["height"] >= 0.23 * height
            assert header["height"] <= box["y"] + 1
            assert box["y"] + box["height"] <= player["y"] + 1


@pytest.fixture(params=["file", "server"])
def replay(chromium: Any, site: Path, address: str, request: pytest.FixtureRequest) -> Iterator[Any]:
    """The page of the replay, opened from the file system or from a static server; it reports no error."""
    errors: list[str] = []
    with chromium.new_context(viewport={"width": 1024, "height": 768}) as context:
        tab = context.new_page()
        tab.on("pageerror", lambda error: errors.append(str(error)))
        tab.goto((site / "replay.html").as_uri() if request.param == "file" else f"{address}replay.html")
        tab.wait_for_selector(".replay-player #story-play")
        yield tab
    assert errors == []


def time_of(tab: Any) -> str:
    return str(tab.locator(".replay-player #story-at").inner_text())


def test_replay_begins_with_outcomes_and_plays(replay: Any) -> None:
    caught, complete = replay.locator(".outcome .result").all_inner_texts()
    assert caught.startswith("Caught by Clyde after ")
    assert complete.startswith("All pellets collected after ")
    replay.wait_for_function("document.querySelector('.replay-player').shadowRoot.textContent.includes('0:03 of')")
    replay.click(".replay-player #story-play")
    paused = time_of(replay)
    replay.wait_for_timeout(500)
    assert time_of(replay) == paused


def test_replay_seeks_by_time_line_and_keys(replay: Any) -> None:
    replay.locator(".replay-player #story-range").fill("100")
    assert time_of(replay).startswith("0:50 of")
    replay.locator(".replay-round #top").first.focus()
    replay.keyboard.press("ArrowRight")
    replay.keyboard.press("ArrowRight")
    assert time_of(replay).startswith("0:51 of")


def test_replay_explains_next_decision_that_differs(replay: Any, axe: str) -> None:
    replay.click(".replay-player #story-next")
    assert "1 of 13" in replay.locator(".replay-player #story-title").inner_text()
    words = replay.locator("#why-words").all_inner_texts()
    assert any(text.startswith("The policies disagree.") for text in words)
    assert all(
        re.match(r"(Pellet|Refuge) \d+: |Hold: ", text) for text in replay.locator("#why-sentence").all_inner_texts()
    )
    for summary in replay.locator(".replay-round summary").all():
        summary.click()
    assert replay.locator(".replay-round #why-table tbody tr").count() > 20
    replay.evaluate(axe)
    assert replay.evaluate(SERIOUS) == []


def test_replay_waits_if_motion_is_to_be_reduced(chromium: Any, site: Path) -> None:
    with chromium.new_context(reduced_motion="reduce") as context:
        tab = context.new_page()
        tab.goto((site / "replay.html").as_uri())
        tab.wait_for_selector(".replay-player #story-play[aria-label=Play]")
        tab.wait_for_timeout(1000)
        assert time_of(tab).startswith("0:00 of")
