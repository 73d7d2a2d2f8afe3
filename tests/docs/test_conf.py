"""The settings of the documentation, for a site of one page at a known address."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.docs.test_site import Page
from tools.common import ROOT

ADDRESS = "https://example.org/en/latest/"
LONG = "word " * 40


@pytest.mark.parametrize(
    ("paragraph", "description"),
    [
        (f'A `name`, a [link](index.md) and "quotes". {LONG}.', "A name, a link and “quotes”."),
        (LONG, " ".join(["word"] * 32) + "…"),
    ],
)
def test_shared_page_has_first_words_and_absolute_addresses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, paragraph: str, description: str
) -> None:
    pytest.importorskip("celshast")
    monkeypatch.setenv("READTHEDOCS_CANONICAL_URL", ADDRESS)
    source = tmp_path / "docs"
    for name in ("images", "_static", "_templates"):
        shutil.copytree(ROOT / "docs" / name, source / name)
    shutil.copy(ROOT / "docs" / "conf.py", source)
    before = "# Title\n\n![The page](images/web-1440.png)\n\n> Note\n\n- Item\n\n"
    (source / "index.md").write_text(before + paragraph, encoding="utf-8")
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "-b", "html", source, tmp_path / "site"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    about = Page(tmp_path / "site" / "index.html").about
    assert about["og:title"] == "Title"
    assert about["description"] == about["og:description"] == description
    assert about["og:url"] == f"{ADDRESS}index.html"
    assert about["og:image"] == f"{ADDRESS}_images/web-1440.png"
