"""Which requests are accepted: tokens, Host and Origin; and the headers of every answer."""

import asyncio
import logging
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.web.access import HEADERS, AccessControl, Name, Tokens, names_of
from pacman_env.web.log import Log

TOKENS = Tokens("operator-0123456789abcdef", "viewer-0123456789abcdef")
ADDRESS = "192.0.2.7"
OWN = f"{ADDRESS}:8000"
OPERATOR = f"token={TOKENS.operator}"
PROXY = "https://robot.example:8443/pacman/"


def ask(
    path: str = "/",
    query: str = "",
    kind: str = "http",
    names: tuple[str, ...] = (),
    tokens: Tokens | None = TOKENS,
    address: str = ADDRESS,
    **headers: str,
) -> tuple[int, dict[str, Any], list[str]]:
    """Return status, the scope as the application had it (empty: refused), and what the log had."""
    lines: list[str] = []
    passed: dict[str, Any] = {}
    sent: list[Any] = []

    async def application(scope: Any, receive: Any, send: Any) -> None:
        passed.update(scope)
        await send({"type": "http.response.start", "status": 200, "headers": []})
        await send({"type": "http.response.body", "body": b""})

    async def send(event: Any) -> None:
        sent.append(event)

    scope = {
        "type": kind,
        "path": path,
        "query_string": query.encode(),
        "server": (address, 8000),
        "extensions": {"websocket.http.response": {}},
        "headers": [(name.encode(), value.encode("latin-1")) for name, value in headers.items()],
    }
    log = Log(lines.append, (TOKENS.operator, TOKENS.viewer))
    control = AccessControl(application, tokens, (*map(Name, names_of(address, address)), *map(Name.parse, names)), log)
    asyncio.run(control(scope, None, send))  # type: ignore[arg-type]
    assert dict(sent[0]["headers"])[b"content-security-policy"] == HEADERS["content-security-policy"].encode()
    return sent[0]["status"], passed, lines


@pytest.mark.parametrize(
    "path", ["/", "/ws", "/map", "/map/1.png", "/story/1.json", "/nothing", "/staticx", "//static/"]
)
def test_path_needs_token_unless_file_or_health(path: str) -> None:
    assert ask(path, host=OWN)[:2] == (401, {})
    for free in ("/health", "/static/page.js"):
        status, passed, _ = ask(free, host=OWN)
        assert (status, passed["access"]) == (200, None)


@pytest.mark.parametrize(("token", "access"), [(TOKENS.operator, "operator"), (TOKENS.viewer, "viewer")])
@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_token_grants_access_and_is_removed_from_request(token: str, access: str, kind: str) -> None:
    for query, headers in ((f"a=1&token={token}", {}), ("a=1", {"authorization": f"Bearer {token}"})):
        status, passed, lines = ask("/ws", query, kind, host=OWN, **headers)
        assert (status, passed["access"], passed["query_string"]) == (200, access, b"a=1")
        assert token not in repr(passed)
        assert lines == []


@given(st.text(max_size=40) | st.sampled_from([TOKENS.operator[:-1], TOKENS.operator + "x", TOKENS.operator.upper()]))
def test_wrong_token_gives_no_access(token: str) -> None:
    assert TOKENS.access(token) is None


def test_tokens_are_long_and_unique() -> None:
    drawn = [Tokens.new() for _ in range(100)]
    assert len({token for both in drawn for token in (both.operator, both.viewer)}) == 200
    assert all(len(both.operator) >= 32 for both in drawn)
    for bad in (("", ""), ("short", "also-short"), ("x" * 20, "x" * 20)):
        with pytest.raises(ValueError, match="tokens"):
            Tokens(*bad)


def test_own_host_and_origin_are_accepted() -> None:
    for host in ("127.0.0.1:8000", "localhost:8000", "LOCALHOST", "localhost."):
        assert ask(host=host, tokens=None, address="127.0.0.1")[1]["access"] == "operator"
    assert ask(host="[::1]:8000", tokens=None, address="::1")[0] == 200
    assert ask(names=("robot.example",), query=OPERATOR, host="Robot.example:80")[0] == 200
    for scheme in ("http", "https"):  # https: something before the server does it
        assert ask("/ws", OPERATOR, "websocket", host=OWN, origin=f"{scheme}://{OWN}")[0] == 200


