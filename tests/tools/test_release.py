"""One command writes the version wherever it is looked for."""

import yaml

from pacman_env import __version__
from tools.common import ROOT
from tools.release import texts


def test_release_files_contain_current_version_and_date() -> None:
    date = yaml.safe_load((ROOT / "CITATION.cff").read_text())["date-released"]
    assert [path.name for path, text in texts(__version__, str(date)) if path.read_text() != text] == []


def test_new_version_and_date_reach_every_file() -> None:
    for path, text in texts("98.7.6", "2099-12-31"):
        assert ("98.7.6" in text, "2099-12-31" in text) == (True, path.suffix in (".cff", ".md"))
