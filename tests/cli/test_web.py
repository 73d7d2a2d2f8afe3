"""The command that serves the page: a real process."""

import json
import re
import signal
import socket
import subprocess
import sys
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from pacman_env import __version__
from pacman_env.cli.main import main, make_parser
from pacman_env.world.maps.occupancy import load_map
from tests.waiting import PATIENCE_S

pytest.importorskip("starlette")


@pytest.fixture
def server() -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "pacman_env.cli.main", "web", "--port", "0", "--speed", "50", "--seed", "1"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    yield process
    process.kill()
    process.communicate()


def test_web_prints_address_serves_page_and_stops_cleanly(server: subprocess.Popen[str]) -> None:
    assert server.stdout is not None
    said = server.stdout.readline()
    found = re.search(r"http://127\.0\.0\.1:\d+/", said)
    assert found, said
    assert "token" not in said  # on this machine alone none is needed
    with urllib.request.urlopen(f"{found[0]}health", timeout=PATIENCE_S) as answer:
        assert json.load(answer) == {"ok": True, "version": __version__}
    server.send_signal(signal.SIGINT)
    _, errors = server.communicate(timeout=PATIENCE_S)
    assert server.returncode == 0
    assert "Traceback" not in errors


def test_occupied_port_is_named(capsys: pytest.CaptureFixture[str]) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert main(["web", "--port", str(port)]) == 2
    assert f"port {port} of 127.0.0.1 is in use" in capsys.readouterr().err


def test_web_offers_map_file_of_user(tmp_path: Path) -> None:
    from pacman_env.cli.main import _simulated_game

    path = load_map("loop").save(tmp_path / "mine.yaml")
    game = _simulated_game(make_parser().parse_args(["web", "--map", str(path)]))
    try:
        assert "mine" in game.choices()["maps"]
    finally:
        game.close()
