"""One command writes the version wherever it is looked for."""

from pathlib import Path

import yaml

from pacman_env import __version__
from tools.release import texts

CITATION = Path(__file__).resolve().parents[2] / "CITATION.cff"


def test_release_files_contain_current_version_and_date() -> None:
    date = str(yaml.safe_load(CITATION.read_text())["date-released"])
    assert [path.name for path, text in texts(__version__, date) if path.read_text() != text] == []


def test_new_version_and_date_reach_every_file() -> None:
    for path, text in texts("98.7.6", "2099-12-31"):
        assert "98.7.6" in text
        assert ("2099-12-31" in text) == (path.suffix in (".cff", ".md"))
        assert "98.7.6" not in path.read_text()
