"""Hostile and broken clients: refused, logged once, and the game and the others are not disturbed."""

from __future__ import annotations

import asyncio
import contextlib
import itertools
import json
import logging
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from random import Random
from typing import Any

import httpx
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from websockets.asyncio.client import connect as connect_async
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from pacman_env.web import messages
from pacman_env.web.access import Tokens
from pacman_env.web.server import CONNECTIONS, SPARE_CONNECTIONS, WebServer
from pacman_env.web.viewers import MESSAGES_PER_S
from tests.waiting import PATIENCE_S, wait_for
from tests.web.frames import decode
from tests.web.page_messages import RIGHT, as_sent, is_right, texts
from tests.web.pages import Page, at, viewer_url
from tests.web.scripted_game import ScriptedGame

TURNS = 5  # of threads, from one look at the game to the next


def status(url: str, **headers: str) -> int:
    """With which a websocket is refused; 101: it is not."""
    try:
        with connect(url, additional_headers=headers, compression=None):
            return 101
    except InvalidStatus as error:
        return error.response.status_code


def wire(server: WebServer, *lines: str, receive_bytes: int = 0) -> socket.socket:
    """A connection that sends these lines of a request, and perhaps no more."""
    there = socket.socket()
    if receive_bytes:
        there.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, receive_bytes)
    there.settimeout(PATIENCE_S)
    there.connect(("127.0.0.1", server.port))
    there.sendall("".join(f"{line}\r\n" for line in lines).encode())
    return there


def upgrade(server: WebServer, receive_bytes: int = 0) -> socket.socket:
    """A websocket, by hand."""
    host = f"host: 127.0.0.1:{server.port}"
    lines = (
        "upgrade: websocket",
        "connection: upgrade",
        "sec-websocket-version: 13",
        f"sec-websocket-key: {'A' * 22}==",
    )
    return wire(server, "GET /ws HTTP/1.1", host, *lines, "", receive_bytes=receive_bytes)


def rest(there: socket.socket) -> bytes:
    """What else comes, until the server ends it."""
    parts = []
    with contextlib.suppress(ConnectionError):
        while part := there.recv(1 << 16):
            parts.append(part)
    there.close()
    return b"".join(parts)


def longest(times: list[float]) -> float:
    return max((after - before for before, after in itertools.pairwise(times)), default=0.0)


@contextlib.contextmanager
def ticking() -> Iterator[list[float]]:
    """When a thread beside the server's was run that is to run all the time: what the machine's other work takes."""
    times, ended = [time.monotonic()], threading.Event()

    def tick() -> None:
        while not ended.wait(0.02):
            times.append(time.monotonic())

    thread = threading.Thread(target=tick)
    thread.start()
    try:
        yield times
    finally:
        ended.set()
        thread.join()


@contextlib.contextmanager
def undisturbed(server: WebServer, most_s: float = 2.0) -> Iterator[Page]:
    """Another's page meanwhile: the game is looked at all the time, the frames come to it, and it is answered.

    Looks are no more than ``most_s`` apart, but for the waits for the processor: a look takes some turns of threads.
    """
    game = server._game
    assert isinstance(game, ScriptedGame)
    with Page(server) as page, ticking() as times:
        page.wait("scene")
        first = len(game.polled_at)
        yield page
        page.listen(0.2)
        assert page.ask("ping")["ok"]
        looks = game.polled_at[first:]
        assert longest(looks) < most_s + TURNS * longest([*times, time.monotonic()])
        numbers = [decode(frame).number for _, frame in page.frames]
        assert numbers == sorted(set(numbers))
        assert len(numbers) > len(looks) / 2  # of a busy machine


def test_requests_without_a_token_with_a_wrong_one_or_from_elsewhere_are_refused_and_logged_once(
    serve: Callable[..., WebServer], lines: list[str], web: httpx.Client
) -> None:
    game = ScriptedGame()
    server = serve(game, tokens=Tokens.new())
    assert server.tokens is not None
    base = server.url.partition("?")[0]
    ws = at(base, "ws")
    host = f"127.0.0.1:{server.port}"
    with undisturbed(server):
        for _ in range(20):
            assert status(ws) == 401
            assert status(f"{ws}?token=wrong") == 401
            assert status(f"{ws}?token={server.tokens.operator[:-1]}") == 401
            assert status(at(server.url, "ws"), Origin="http://evil.example") == 403
            assert status(at(server.url, "ws"), Origin="null") == 403
            assert web.get(base).status_code == 401
            assert web.get(server.url, headers={"host": "evil.example"}).status_code == 421
            assert web.post(at(server.url, "map"), headers={"origin": "http://evil.example"}).status_code == 403
        assert status(at(server.url, "ws"), Origin=f"http://{host}") == 101
        assert status(at(viewer_url(server), "ws")) == 101
    assert len(lines) == 3
    assert game.handled == []


