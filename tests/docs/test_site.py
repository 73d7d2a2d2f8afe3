"""The site is complete: it builds without a warning, everything public has its place, and no link leads nowhere."""

import json
import re
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import pytest

from pacman_env.envs.registration import ENV_ID, FLAT_ID, IDS
from tests.pages import public_names
from tools.common import ROOT, STATIC, SUFFIXES
from tools.ids import file_name

COMMANDS = set(re.findall(r"^## `(.*)`", (ROOT / "docs" / "commands.md").read_text(), re.MULTILINE))


class Page(HTMLParser):
    """Ids of a page, where it leads to, and what it says about itself."""

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.ids: set[str] = set()
        self.targets: list[str] = []
        self.about: dict[str, str] = {}
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        if tag == "meta" and (name := dict(attrs).get("property") or dict(attrs).get("name")):
            assert name not in self.about or name == "viewport", name
            self.about[name] = dict(attrs)["content"] or ""
        for name, value in attrs:
            if name == "id" and value:
                self.ids.add(value)
            elif name in ("href", "src") and value:
                self.targets.append(value)


def test_site_sources_need_no_other_extra() -> None:
    others = "starlette", "uvicorn", "websockets", "segno", "matplotlib", "imageio", "psutil", "tqdm", "torch"
    code = f"import sys; sys.modules.update(dict.fromkeys({others})); import tools.site"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


@pytest.fixture(scope="module")
def pages(site: Path) -> dict[Path, Page]:
    others = {"_static", "play"}  # what the theme brings, and the game
    own = (path for path in site.rglob("*.html") if others.isdisjoint(path.relative_to(site).parts))
    return {path: Page(path) for path in own}


@pytest.fixture(scope="module")
def index(site: Path) -> dict[str, Any]:
    """What the search of the site knows."""
    text = (site / "searchindex.js").read_text(encoding="utf-8")
    found: dict[str, Any] = json.loads(text.removeprefix("Search.setIndex(").removesuffix(")"))
    return found


def test_site_build_writes_only_into_its_folders(site: Path) -> None:
    assert {path.name for path in site.parent.iterdir()} == {"site", "build", "jupyter_execute"}  # myst-nb's


def test_site_contains_every_documentation_page(pages: dict[Path, Page], site: Path) -> None:
    for path in (*(ROOT / "docs").rglob("*.md"), *(ROOT / "docs").rglob("*.ipynb")):
        assert site / path.relative_to(ROOT / "docs").with_suffix(".html") in pages


def test_site_links_lead_to_existing_pages_and_anchors(pages: dict[Path, Page], site: Path) -> None:
    dead = []
    for path, page in pages.items():
        for target in page.targets:
            url = urlsplit(target)
            if url.scheme or url.netloc:
                continue
            there = (path.parent / unquote(url.path)).resolve() if url.path else path
            if not there.exists() or (url.fragment and there in pages and url.fragment not in pages[there].ids | {""}):
                dead.append(f"{path.relative_to(site)}: {target}")
    assert dead == []
    assert sum(len(page.targets) for page in pages.values()) > 5000


@pytest.mark.parametrize("env_id", IDS)
def test_id_page_has_every_section_and_picture(site: Path, env_id: str) -> None:
    text = (site / "environments" / "ids" / f"{file_name(env_id)}.html").read_text(encoding="utf-8")
    titles = ["Action space", "Observation space", "Rewards", "Episode end", "Example", "Reference scores"]
    whole = env_id in (ENV_ID, FLAT_ID)  # the others refer to one of these
    for title in [*titles, *(["Decision process", "Arguments", "Settings", "Version history"] if whole else [])]:
        assert re.search(rf"<h2>{title}<", text), title
    assert env_id in text
    for theme, suffix in SUFFIXES.items():
        film = f"{file_name(env_id)}{suffix}.webp"
        assert re.search(rf'class="only-{theme}"[^>]* src="[./]+/_images/{film}"', text)
        assert (site / "_images" / film).stat().st_size < 350_000
    assert ("<h2>Several agents<" in text) == (IDS[env_id].several is not None)


def test_pages_have_title_description_and_picture_when_shared(pages: dict[Path, Page]) -> None:
    for path, page in pages.items():
        assert 20 < len(page.about["description"]) <= 160, path
        assert page.about["og:description"] == page.about["description"]
        assert page.about["og:title"], path
        assert (path.parent / page.about["og:image"]).is_file(), path
        assert "og:url" not in page.about, path  # the address of this site is not known
    assert len({page.about["description"] for page in pages.values()}) == len(pages)


def test_operator_page_has_description_when_shared() -> None:
    about = Page(STATIC / "index.html").about
    assert about["og:title"] == "pacman_env"
    assert 20 < len(about["description"]) <= 160
    assert about["og:description"] == about["description"]


def test_commands_page_has_section_for_every_command(pages: dict[Path, Page], site: Path) -> None:
    sections = {re.sub("[ _]", "-", name) for name in COMMANDS}
    assert len(sections) > 20
    assert sections <= pages[site / "commands.html"].ids


def test_search_index_contains_ids_commands_and_public_names(index: dict[str, Any]) -> None:
    titles = index["alltitles"].keys()
    assert {file_name(env_id) for env_id in IDS} <= titles
    assert titles >= COMMANDS
    objects = {f"{owner}.{entry[4]}" for owner, entries in index["objects"].items() for entry in entries}
    assert {f"pacman_env.{name}" for name in public_names()} <= objects


def test_pages_contain_no_path_of_build_machine(pages: dict[Path, Page], site: Path) -> None:
    for path in pages:
        assert str(ROOT) not in path.read_text(encoding="utf-8"), path
        assert str(site) not in path.read_text(encoding="utf-8"), path
