"""The site for its readers: what a search finds, and what axe-core says of it on a phone and on screens."""

import functools
import http.server
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
    *("index.html", "environments/ids.html", "environments/ids/PacManBotFlat-v1.html", "reference/environments.html"),
    *("commands.html", "architecture.html", "leaderboard.html", "search.html?q=ppo"),
    *("notebooks/own_policy.html", "notebooks/game.html"),
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
        ("pacman-env leaderboard", "commands.html#pacman-env-leaderboard"),
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
