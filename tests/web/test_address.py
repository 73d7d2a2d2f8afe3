"""What is printed at the start leads to the page, by eye and by telephone."""

import pytest

from pacman_env.web.access import Tokens
from pacman_env.web.address import link, qr_code, start_text, with_token
from pacman_env.web.server import WebServer
from tests.web.scripted_game import ScriptedGame

TOKENS = Tokens("operator-0123456789abcdef", "viewer-0123456789abcdef")


def test_start_text_has_links_and_qr_code(monkeypatch: pytest.MonkeyPatch) -> None:
    assert "\n" not in start_text(link("127.0.0.1", 8000), None)
    url = link("192.0.2.7", 8000)
    operator = with_token(url, TOKENS.operator)
    for part in (operator, with_token(url, TOKENS.viewer), qr_code(operator)):
        assert part in start_text(url, TOKENS)
    assert len(qr_code(operator).splitlines()) > 10
    monkeypatch.setitem(__import__("sys").modules, "segno", None)
    assert qr_code(operator) == ""
    assert operator in start_text(url, TOKENS)


@pytest.mark.parametrize(
    ("names", "url", "needs_token"),
    [
        ([], None, False),
        (["http://localhost:8080/pacman/"], "http://localhost:8080/pacman/", False),
        (["a.example", "https://b.example/pacman"], "https://b.example/pacman/", True),
        (["a.example"], None, True),
    ],
)
def test_page_needs_tokens_if_others_reach_it(names: list[str], url: str | None, needs_token: bool) -> None:
    with WebServer(ScriptedGame(), names=names, write=lambda _: None) as server:
        assert (server.tokens is not None) == needs_token
        words = start_text(server.public_url, server.tokens)
        assert (url or f"http://127.0.0.1:{server.port}/") + ("?token=" if needs_token else " ") in words
        assert ("not https" in words) == (needs_token and url is None)


def test_link_shows_address_reachable_by_others() -> None:
    assert link("::1", 8000) == "http://[::1]:8000/"
    assert with_token(link("2001:db8::1", 80), "t") == "http://[2001:db8::1]:80/?token=t"
    assert "0.0.0.0" not in link("0.0.0.0", 8000)
    assert link("::", 8000) != "http://[::]:8000/"
