"""Hostile and broken clients: refused, and the game and the other pages are not disturbed."""

import contextlib
import logging
import socket
from collections.abc import Callable

import httpx
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from pacman_env.web import server as module
from pacman_env.web import sessions
from pacman_env.web.access import Tokens
from pacman_env.web.server import WebServer
from tests.waiting import wait_for
from tests.web.pages import Page, at, upgrade
from tests.web.scripted_game import ScriptedGame


def knock(url: str, **headers: str) -> int:
    """Open a websocket; return the status by which it is refused, 101 if it is accepted."""
    try:
        with connect(url, additional_headers=headers, compression=None):
            return 101
    except InvalidStatus as error:
        return error.response.status_code


def test_foreign_requests_are_refused_and_logged_once(
    serve: Callable[..., WebServer], lines: list[str], web: httpx.Client
) -> None:
    game = ScriptedGame()
    server = serve(game, tokens=Tokens.new())
    bare = server.url.partition("?")[0]
    for _ in range(3):
        assert web.get(server.url, headers={"host": "evil.example"}).status_code == 421
        assert knock(at(server.url, "ws"), Origin="http://evil.example") == 403
        assert web.post(at(server.url, "map"), headers={"origin": "null"}).status_code == 403
        assert {knock(at(bare, "ws")), knock(at(f"{bare}?token=wrong", "ws"))} == {401}
    assert game.handled == []
    assert len(lines) == 3


def test_huge_message_ends_its_own_connection_only(server: WebServer) -> None:
    with Page(server) as other, Page(server) as page:
        with contextlib.suppress(ConnectionClosed):
            page.socket.send("x" * 10_000_000)
        with pytest.raises(ConnectionClosed):
            page.ask("ping")
        assert other.ask("stop")["ok"]


def test_client_that_reads_nothing_is_disconnected(
    serve: Callable[..., WebServer], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sessions, "SLOW_S", 0.5)
    game = ScriptedGame()
    server = serve(game)
    with Page(server) as page, contextlib.ExitStack() as them:
        for _ in range(5):
            them.enter_context(upgrade(server))
        page.people(viewers=6)
        while [text for text in page.texts if text["kind"] == "people"][-1]["viewers"] != 1:
            game.happens(words="x" * 300_000)
            page.wait("news")  # or the next one would be sent together with it, and be too much for this page, too
            assert len(game.entries) < 200


def test_page_is_disconnected_if_it_ignores_pings(
    serve: Callable[..., WebServer], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "PING_S", 0.2)
    monkeypatch.setattr(module, "PONG_S", 0.3)
    game = ScriptedGame()
    server = serve(game)
    with Page(server) as page, upgrade(server):
        page.people(viewers=2)
        page.people(viewers=1)
        wait_for(lambda: ("leave", "guest-2") in game.calls)


def test_viewers_beyond_the_limit_are_refused(serve: Callable[..., WebServer], lines: list[str]) -> None:
    server = serve(ScriptedGame(), tokens=Tokens.new(), viewers=3)
    assert server.tokens is not None
    url = at(server.url.replace(server.tokens.operator, server.tokens.viewer), "ws")
    with contextlib.ExitStack() as crowd:
        for _ in range(3):
            crowd.enter_context(connect(url, compression=None))
        assert [knock(url), knock(url)] == [503, 503]
        with Page(server) as page:  # an operator still comes in
            assert page.ask("stop")["ok"]
    assert len(lines) == 1


def test_connections_beyond_the_limit_are_refused(
    serve: Callable[..., WebServer], web: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "SPARE_CONNECTIONS", 2)
    server = serve(ScriptedGame(), viewers=1)
    with contextlib.ExitStack() as them:
        for _ in range(10):
            them.enter_context(socket.create_connection(("127.0.0.1", server.port)))
        wait_for(lambda: web.get(f"{server.url}health").status_code == 503)
    wait_for(lambda: web.get(f"{server.url}health").status_code == 200)


def test_broken_upload_does_not_block_later_uploads(serve: Callable[..., WebServer], web: httpx.Client) -> None:
    server = serve(ScriptedGame())
    for _ in range(3):
        with socket.create_connection(("127.0.0.1", server.port)) as there:
            there.sendall(
                f"POST /map HTTP/1.1\r\nhost: 127.0.0.1:{server.port}\r\ncontent-length: 9\r\n\r\n{{".encode()
            )
    body = {"name": "a", "yaml": "b", "image": ""}
    wait_for(lambda: web.post(f"{server.url}map", json=body).status_code == 200)


def test_log_contains_no_token(
    serve: Callable[..., WebServer], lines: list[str], web: httpx.Client, caplog: pytest.LogCaptureFixture
) -> None:
    for name in ("httpx", "httpcore", "websockets"):  # the clients
        caplog.set_level(logging.CRITICAL, name)
    caplog.set_level(logging.DEBUG)
    game = ScriptedGame()
    server = serve(game, tokens=Tokens.new())
    assert server.tokens is not None
    logging.getLogger("uvicorn.error").setLevel(logging.DEBUG)
    logging.getLogger("uvicorn.access").setLevel(logging.DEBUG)
    with Page(server) as page:
        game.fails = {"handle", "choices"}
        page.ask("start")
        web.get(server.url)
        web.get(at(server.url, "story/1.json"))
        knock(at(server.url, "ws"), Origin="http://evil.example")
    server.close()
    for token in (server.tokens.operator, server.tokens.viewer):
        assert token not in caplog.text + "".join(lines)
    assert "token=..." in caplog.text, "the library has logged it, and been corrected"
