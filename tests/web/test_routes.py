"""What is answered over HTTP: files, maps, recorded rounds, uploads."""

import socket
from collections.abc import Callable

import httpx
import pytest

from pacman_env import __version__
from pacman_env.web import routes
from pacman_env.web.access import Tokens
from pacman_env.web.routes import MOST_UPLOAD, map_name
from pacman_env.web.server import WebServer
from tests.web.pages import FILES, Page, at, upload, viewer_url
from tests.web.scripted_game import PICTURE, ScriptedGame


def test_page_files_are_served_and_revalidated(server: WebServer, web: httpx.Client) -> None:
    url = server.url
    page = web.get(url)
    assert (page.content, page.headers["content-type"]) == (FILES["index.html"], "text/html; charset=utf-8")
    for name, kind in {"page.js": "text/javascript", "page.css": "text/css", "light.svg": "image/svg+xml"}.items():
        file = web.get(f"{url}static/{name}")
        assert file.content == FILES[name]
        assert file.headers["content-type"].split(";")[0] == kind
        assert file.headers["cache-control"] == "no-cache"
        again = web.get(f"{url}static/{name}", headers={"if-none-match": file.headers["etag"]})
        assert (again.status_code, again.content) == (304, b"")
    assert web.get(f"{url}health").json() == {"ok": True, "version": __version__}


def test_large_answers_are_compressed_if_client_allows(serve: Callable[..., WebServer], web: httpx.Client) -> None:
    game = ScriptedGame()
    server = serve(game)
    game.stories[1] = b"[0,1]" * 50_000
    (routes.STATIC / "large.js").write_bytes(b"let a;" * 1000)
    for path, content in {"story/1.json": game.stories[1], "static/large.js": b"let a;" * 1000}.items():
        for encoding in ("gzip", "identity"):
            with web.stream("GET", server.url + path, headers={"accept-encoding": encoding}) as answer:
                assert answer.read() == content
                assert (answer.num_bytes_downloaded < len(content) / 10) == (encoding == "gzip")
                assert answer.headers["vary"] == "Accept-Encoding" or encoding == "identity"


@pytest.mark.parametrize("path", ["", "no.js", "../secret.js", "%2e%2e/secret.js", "..%2fsecret.js", "a%00.js", "."])
def test_unknown_files_are_not_found(server: WebServer, path: str) -> None:
    with socket.create_connection(("127.0.0.1", server.port)) as wire:  # as it stands: a client would tidy it up
        head = f"GET /static/{path} HTTP/1.1\r\nhost: localhost:{server.port}\r\nconnection: close\r\n\r\n"
        wire.sendall(head.encode())
        answer = b"".join(iter(lambda: wire.recv(4096), b""))
    assert answer.startswith(b"HTTP/1.1 404")
    assert b"content-security-policy" in answer
    assert b"secret" not in answer


def test_maps_and_rounds_need_the_token(serve: Callable[..., WebServer], web: httpx.Client) -> None:
    game = ScriptedGame()
    game.stories[3] = bytes(range(256)) * 1000
    server = serve(game, tokens=Tokens.new())
    assert server.tokens is not None
    with Page(server) as page:
        scene = page.wait("scene")
        where = scene["map"]["url"]
        assert web.get(at(viewer_url(server), where)).content == PICTURE
        headers = {"authorization": f"Bearer {server.tokens.viewer}"}
        base = server.url.partition("?")[0]
        assert web.get(f"{base}story/3.json", headers=headers).content == game.stories[3]
        assert web.get(f"{base}story/3.json").status_code == 401
        for path in ("story/4.json", "map/9.png", f"story/{10**30}.json", "nothing"):
            assert web.get(base + path, headers=headers).status_code == 404


def test_uploaded_map_reaches_the_game(game: ScriptedGame, server: WebServer, web: httpx.Client) -> None:
    assert upload(web, server.url).json() == {"ok": True, "words": "12 pellets", "map": "my-house"}
    assert game.maps == {"my-house": ("image: a.pgm", b"P5 picture")}
    refused = upload(web, server.url, yaml="refuse")
    assert (refused.status_code, refused.json()) == (200, {"ok": False, "words": "nowhere to drive", "map": None})


NO_MAPS = (b"", b"{", b"[]", b'{"name":"a"}', b'{"name":1,"yaml":"","image":""}', b"\xff", b"[" * 9000, b"null")


def test_upload_is_refused_if_malformed(
    game: ScriptedGame, server: WebServer, web: httpx.Client, lines: list[str]
) -> None:
    for body in NO_MAPS:
        answer = web.post(f"{server.url}map", content=body)
        assert (answer.status_code, answer.json()["ok"]) == (400, False)
    assert web.post(f"{server.url}map", content=b'{"name":"a","yaml":"b","image":"%%%"}').status_code == 400
    assert upload(web, server.url, extra=1).status_code == 400
    assert (game.calls, lines) == ([], [])


def test_upload_is_refused_if_large_or_not_allowed(serve: Callable[..., WebServer], web: httpx.Client) -> None:
    game = ScriptedGame()
    server = serve(game, tokens=Tokens.new())
    assert upload(web, server.url, image="A" * (MOST_UPLOAD + 4)).status_code == 413
    assert upload(web, viewer_url(server)).status_code == 403
    assert web.post(server.url.partition("?")[0] + "map", json={}).status_code == 401
    assert game.calls == []
    assert upload(web, server.url).status_code == 200


@pytest.mark.parametrize(
    ("name", "safe"),
    [("../../etc/passwd", "etc-passwd"), ("", "map"), ("Ünï", "n"), ("A b_c-9", "a-b_c-9"), ("x" * 99, "x" * 40)],
)
def test_map_name_has_safe_characters(name: str, safe: str) -> None:
    assert map_name(name) == safe
