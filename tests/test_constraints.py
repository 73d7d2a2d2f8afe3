"""The versions of ``constraints.txt``, which the commands of a checkout install."""

from __future__ import annotations

import sys
from importlib.metadata import distributions
from pathlib import Path

import pytest
from packaging.specifiers import SpecifierSet

ROOT = Path(__file__).resolve().parents[1]
OLDEST = "3.11.0"  # of pyproject.toml; Debian 12 has 3.11.2


@pytest.mark.skipif(sys.version_info[:2] != (3, 11), reason="the versions of another Python are others")
def test_installed_versions_that_are_pinned_run_on_the_oldest_python() -> None:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pinned = {tuple(line.lower().replace("_", "-").split("==")) for line in lines if "==" in line}
    needs = {
        f"{one.metadata['Name']} {one.version}": one.metadata["Requires-Python"] or ""
        for one in distributions()
        if (one.metadata["Name"].lower().replace("_", "-"), one.version.lower()) in pinned
    }
    assert len(needs) > 20
    assert {name: need for name, need in needs.items() if OLDEST not in SpecifierSet(need)} == {}
