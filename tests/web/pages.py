"""A page, as far as the server sees it: for the tests."""

from __future__ import annotations

import base64
import json
import socket
import time
from collections.abc import Callable
from contextlib import ExitStack
from typing import Any

import httpx
import msgspec
import numpy as np
from numpy.typing import NDArray
from websockets.sync.client import ClientConnection, connect

from pacman_env.web.frame import Frame
from pacman_env.web.server import WebServer
from tests.waiting import PATIENCE_S

FILES = {"index.html": b"<!doctype html>", "page.js": b"export {}", "page.css": b"a{}", "light.svg": b"<svg/>"}


def at(url: str, path: str = "") -> str:
    """The address of a path of the page, with its token; ``ws`` for the websocket's."""
    base, _, query = url.partition("?")
    base = base.replace("http:", "ws:", 1) if path.startswith("ws") else base
    return base + path + (("&" if "?" in path else "?") + query if query else "")


def viewer_url(server: WebServer) -> str:
    """The page for one that only looks."""
    assert server.tokens is not None
    return server.url.replace(server.tokens.operator, server.tokens.viewer)


def upload(web: httpx.Client, url: str, **changed: Any) -> httpx.Response:
    body = {"name": "My house!", "yaml": "image: a.pgm", "image": base64.b64encode(b"P5 picture").decode(), **changed}
    return web.post(at(url, "map"), json=body)


def upgrade(server: WebServer) -> socket.socket:
    """Open a websocket by hand, of a client that reads nothing."""
    there = socket.socket()
    there.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
    there.connect(("127.0.0.1", server.port))
    lines = ("GET /ws HTTP/1.1", f"host: 127.0.0.1:{server.port}", "upgrade: websocket", "connection: upgrade")
    key = ("sec-websocket-version: 13", f"sec-websocket-key: {'A' * 22}==")
    there.sendall("\r\n".join((*lines, *key, "", "")).encode())
    return there


def _to_array(kind: Any, values: Any) -> NDArray[Any]:
    """Of the dtype that the field declares."""
    return np.array(values, dtype=kind.__args__[1].__args__[0])


def decode(message: str | bytes) -> Frame:
    return msgspec.json.decode(message, type=Frame, dec_hook=_to_array)


def decode_all(message: bytes) -> list[Frame]:
    return msgspec.json.decode(message, type=list[Frame], dec_hook=_to_array)


class Page:
    """Connects, and keeps the texts that come; ``frames`` are when they came and what they were."""

    def __init__(self, server: WebServer | str, again: str = ""):
        url = server if isinstance(server, str) else server.url
        address = at(url, "ws" + (f"?again={again}" if again else ""))
        self._opened = ExitStack()
        self.socket: ClientConnection = self._opened.enter_context(
            connect(address, compression=None, max_size=None, max_queue=None)
        )
        self.texts: list[dict[str, Any]] = []
        self.frames: list[tuple[float, str]] = []
        self.patience_s = PATIENCE_S
        self._id = 0
        try:
            self.hello = self.wait("hello")
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> Page:
        return self

    def __exit__(self, *failure: object) -> None:
        self.close()

    def close(self) -> None:
        self._opened.close()

    @property
    def name(self) -> str:
        return str(self.hello["you"])

    def read(self, timeout_s: float | None = None) -> dict[str, Any] | None:
        """One more message; a text is returned."""
        message = self.socket.recv(timeout=self.patience_s if timeout_s is None else timeout_s)
        assert isinstance(message, str)
        text: dict[str, Any] = json.loads(message)
        if text["kind"] == "frame":
            self.frames.append((time.monotonic(), message))
            return None
        self.texts.append(text)
        return text

    def wait(self, kind: str, is_it: Callable[[dict[str, Any]], bool] = lambda text: True) -> dict[str, Any]:
        """The next text of a kind, that is yet to come."""
        end = time.monotonic() + self.patience_s
        while time.monotonic() < end:
            text = self.read()
            if text is not None and text["kind"] == kind and is_it(text):
                return text
        raise TimeoutError(f"no {kind} in {self.patience_s:g} s; {self.texts[-5:]}")

    def people(self, **wanted: Any) -> dict[str, Any]:
        """The last text of people if they are as wanted, else the next where they are."""

        def are_so(text: dict[str, Any]) -> bool:
            return all(text[name] == value for name, value in wanted.items())

        last = [text for text in self.texts if text["kind"] == "people"][-1:]
        return last[0] if last and are_so(last[0]) else self.wait("people", are_so)

    def send(self, do: str, **fields: Any) -> int:
        """Say something that is answered; returns its id."""
        self._id += 1
        self.socket.send(json.dumps({"do": do, "id": self._id, **fields}))
        return self._id

    def ask(self, do: str, **fields: Any) -> dict[str, Any]:
        number = self.send(do, **fields)
        return self.wait("answer", lambda text: text["id"] == number)

    def listen(self, seconds: float) -> None:
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            try:
                self.read(left)
            except TimeoutError:
                return
