"""What is printed at the start leads to the page, by eye and by telephone."""

from __future__ import annotations

import socket

import pytest

from pacman_env.web.access import Tokens
from pacman_env.web.server import greeting, link, own_address, qr_code, shown_address

TOKENS = Tokens("operator-0123456789abcdef", "viewer-0123456789abcdef")


def test_on_this_computer_alone_it_is_one_line_without_a_token() -> None:
    words = greeting("127.0.0.1", 8000, None)
    assert "http://127.0.0.1:8000/ " in words
    assert "\n" not in words


def test_elsewhere_both_links_and_a_qr_code_are_printed() -> None:
    words = greeting("192.0.2.7", 8000, TOKENS)
    operator = link("192.0.2.7", 8000, TOKENS.operator)
    assert operator in words
    assert link("192.0.2.7", 8000, TOKENS.viewer) in words
    assert qr_code(operator) in words
    assert len(qr_code(operator).splitlines()) > 10


def test_a_qr_code_is_left_out_where_it_cannot_be_made(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "segno", None)
    assert qr_code("http://192.0.2.7:8000/") == ""
    assert TOKENS.operator in greeting("192.0.2.7", 8000, TOKENS)


def test_links_have_brackets_where_addresses_have_colons() -> None:
    assert link("::1", 8000) == "http://[::1]:8000/"
    assert link("2001:db8::1", 80, "t") == "http://[2001:db8::1]:80/?token=t"


def test_all_addresses_are_shown_as_one_that_others_can_use() -> None:
    assert shown_address("127.0.0.1") == "127.0.0.1"
    assert shown_address("0.0.0.0") in {own_address(), socket.gethostname()}
    assert "0.0.0.0" not in greeting("0.0.0.0", 8000, TOKENS)
