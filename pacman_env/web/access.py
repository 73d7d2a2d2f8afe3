"""Accept or refuse requests by their token, Host and Origin.

On a loopback address no token is needed: anyone with an account on this machine may play. The danger there is a page of
another site in the same browser. Host (if a foreign name was made to resolve to this machine) and Origin reveal it.
"""

from __future__ import annotations

import hmac
import ipaddress
import re
import secrets
import socket
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal
from urllib.parse import urlencode

from starlette.datastructures import Headers, MutableHeaders, QueryParams
from starlette.responses import PlainTextResponse
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from pacman_env.web.log import Log

Kind = Literal["operator", "viewer"]

OPEN = ("/health", "/static/")  # accessible without a token
#: Headers of every response: the page loads nothing from other sites, has no inline code, and is not shown in a frame.
HEADERS = {
    "content-security-policy": "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; "
    "media-src 'self'; connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",  # the address contains the token
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), microphone=(), geolocation=()",
}
#: Headers for loopback addresses: elsewhere a browser obeys them only over https, and otherwise logs errors.
LOCAL_HEADERS = {"cross-origin-opener-policy": "same-origin", "cross-origin-embedder-policy": "require-corp"}

_HOST = r"(?P<host>[a-z0-9._-]+|\[?[0-9a-f:]+\]?)(?P<port>:\d{1,5})?"
_NAME = re.compile(rf"((?P<scheme>https?)://)?{_HOST}(?P<path>(/[\w.~-]+)*/?)", re.ASCII | re.IGNORECASE)
_DEFAULT_PORTS = {"http": ":80", "https": ":443"}  # browsers leave these out of the Origin header


@dataclass(frozen=True)
class Name:
    """Host name of the page; for a proxy also the origin and path at which the proxy shows the page."""

    host: str
    origin: str = ""
    path: str = ""

    @classmethod
    def parse(cls, text: str) -> Name:
        """Read a host name, or the whole address of a page behind a proxy; ValueError if it is neither."""
        match = _NAME.fullmatch(text)
        if match is None or (not match["scheme"] and (match["port"] or match["path"])):
            raise ValueError(f"`name` = {text!r}: a host name, or an address such as https://robot.example/pacman/")
        scheme, host, port = ((match[part] or "").lower() for part in ("scheme", "host", "port"))
        name = host.strip("[]").removesuffix(".")
        if not scheme:
            return cls(name)
        return cls(name, f"{scheme}://{host}{port.removesuffix(_DEFAULT_PORTS[scheme])}", match["path"].rstrip("/"))


@dataclass(frozen=True)
class Tokens:
    operator: str
    viewer: str

    def __post_init__(self) -> None:
        if min(len(self.operator), len(self.viewer)) < 16 or self.operator == self.viewer:
            raise ValueError("tokens: two different ones of at least 16 characters")

    @classmethod
    def new(cls) -> Tokens:
        return cls(secrets.token_urlsafe(24), secrets.token_urlsafe(24))

    def access(self, token: str) -> Kind | None:
        given = token.encode()
        operator = hmac.compare_digest(given, self.operator.encode())
        viewer = hmac.compare_digest(given, self.viewer.encode())  # always compare both: the time reveals nothing
        return "operator" if operator else "viewer" if viewer else None


def is_local(host: str) -> bool:
    try:
        return host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


def names_of(host: str, address: str) -> tuple[str, ...]:
    """Return the Host headers to accept: ``host``, its IP address, and this machine's names."""
    if is_local(address):
        return (host, address, "localhost")
    here = socket.gethostname()
    return (host, address, here, f"{here.partition('.')[0]}.local")


class AccessControl:
    """Middleware that refuses requests. In accepted requests, ``access`` replaces the token in the scope."""

    def __init__(self, application: ASGIApp, tokens: Tokens | None, names: Sequence[Name], log: Log):
        self._application, self._tokens, self._log = application, tokens, log
        self._names = {name.host for name in names}  # accepted in addition to the server's own address
        self._origins = {name.origin for name in names if name.origin}
        self._proxied = {host for name in names if name.origin for host in (name.host, name.origin.split("/")[2])}
        self._paths = [f"{name.path}/" for name in names if name.path]
        self._headers = HEADERS | (LOCAL_HEADERS if tokens is None else {})

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def send_with_headers(message: Message) -> None:
            if message["type"].endswith("http.response.start"):
                headers = MutableHeaders(scope=message)
                headers.update(self._headers)
                headers.setdefault("cache-control", "no-cache")  # cached, and revalidated each time
            await send(message)

        for path in self._paths:
            if scope["path"].startswith(path):  # the proxy has not removed it
                scope["path"] = scope["path"][len(path) - 1 :]
                break
        refusal = self._refusal(scope)
        answer = refusal_response(*refusal, self._log) if refusal else self._application
        await answer(scope, receive, send_with_headers)

    def _refusal(self, scope: Scope) -> tuple[int, str] | None:
        headers = Headers(scope=scope)
        hosts, origins = headers.getlist("host"), headers.getlist("origin")
        host = hosts[0].strip().lower() if len(hosts) == 1 else ""
        match = re.fullmatch(_HOST, host, re.ASCII)
        name = match["host"].strip("[]").removesuffix(".") if match else None
        address = (scope.get("server") or ("", 0))[0].lower().removeprefix("::ffff:")  # IPv4 on an IPv6 socket
        if name not in (address, *self._names):
            return 421, "an unknown Host (add a name with --name)"
        if len(origins) > 1 or (origins and not self._is_own(origins[0].lower(), host)):
            return 403, "a page of another origin (behind a proxy: --name with the page's whole address)"
        query = QueryParams(scope["query_string"])
        scheme, _, credentials = headers.get("authorization", "").partition(" ")
        token = credentials.strip() if scheme.lower() == "bearer" else query.get("token", "")
        scope["query_string"] = urlencode([pair for pair in query.multi_items() if pair[0] != "token"]).encode()
        scope["headers"] = [pair for pair in scope["headers"] if pair[0] != b"authorization"]
        access = "operator" if self._tokens is None else self._tokens.access(token)
        if access is None and not scope["path"].startswith(OPEN):
            return 401, "no token, or a wrong one (use the link that was printed at the start)"
        scope["access"] = access
        return None

    def _is_own(self, origin: str, host: str) -> bool:
        # A proxy may pass on the Host without the port: then every other server of that machine has the same Host.
        is_same = host not in self._proxied and origin in (f"http://{host}", f"https://{host}")
        return is_same or origin in self._origins


def refusal_response(status: int, words: str, log: Log) -> PlainTextResponse:
    log.add(words, f"refused: {words}")
    return PlainTextResponse(f"{words}\n", status, {"connection": "close"})
