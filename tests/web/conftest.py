"""A server over a game, with a few files for a page, on this machine's own address."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx
import pytest

from pacman_env.web import routes
from pacman_env.web.server import WebServer
from tests.web.browser import axe, chromium, page_server, simulated, visit  # noqa: F401 - fixtures
from tests.web.pages import FILES
from tests.web.scripted_game import ScriptedGame


@pytest.fixture
def lines() -> list[str]:
    return []


@pytest.fixture(scope="session")
def web() -> Iterator[httpx.Client]:
    with httpx.Client(trust_env=False) as client:
        yield client


@pytest.fixture
def game() -> ScriptedGame:
    return ScriptedGame()


@pytest.fixture
def server(serve: Callable[..., WebServer], game: ScriptedGame) -> WebServer:
    """Serve the game to this machine, without tokens."""
    return serve(game)


@pytest.fixture
def serve(tmp_path: Path, lines: list[str], monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[..., WebServer]]:
    """Starts a server over a game."""
    folder = tmp_path / "static"
    folder.mkdir()
    for name, content in FILES.items():
        (folder / name).write_bytes(content)
    (tmp_path / "secret.js").write_text("secret")
    monkeypatch.setattr(routes, "STATIC", folder)
    started: list[WebServer] = []

    def start(game: Any, **settings: Any) -> WebServer:
        server = WebServer(game, **{"write": lines.append, **settings})
        started.append(server)
        server.start()
        return server

    yield start
    for server in started:
        server.close()
