"""A real browser at the operator's page: Chromium, driven by Playwright, over the server and the simulator."""

from __future__ import annotations

import os
import shutil
import subprocess
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from pacman_env.web.page_messages import ClydeSpeed
from pacman_env.web.rules import Rules
from pacman_env.web.server import WebServer
from pacman_env.web.simulated import SimulatedGame
from tests.waiting import PATIENCE_S

FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update", "--autoplay-policy=no-user-gesture-required"),
)
AXE = "axe-core@4"
CHROMIUM = ("chromium", "chromium-browser", "google-chrome", "chrome")


def missing(what: str) -> None:
    """What a test lacks is named: a failure in CI, a skip elsewhere."""
    if os.environ.get("CI"):
        pytest.fail(f"missing: {what}")
    pytest.skip(f"missing: {what}")


@dataclass
class Visitor:
    """A user of a page; its errors are kept."""

    page: Any
    url: str
    allowed: tuple[str, ...] = ()  # beginnings of errors that belong to a test
    first: bool = False  # leaves the card of a first visit open, and the demo running
    errors: list[str] = field(default_factory=list)
    foreign: list[str] = field(default_factory=list)

    def watch(self) -> Visitor:
        self.page.on("console", lambda message: message.type == "error" and self._wrong(message.text))
        self.page.on("pageerror", lambda error: self._wrong(str(error)))
        for kind in ("request", "websocket"):
            self.page.on(kind, lambda asked: self._asked(asked.url))
        return self

    def _asked(self, url: str) -> None:
        if not url.startswith("about:") and url.split("/")[2] != self.url.split("/")[2]:
            self.foreign.append(url)

    def leave(self) -> None:
        """Before the server ends, which the page would ask for again and again."""
        self.page.goto("about:blank")

    def _wrong(self, words: str) -> None:
        if not words.startswith(self.allowed or ("\0",)):
            self.errors.append(words)

    def open(self, path: str = "", ready: bool = True) -> Visitor:
        self.page.goto(self.url + path)
        if ready:
            self.wait("window.pacman?.state.frame && window.pacman.state.scene?.map")
            if not self.first:
                self.value("document.querySelector('#welcome-close')?.click()")
        return self

    def value(self, expression: str) -> Any:
        return self.page.evaluate(
            f"(() => {{ const {{count, state, view}} = window.pacman ?? {{}}; return {expression} }})()"
        )

    def wait(self, expression: str, why: str = "") -> Any:
        """Until an expression of the page is true."""
        end = time.monotonic() + PATIENCE_S
        while not (value := self.value(expression)):
            if time.monotonic() > end:
                raise AssertionError(f"never: {why or expression}\n{self.value('JSON.stringify(count)')}")
            self.page.wait_for_timeout(25)
        return value

    def until(self, what: Callable[[], Any], why: str) -> None:
        """Until something outside the page is true."""
        end = time.monotonic() + PATIENCE_S
        while not what():
            assert time.monotonic() < end, f"never: {why}"
            self.page.wait_for_timeout(25)

    def press(self, *names: str) -> None:
        for name in names:
            self.page.click(f"#{name}")

    def reset(self) -> None:
        """Press Reset, and confirm it if a round would be lost."""
        self.press("reset")
        if self.page.is_visible("#ask-yes"):
            self.press("ask-yes")

    def slide(self, name: str, value: float) -> None:
        self.page.locator(f"#{name}").fill(str(value))

    def text(self, name: str) -> str:
        return str(self.page.locator(f"#{name}").text_content()).strip()

    def click_at(self, x: float, y: float) -> None:
        """On the map, m."""
        box = self.page.locator("#top").bounding_box()
        left, top = self.value(f"view.toScreen({x}, {y})")
        self.page.mouse.click(box["x"] + left, box["y"] + top)

    def check(self) -> None:
        errors = [*self.errors, *(self.value("count?.errors ?? []") or [])]
        errors = [words for words in errors if not words.startswith(self.allowed or ("\0",))]
        assert not errors, f"errors of the page: {errors}"
        assert not self.foreign, f"asked other hosts: {self.foreign}"


@pytest.fixture(scope="module")
def chromium() -> Iterator[Any]:
    """The browser of the system; while it is there, this thread has an event loop, and no test may bring another."""
    try:
        from playwright.sync_api import sync_playwright
    except ModuleNotFoundError:
        missing("Playwright for Python")
    program = next(filter(None, map(shutil.which, CHROMIUM)), None)
    if program is None:
        missing("Chromium (apt-get install chromium)")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=program, args=list(FLAGS))
        yield browser
        browser.close()


@pytest.fixture
def simulated() -> Iterator[SimulatedGame]:
    """A game with short rounds, and a Clyde that is no danger."""
    game = SimulatedGame(Rules(settings={"time_limit_s": 90.0}), seed=3)
    game.handle("nobody", ClydeSpeed(mps=0.05))
    yield game
    game.close()


@pytest.fixture
def page_server(simulated: SimulatedGame) -> Iterator[WebServer]:
    with WebServer(simulated, write=lambda _: None) as server:
        yield server


@pytest.fixture
def visit(chromium: Any, page_server: WebServer) -> Iterator[Callable[..., Visitor]]:
    """Opens the page in a browser of its own; at the end nothing may have gone wrong in any."""
    visitors: list[Visitor] = []
    contexts = []

    def opened(
        path: str = "", *, allowed: tuple[str, ...] = (), ready: bool = True, first: bool = False, **settings: Any
    ) -> Visitor:
        motion = "no-preference" if first else "reduce"  # without the demo, which costs the server a round
        context = chromium.new_context(
            **{"viewport": {"width": 1280, "height": 800}, "reduced_motion": motion, **settings}
        )
        contexts.append(context)
        page = context.new_page()
        page.set_default_timeout(PATIENCE_S * 1000)
        page.add_init_script(
            "let away = false;"
            "Object.defineProperty(document, 'hidden', {get: () => away});"
            "window.goAway = (on) => { away = on; document.dispatchEvent(new Event('visibilitychange')); };"
        )
        url = f"http://127.0.0.1:{page_server.port}/"
        visitor = Visitor(page, url, allowed, first).watch()
        visitors.append(visitor)
        return visitor.open(path, ready)

    yield opened
    try:
        for visitor in visitors:
            visitor.check()
    finally:
        for context in contexts:
            context.close()


@pytest.fixture(scope="session")
def axe(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The source of axe-core, by npm; kept in the folder ``AXE_CORE`` if it is set."""
    kept = os.environ.get("AXE_CORE")
    folder = Path(kept) if kept else tmp_path_factory.mktemp("axe")
    source = folder / "node_modules" / "axe-core" / "axe.min.js"
    if not source.exists():
        npm = shutil.which("npm")
        if npm is None:
            missing("npm, for axe-core")
        folder.mkdir(parents=True, exist_ok=True)
        command = [str(npm), "install", "--no-save", "--no-audit", "--no-fund", "--prefix", str(folder), AXE]
        done = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
        if not source.exists():
            missing(f"axe-core from npm ({done.stderr.strip()[-200:]})")
    return source.read_text()
