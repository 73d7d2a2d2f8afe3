"""The page behind a real nginx, with the configuration that the documentation shows."""

import json
import re
import shutil
import subprocess
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import httpx
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import unix_connect
from websockets.typing import Origin

from pacman_env.web.routes import MOST_UPLOAD
from pacman_env.web.server import WebServer
from tests.waiting import wait_for
from tests.web.scripted_game import ScriptedGame

NGINX = shutil.which("nginx") or shutil.which("nginx", path="/usr/sbin")
DOCUMENTED = Path(__file__).parents[2] / "docs" / "web.md"
ORIGIN = "https://robot.example:8443"
PAGE = f"{ORIGIN}/pacman/"
KEPT, REMOVED = "", "/"  # the path, by what is behind the address of proxy_pass
pytestmark = pytest.mark.skipif(NGINX is None, reason="missing: nginx (apt-get install nginx-light)")


@pytest.fixture(params=[(path, host) for path in (KEPT, REMOVED) for host in ("", "$host", "$http_host")])
def proxied(request: pytest.FixtureRequest) -> Iterator[tuple[WebServer, str]]:
    """A server, and the socket of an nginx before it."""
    path, host = request.param
    location = re.search(r"```nginx\n(.*?)```", DOCUMENTED.read_text(), re.DOTALL)
    assert location
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))  # short: a socket's name is bounded
        folder.chmod(0o755)
        server = stack.enter_context(WebServer(ScriptedGame(), names=[PAGE], write=lambda _: None))
        lines = location[1].replace("127.0.0.1:8000", f"127.0.0.1:{server.port}{path}")
        lines = lines.replace("}", f"proxy_set_header Host {host}; }}") if host else lines
        folders = "".join(
            f"{name}_temp_path {folder}/{name};" for name in ("client_body", "proxy", "fastcgi", "uwsgi", "scgi")
        )
        (folder / "nginx.conf").write_text(
            f"daemon off; pid {folder}/pid; error_log {folder}/errors; events {{}}\n"
            f"http {{ {folders} server {{ listen unix:{folder}/socket;\n{lines} }} }}"
        )
        command = [str(NGINX), "-p", str(folder), "-c", f"{folder}/nginx.conf", "-e", f"{folder}/errors"]
        nginx = stack.enter_context(subprocess.Popen(command))
        stack.callback(nginx.terminate)
        wait_for((folder / "socket").exists)
        yield server, f"{folder}/socket"


def test_page_works_behind_nginx(proxied: tuple[WebServer, str]) -> None:
    server, socket = proxied
    assert server.tokens is not None
    query = {"token": server.tokens.operator}
    with httpx.Client(transport=httpx.HTTPTransport(uds=socket), base_url=PAGE.replace("https", "http")) as web:
        page = web.get("", params=query)
        assert page.status_code == 200
        for name in re.findall(r'(?:src|href)="(static/[^"]+)"', page.text):
            assert web.get(name).status_code == 200, name
        answer = web.post("map", params=query, content=b"x" * (MOST_UPLOAD - 100), headers={"origin": ORIGIN})
        assert answer.json()["words"].startswith("no map"), "nginx has passed it on"
        assert web.get("").status_code == 401
    address = f"{PAGE.replace('https', 'ws')}ws?token={server.tokens.operator}"
    with unix_connect(socket, address, origin=Origin(ORIGIN)) as socket_page:
        assert json.loads(socket_page.recv())["kind"] == "hello"
    for origin in ("https://robot.example", "http://robot.example:8443", "https://evil.example:8443", "null"):
        with pytest.raises(InvalidStatus, match="403"):
            unix_connect(socket, address, origin=Origin(origin))