@pytest.mark.parametrize(
    "host",
    [
        *("evil.example", "evil.example:8000", f"{ADDRESS}.evil.example", "", "[", ":8000", "localhost:8000x", "a b"),
        *(f"http://{ADDRESS}", f"{ADDRESS}/x", f"evil@{ADDRESS}"),
    ],
)
def test_foreign_host_is_refused_with_a_token(host: str) -> None:
    assert ask(query=OPERATOR, host=host)[:2] == (421, {})
    assert ask(query=OPERATOR)[0] == 421, "no Host at all"


@pytest.mark.parametrize("kind", ["http", "websocket"])
@pytest.mark.parametrize(
    "origin",
    ["http://evil.example", "null", f"http://{ADDRESS}:8001", f"http://{ADDRESS}", f"ftp://{ADDRESS}:8000", ""],
)
def test_foreign_origin_is_refused_with_a_token(kind: str, origin: str) -> None:
    assert ask("/ws", OPERATOR, kind, host=OWN, origin=origin)[:2] == (403, {})


@pytest.mark.parametrize("host", ["robot.example", "robot.example:8443", OWN])  # $host, $http_host, none
@pytest.mark.parametrize("path", ["/ws", "/pacman/ws"])
@pytest.mark.parametrize(
    ("origin", "status"),
    [
        ("https://robot.example:8443", 200),
        ("http://evil.example:8443", 403),
        ("https://robot.example:8444", 403),
        ("https://robot.example.evil.example:8443", 403),
        ("https://robot.example", 403),
        ("https://evil.example", 403),
        ("null", 403),
    ],
)
def test_proxy_accepts_only_its_own_pages(host: str, path: str, origin: str, status: int) -> None:
    answer, passed, _ = ask(path, OPERATOR, "websocket", (PROXY,), host=host, origin=origin)
    assert (answer, passed.get("path")) == (status, "/ws" if status == 200 else None)


def test_proxy_refuses_foreign_host() -> None:
    assert ask("/pacman/", OPERATOR, names=(PROXY,), host="evil.example:8443")[0] == 421
    assert ask("/pacman/ws", names=(PROXY,), host="robot.example")[0] == 401
    assert ask("/pacman/static/page.js", names=(PROXY,), host="robot.example")[1]["path"] == "/static/page.js"
    assert ask("/pacmanx/static/page.js", names=(PROXY,), host="robot.example")[0] == 401


@pytest.mark.parametrize(
    ("text", "name"),
    [
        ("Robot.example.", Name("robot.example")),
        ("2001:db8::1", Name("2001:db8::1")),
        ("HTTPS://Robot.example:443/A/b/", Name("robot.example", "https://robot.example", "/A/b")),
        ("http://[::1]:8080", Name("::1", "http://[::1]:8080")),
    ],
)
def test_name_parses_host_or_whole_address(text: str, name: Name) -> None:
    assert Name.parse(text) == name


@pytest.mark.parametrize(
    "text", ["", "robot:8000", "a/b", "ftp://a/", "http://", "http://u@a/", "http://a/?b", "http://a/%2e/", "*", "a b"]
)
def test_name_is_refused_unless_host_or_address(text: str) -> None:
    with pytest.raises(ValueError, match="`name`"):
        Name.parse(text)


def test_log_removes_tokens_from_records(caplog: pytest.LogCaptureFixture) -> None:
    lines: list[str] = []
    log = Log(lines.append, (TOKENS.operator, TOKENS.viewer))
    log.add("a", f"GET /?token={TOKENS.operator}\nmore")
    log.error("b", ValueError(f"token={TOKENS.viewer}"))
    logger = logging.getLogger("pacman_env.test_tokens")
    logger.addFilter(log.redact)
    with caplog.at_level(logging.DEBUG):
        logger.debug("GET %s", f"/?token={TOKENS.operator}")
        try:
            raise ValueError(TOKENS.viewer)
        except ValueError:
            logger.exception("an error %d", 5)
    assert lines[0] == "GET /?token=... more"
    assert "an error 5" in caplog.text
    for text in (*lines, caplog.text):
        assert TOKENS.operator not in text
        assert TOKENS.viewer not in text


def test_log_writes_each_kind_once_per_minute() -> None:
    lines: list[str] = []
    now = 0.0
    log = Log(lines.append, clock=lambda: now)
    for k in range(1000):
        now = 0.1 * k
        log.add("refused", f"refused {k}")
    assert lines == ["refused 0", "refused 600 (and 599 more)"]


def test_content_security_policy_allows_only_own_files() -> None:
    policy = HEADERS["content-security-policy"]
    assert policy.startswith("default-src 'none'")
    assert {word for part in policy.split("; ") for word in part.split()[1:]} == {"'none'", "'self'"}