def test_on_this_machine_a_page_from_elsewhere_is_refused_too(serve: Callable[..., WebServer]) -> None:
    server = serve(ScriptedGame())
    assert status(at(server.url, "ws"), Origin="http://evil.example") == 403
    there = wire(server, "GET / HTTP/1.1", f"host: evil.example:{server.port}", "connection: close", "")
    assert rest(there).startswith(b"HTTP/1.1 421")
    assert status(at(server.url, "ws"), Origin=f"http://127.0.0.1:{server.port}") == 101


def test_a_token_is_in_no_log_whatever_is_done_with_it(
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
        with contextlib.suppress(ConnectionClosed):
            Page(server).close()
        web.get(server.url)
        web.get(server.url, headers={"authorization": f"Bearer {server.tokens.operator}"})
        web.get(at(server.url, "story/1.json"))
        rest(wire(server, f"GET /?token={server.tokens.operator} HTTP/1.1", "host: a b", "bad header", ""))
        rest(wire(server, f"GET /?token={server.tokens.operator}&a=\x01 HTTP/1.1", ""))
        status(at(server.url, "ws"), Origin="http://evil.example")
    server.close()
    for token in (server.tokens.operator, server.tokens.viewer):
        assert token not in caplog.text
        assert token not in "\n".join(lines)
    assert "token=..." in caplog.text  # the library has logged it, and been corrected


def drawn_wrong(count: int) -> list[str]:
    """Messages that are none: drawn over the schema, and those again with a piece cut out, doubled or exchanged."""
    drawn: list[str] = []

    @given(st.lists(texts, min_size=50, max_size=50))
    @settings(max_examples=12, suppress_health_check=list(HealthCheck), derandomize=True, database=None, deadline=None)
    def draw(batch: list[str]) -> None:
        drawn.extend(batch)

    draw()
    random = Random(1)
    right = [as_sent(word) for word in RIGHT]
    while len(drawn) < 2 * count:
        text = random.choice(random.choice((drawn, right)))
        first, last = sorted(random.choices(range(len(text) + 1), k=2))
        other = random.choice(right)
        drawn.append(
            text[:first] + random.choice(("", 2 * text[first:last], other[first:last], "\0", "é")) + text[last:]
        )
    return [text for text in drawn if len(text) < 2000 and not is_right(text)][:count]


def test_ten_thousand_malformed_messages_change_nothing(serve: Callable[..., WebServer], lines: list[str]) -> None:
    game = ScriptedGame()
    server = serve(game, messages_per_s=1e9)
    wrong = drawn_wrong(10_000)
    assert len(wrong) == 10_000
    with undisturbed(server), Page(server) as page:
        for k, text in enumerate(wrong):
            page.socket.send(text)
            if k % 32 == 31:  # a client that does not read its answers is disconnected
                assert page.ask("ping")["ok"]
        assert page.ask("ping")["ok"]
        assert sum(text["kind"] == "refused" for text in page.texts) == 10_000
    assert (game.handled, lines) == ([], [])
    assert {call[0] for call in game.calls} <= {"greet", "watch", "leave"}


def test_bytes_are_refused_with_words(serve: Callable[..., WebServer]) -> None:
    with Page(serve(ScriptedGame())) as page:
        page.socket.send(b'{"do":"start"}')
        assert "bytes are not" in page.wait("refused")["words"]


def test_a_message_of_10_mb_ends_its_connection(serve: Callable[..., WebServer]) -> None:
    game = ScriptedGame()
    server = serve(game)
    with undisturbed(server):
        for message in ("x" * 10_000_000, ("x" * 10_000 for _ in range(1000))):  # at once, and in parts
            page = Page(server)
            with contextlib.suppress(ConnectionClosed):
                page.socket.send(message)
            with pytest.raises(ConnectionClosed):
                page.listen(page.patience_s)
            with contextlib.suppress(ConnectionClosed):
                page.close()
    assert game.handled == []


def test_a_flood_of_messages_is_refused_once_a_second_and_ended_and_stop_is_obeyed_all_the_same(
    serve: Callable[..., WebServer],
) -> None:
    game = ScriptedGame()
    server = serve(game)
    with undisturbed(server), Page(server) as page:
        began = time.monotonic()
        for _ in range(200):
            page.socket.send('{"do":"reset"}')
        assert page.ask("stop")["ok"]
        wait_for(lambda: game.handled)
        handled = len(game.handled)
        assert handled <= MESSAGES_PER_S * (1 + time.monotonic() - began)
        with contextlib.suppress(ConnectionClosed):
            for _ in range(2000):
                page.socket.send('{"do":"reset"}')
        with pytest.raises(ConnectionClosed):
            page.listen(page.patience_s)
        refused = [text for text in page.texts if "some are ignored" in text.get("words", "")]
        assert 1 <= len(refused) <= 1 + time.monotonic() - began
        assert page.texts[-1] == {"kind": "bye", "words": "too many messages"}


def test_slow_requests_are_ended_and_others_let_in_meanwhile(serve: Callable[..., WebServer]) -> None:
    server = serve(ScriptedGame(), headers_s=0.5, body_s=0.5)
    host = f"host: 127.0.0.1:{server.port}"
    with undisturbed(server):
        slow = [wire(server) for _ in range(20)]
        slow += [wire(server, "GET / HTTP/1.1", host) for _ in range(20)]
        answered = wire(server, "GET /health HTTP/1.1", host, "")
        answer = b""
        while b"version" not in answer:
            answer += answered.recv(1 << 16)
        assert answer.startswith(b"HTTP/1.1 200")
        answered.sendall(b"GET /health HTTP/1.1\r\n")  # and half a second one
        body = wire(server, "POST /map HTTP/1.1", host, "content-length: 1000", "", "{")
        for there in (*slow, answered):
            assert rest(there) == b""
        assert rest(body).startswith(b"HTTP/1.1 408")


def test_a_client_that_sends_a_byte_now_and_then_has_no_more_time_than_others(serve: Callable[..., WebServer]) -> None:
    server = serve(ScriptedGame(), headers_s=0.5)
    there = wire(server, "GET / HTTP/1.1")

    def is_ended() -> bool:
        try:
            there.sendall(b"a")
            there.setblocking(False)
            return there.recv(10) == b""
        except BlockingIOError:
            return False
        except ConnectionError:
            return True
        finally:
            there.settimeout(PATIENCE_S)

    wait_for(is_ended)
    there.close()


def test_a_thousand_connections_are_refused_beyond_the_limit_and_make_room_again(
    serve: Callable[..., WebServer], lines: list[str], web: httpx.Client
) -> None:
    server = serve(ScriptedGame(), viewers=20, headers_s=PATIENCE_S)
    most = CONNECTIONS * 20 + SPARE_CONNECTIONS
    with undisturbed(server), contextlib.ExitStack() as them:
        many = [them.enter_context(wire(server)) for _ in range(1000)]
        wait_for(lambda: all(_is_cut(there) for there in many[2 * most :]))
        full = many[most + most // 2]
        full.sendall(b"GET / HTTP/1.1\r\n")
        assert rest(full).startswith(b"HTTP/1.1 503")
    wait_for(lambda: _answers(web, server))
    with Page(server) as page:
        page.wait("scene")
    assert lines == []


def _is_cut(there: socket.socket) -> bool:
    there.setblocking(False)
    try:
        return there.fileno() < 0 or there.recv(1, socket.MSG_PEEK) == b""
    except BlockingIOError:
        return False
    except OSError:
        return True
    finally:
        if there.fileno() >= 0:
            there.settimeout(PATIENCE_S)


def _answers(web: httpx.Client, server: WebServer) -> bool:
    try:
        return web.get(f"{server.url}health").status_code == 200
    except httpx.HTTPError:
        return False


def test_more_viewers_than_may_be_are_refused_and_operators_still_come_in(
    serve: Callable[..., WebServer], lines: list[str]
) -> None:
    server = serve(ScriptedGame(), tokens=Tokens.new(), viewers=30)

    options: dict[str, Any] = {"compression": None, "max_queue": None, "close_timeout": 1.0}

    async def crowd() -> tuple[int, list[int]]:
        async with contextlib.AsyncExitStack() as them:
            refused = []
            for _ in range(60):
                try:
                    await them.enter_async_context(connect_async(at(viewer_url(server), "ws"), **options))
                except InvalidStatus as error:
                    refused.append(error.response.status_code)
            operator = await them.enter_async_context(connect_async(at(server.url, "ws"), **options))
            hello = json.loads(await operator.recv())
            assert hello["access"] == "operator"
            return 60 - len(refused), refused

    accepted, refused = asyncio.run(crowd())
    assert (accepted, set(refused)) == (30, {503})
    assert len(lines) == 1


def test_a_client_that_reads_nothing_is_disconnected_and_delays_no_other(serve: Callable[..., WebServer]) -> None:
    game = ScriptedGame()
    server = serve(game)
    with undisturbed(server) as page, contextlib.ExitStack() as them:
        for _ in range(5):
            them.enter_context(upgrade(server, receive_bytes=4096))
        page.people(viewers=6)
        words = "x" * 300_000
        while [text for text in page.texts if text["kind"] == "people"][-1]["viewers"] != 1:  # too much to take
            game.happens(words=words)
            page.wait("news")  # or the next one would be sent together with it, and be too much for this page, too
            assert len(game.entries) < 200


def test_a_client_that_sends_pings_and_reads_nothing_is_disconnected(serve: Callable[..., WebServer]) -> None:
    server = serve(ScriptedGame())
    with undisturbed(server):
        there = upgrade(server, receive_bytes=4096)
        ping = struct.pack("!BB4s", 0x89, 0x80 | 125, bytes(4)) + bytes(125)
        sent = 0
        with contextlib.suppress(OSError):
            while sent < 100e6:
                there.sendall(ping * 500)
                sent += 500 * len(ping)
        there.close()
        assert sent < 100e6


def test_an_upload_that_breaks_off_leaves_the_way_free(
    serve: Callable[..., WebServer], lines: list[str], web: httpx.Client
) -> None:
    game = ScriptedGame()
    server = serve(game)
    for _ in range(3):
        there = wire(server, "POST /map HTTP/1.1", f"host: 127.0.0.1:{server.port}", "content-length: 9", "", "{")
        there.close()
    body = {"name": "a", "yaml": "b", "image": ""}
    wait_for(lambda: web.post(f"{server.url}map", json=body).status_code == 200)
    assert lines == []


@given(st.binary(max_size=200))
@settings(max_examples=100, suppress_health_check=list(HealthCheck), derandomize=True, database=None)
def _any_bytes(server: WebServer, data: bytes) -> None:
    with contextlib.suppress(OSError):
        there = wire(server)
        there.sendall(data + b"\r\n\r\n")
        there.shutdown(socket.SHUT_WR)
        rest(there)


def test_whatever_bytes_come_the_server_stays(
    serve: Callable[..., WebServer], lines: list[str], web: httpx.Client
) -> None:
    server = serve(ScriptedGame(), headers_s=0.2)
    with undisturbed(server):
        _any_bytes(server)
    assert _answers(web, server)
    assert lines == []


def test_a_phone_that_is_gone_without_a_word_is_noticed(
    serve: Callable[..., WebServer], monkeypatch: pytest.MonkeyPatch
) -> None:
    from pacman_env.web import server as module

    monkeypatch.setattr(module, "PING_S", 0.2)
    monkeypatch.setattr(module, "PONG_S", 0.3)
    game = ScriptedGame()
    server = serve(game)
    with Page(server) as page:
        dead = upgrade(server)
        page.people(viewers=2)
        page.people(viewers=1)
        assert ("leave", "guest-2") in game.calls
        dead.close()


def test_a_viewer_gets_no_further_by_any_message(serve: Callable[..., WebServer]) -> None:
    game = ScriptedGame()
    server = serve(game, tokens=Tokens.new(), messages_per_s=1e9)
    answered: Any = {}
    with Page(server, viewer_url(server)) as page:
        for word, fields in RIGHT.items():
            answered[word] = page.ask(word, **fields)["ok"]
    allowed = {kind.__struct_config__.tag for kind in messages.FOR_ALL}
    assert {word for word, ok in answered.items() if ok} == allowed
    assert {type(message) for _, message in game.handled} <= set(messages.FOR_ALL)
