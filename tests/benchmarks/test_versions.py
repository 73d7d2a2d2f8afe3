"""Two versions are compared turn by turn; checkouts here are small ones that say at once how fast they are."""

import json
from pathlib import Path

import pytest

from benchmarks import versions
from benchmarks.versions import main

#: A program that takes the real one's arguments, and knows from the package that it imports what to print.
PROGRAM = """
import sys
from pathlib import Path
import pacman_env
here = Path(pacman_env.__file__).parent
with open(here / "calls", "a") as calls:
    print(*sys.argv[1:], file=calls)
print((here / "figures.json").read_text())
"""


def checkout(folder: Path, one: float, many: float, number: int) -> Path:
    (folder / "pacman_env").mkdir(parents=True)
    (folder / "pacman_env" / "__init__.py").touch()
    rows = {"N = 1": {"decisions_per_s": one}, "N = 64": {"decisions_per_s": many, "id": f"Env-v{number}"}}
    (folder / "pacman_env" / "figures.json").write_text(json.dumps({**rows, "other": {"skipped": "no library"}}))
    return folder


def test_versions_are_measured_in_turns_by_one_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    here, there = checkout(tmp_path / "here", 10, 100, 1), checkout(tmp_path / "there", 20, 50, 0)
    program = tmp_path / "speed.py"
    program.write_text(PROGRAM)
    monkeypatch.setattr(versions, "ROOT", here)
    monkeypatch.setattr(versions, "PROGRAM", program)
    out = tmp_path / "ratios.json"
    given = ["--map", "loop", "--rounds", "2", "--seconds", "0.5", "--only", "N", "--json", str(out)]
    assert main([str(there), *given]) == 0
    for folder in (here, there):
        calls = (folder / "pacman_env" / "calls").read_text().splitlines()
        assert calls == ["N loop 0.1", *["N loop 0.5"] * 2]  # the first one warms up
    printed = capsys.readouterr().out
    for line in ("| N = 1 | 10 | 20 | 0.50 |", "| N = 64 | 100 | 50 | 2.00 |", "Env-v1 here is Env-v0 there"):
        assert line in printed
    assert json.loads(out.read_text())["ratios"] == {"N = 1": [0.5, 0.5], "N = 64": [2.0, 2.0]}
    assert main(given) == 0  # this version alone
    assert "| N = 1 | 10 | - |" in capsys.readouterr().out
