"""The browser's game as the build makes it, with a few maps, and a server that only serves its files."""

import fcntl
import functools
import http.server
import importlib.util
import os
import shutil
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.browser_game.firefox import FIREFOX, Firefox
from tests.browser_game.proof import build_page, rounds, with_orders
from tests.web.browser import chromium, missing  # noqa: F401 - a fixture

#: Short rounds of the proof on ``house``, and the same ones with orders of people.
_SHORT = [one for one in rounds(100) if one["seed"] in (75, 78)]
ROUNDS = [*_SHORT, *(with_orders(one, 5000) for one in _SHORT)]


@pytest.fixture(scope="session")
def browser_game(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the page, which is built once for all processes of pytest."""
    if not shutil.which("node"):
        missing("Node (apt-get install nodejs)")
    if not importlib.util.find_spec("ziglang"):
        missing("ziglang (pip install ziglang)")
    shared = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        shared = shared.parent
    folder = shared / "browser_game"
    with (shared / "browser_game.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not (folder / "libm.so").exists():  # the last file
            build_page(ROUNDS, folder)
    return folder


class _Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


@pytest.fixture(scope="session")
def game_url(browser_game: Path) -> Iterator[str]:
    """Serve the page to this machine."""
    handler = functools.partial(_Quiet, directory=str(browser_game))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"http://127.0.0.1:{server.server_port}/"
        server.shutdown()
        thread.join()


@pytest.fixture(scope="module")
def firefox() -> Iterator[Firefox]:
    program = next(filter(None, map(shutil.which, FIREFOX)), None)
    if program is None:
        missing("Firefox (apt-get install firefox-esr)")
    else:
        with Firefox(program) as browser:
            yield browser
