"""The site, built once."""

import importlib.util
import subprocess
import sys
from pathlib import Path

import pytest

from tests.web.browser import axe, chromium, missing
from tools.browser_game import page
from tools.common import ROOT

__all__ = ["axe", "chromium"]


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the pages; the build has no warning, which is an error."""
    for module in ("sphinx", "celshast", "myst_nb", "sphinx_copybutton"):
        if importlib.util.find_spec(module) is None:
            missing(f"{module} (pip install -e '.[docs]')")
    folder = tmp_path_factory.mktemp("docs")
    out, build = folder / "site", folder / "build"
    build.mkdir()
    sphinx = ["-m", "sphinx", "-q", "-E", "-W", "--keep-going", "-b", "html", "-d"]  # as scripts/docs
    for words in (["-m", "tools.site", build], [*sphinx, build / "doctrees", build / "docs", out]):
        done = subprocess.run([sys.executable, *words], cwd=ROOT, capture_output=True, text=True)
        assert (done.returncode, done.stderr) == (0, ""), done.stdout + done.stderr
    page.write(out / "play", ["house"])  # without the game
    return out
