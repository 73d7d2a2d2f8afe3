"""One command writes the version wherever it is looked for."""

import pytest
import yaml

from pacman_env import __version__
from tools.common import ROOT
from tools.release import texts


def test_release_files_contain_current_version_and_date() -> None:
    date = yaml.safe_load((ROOT / "CITATION.cff").read_text())["date-released"]
    assert [path.name for path, text in texts(__version__, str(date)) if path.read_text() != text] == []


@pytest.mark.parametrize("version", ["X.Y.Z", "1.2", "v1.2.3", "1.2.3 ", ""])
def test_invalid_version_is_refused(version: str) -> None:
    with pytest.raises(ValueError, match="version"):
        list(texts(version, "2099-12-31"))


def test_new_version_and_date_reach_every_file() -> None:
    for path, text in texts("98.7.6", "2099-12-31"):
        assert ("98.7.6" in text, "2099-12-31" in text) == (True, path.suffix in (".cff", ".md"))
