"""The settings of the documentation, for a site of one page at a known address."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.test_site import Page
from tools.common import ROOT

ADDRESS = "https://example.org/en/latest/"
TEXT = f"# Title\n\n![Page](images/web-1440.png)\n\n- Item\n\nA `name` and [a link](index.md). {'word ' * 40}\n"


@pytest.mark.daily  # the built site is tested always, without an address
def test_shared_page_has_first_sentence_and_absolute_addresses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("celshast")
    monkeypatch.setenv("READTHEDOCS_CANONICAL_URL", ADDRESS)
    for name in ("images", "_static", "_templates"):
        shutil.copytree(ROOT / "docs" / name, tmp_path / name)
    shutil.copy(ROOT / "docs" / "conf.py", tmp_path)
    (tmp_path / "index.md").write_text(TEXT, encoding="utf-8")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "-b", "html", tmp_path, tmp_path / "site"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    about = Page(tmp_path / "site" / "index.html").about
    assert about["og:title"] == "Title"
    assert about["description"] == about["og:description"] == "A name and a link."
    assert about["og:url"] == f"{ADDRESS}index.html"
    assert about["og:image"] == f"{ADDRESS}_images/web-1440.png"
