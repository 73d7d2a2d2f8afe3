"""Who may look at the page and who may run it: tokens, and which Host and Origin a request may come with.

On this machine's own address no token is needed: whoever has an account here may play. There the danger is a page of
somebody else's in the same browser, which Host (a name that was made to lead here) and Origin give away.
"""

from __future__ import annotations

import hmac
import ipaddress
import secrets
import socket
from collections.abc import Awaitable, Callable, Iterable, MutableMapping
from dataclasses import dataclass
from typing import Any, Literal
from urllib.parse import parse_qsl, urlencode

from pacman_env.web.said import Said

Scope = MutableMapping[str, Any]
Event = MutableMapping[str, Any]
Receive = Callable[[], Awaitable[Event]]
Send = Callable[[Event], Awaitable[None]]
Application = Callable[[Scope, Receive, Send], Awaitable[None]]
Kind = Literal["operator", "viewer"]

OPEN = ("/health", "/static/")  # without a token
#: With every answer. Nothing from elsewhere, nothing inline, in nobody's frame.
HEADERS = {
    "content-security-policy": "; ".join(
        (
            *("default-src 'none'", "script-src 'self'", "style-src 'self'", "img-src 'self'", "media-src 'self'"),
            *("connect-src 'self'", "base-uri 'none'", "form-action 'none'", "frame-ancestors 'none'"),
        )
    ),
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "no-referrer",  # the address has the token
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), microphone=(), geolocation=()",
}
#: On this machine alone: elsewhere a browser heeds them over https only, and complains.
LOCAL_HEADERS = {"cross-origin-opener-policy": "same-origin", "cross-origin-embedder-policy": "require-corp"}


@dataclass(frozen=True)
class Tokens:
    """The secrets of those who run the game and of those who look.

    Raises:
        ValueError: one of them can be guessed, or both are the same.
    """

    operator: str
    viewer: str

    def __post_init__(self) -> None:
        if min(len(self.operator), len(self.viewer)) < 16 or self.operator == self.viewer:
            raise ValueError("tokens: two different ones of at least 16 characters")

    @classmethod
    def new(cls) -> Tokens:
        """Two that nobody knows yet."""
        return cls(secrets.token_urlsafe(24), secrets.token_urlsafe(24))


def is_loopback(address: str) -> bool:
    """Whether an address is reached from this machine alone."""
    try:
        return ipaddress.ip_address(address).is_loopback
    except ValueError:
        return False


def host_name(host: str) -> str | None:
    """The name in a Host header, without port and in small letters; None: it is none."""
    name, bracket, port = host.strip().lower().rpartition("]")
    if bracket:  # [::1]:8000
        name = name.removeprefix("[")
        port = port.removeprefix(":")
    else:
        name, _, port = host.strip().lower().partition(":")
    if not name or not (port == "" or (port.isascii() and port.isdigit())):
        return None
    return name.removesuffix(".")


class Access:
    """Which requests are let in.

    Args:
        tokens: None: nobody needs one.
        names: that the page may be asked for by, beside the address that a connection came to.
    """

    def __init__(self, tokens: Tokens | None, names: Iterable[str] = ()):
        self.tokens = tokens
        self.names = frozenset(name.lower().removesuffix(".") for name in names)

    def who(self, token: str | None) -> Kind | None:
        """What a token is for; None: nothing."""
        if self.tokens is None:
            return "operator"
        given = (token or "").encode()
        operator = hmac.compare_digest(given, self.tokens.operator.encode())
        viewer = hmac.compare_digest(given, self.tokens.viewer.encode())  # always both: the time tells nothing
        return "operator" if operator else "viewer" if viewer else None

    def is_ours(self, host: str, address: str) -> bool:
        """Whether a Host header names this server.

        Args:
            host: the header.
            address: of this machine, that the connection came to.
        """
        name = host_name(host)
        address = address.lower().removeprefix("::ffff:")  # an older address on a socket of the newer kind
        return name is not None and (name == address or name in self.names)


def names_of(host: str, address: str) -> tuple[str, ...]:
    """What a server bound to ``host``, which is ``address``, may be asked for by."""
    if is_loopback(address):
        return (host, address, "localhost")
    here = socket.gethostname()
    return (host, address, here, f"{here.partition('.')[0]}.local")


def is_same_origin(origin: str, host: str) -> bool:
    """Whether a page of ``origin`` was served under the Host of its request."""
    return origin.lower() in {f"http://{host.strip().lower()}", f"https://{host.strip().lower()}"}


class Guard:
    """Stands before the application: what may not come in gets a short answer, and the log one line a minute.

    What passes has its ``access`` in the scope, and no token any more.
    """

    def __init__(self, application: Application, access: Access, said: Said):
        self._application = application
        self._access = access
        self._said = said
        headers = HEADERS | (LOCAL_HEADERS if access.tokens is None else {})
        self._headers = [(name.encode(), value.encode()) for name, value in headers.items()]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """One request or websocket."""
        if scope["type"] == "lifespan":
            await self._application(scope, receive, send)
            return

        async def send_safely(event: Event) -> None:
            if event["type"].endswith("http.response.start"):
                event = {**event, "headers": [*event.get("headers", ()), *self._headers]}
            await send(event)

        refusal = self._refusal(scope)
        if refusal is None:
            await self._application(scope, receive, send_safely)
            return
        status, words = refusal
        self._said(words, f"refused: {words}")
        await refuse(scope, send_safely, status, words)

    def _refusal(self, scope: Scope) -> tuple[int, str] | None:
        """Status and words; None: it may pass."""
        headers = scope["headers"]
        hosts = [value.decode("latin-1") for name, value in headers if name == b"host"]
        origins = [value.decode("latin-1") for name, value in headers if name == b"origin"]
        if len(hosts) != 1 or not self._access.is_ours(hosts[0], (scope.get("server") or ("", 0))[0]):
            return 421, "a Host that is not this server's (a name of your own: --name)"
        if len(origins) > 1 or (origins and not is_same_origin(origins[0], hosts[0])):
            return 403, "a page of another origin"
        try:
            query = parse_qsl(scope["query_string"].decode("ascii"), keep_blank_values=True, max_num_fields=20)
        except ValueError:
            return 400, "an address that cannot be read"
        token = next((value for name, value in query if name == "token"), None)
        for name, value in headers:
            if name == b"authorization" and value[:7].lower() == b"bearer ":
                token = value[7:].decode("latin-1").strip()
        scope["query_string"] = urlencode([pair for pair in query if pair[0] != "token"]).encode()
        scope["headers"] = [pair for pair in headers if pair[0] != b"authorization"]
        access = self._access.who(token)
        if access is None and not scope["path"].startswith(OPEN):
            return 401, "no token, or a wrong one (use the link that was printed at the start)"
        scope["access"] = access
        return None


async def refuse(scope: Scope, send: Send, status: int, words: str) -> None:
    """A short answer instead of what was asked for."""
    kind = "websocket.http.response" if scope["type"] == "websocket" else "http.response"
    if scope["type"] == "websocket" and kind not in scope.get("extensions", {}):
        await send({"type": "websocket.close"})
        return
    body = f"{words}\n".encode()
    headers = [(b"content-type", b"text/plain; charset=utf-8"), (b"content-length", str(len(body)).encode())]
    await send({"type": f"{kind}.start", "status": status, "headers": [*headers, (b"connection", b"close")]})
    await send({"type": f"{kind}.body", "body": body})
