"""What two versions play is compared bit by bit; the other version here is a copy with one changed number."""

import shutil
from pathlib import Path

import pytest

from benchmarks.bits import main
from tools.common import ROOT

FEW = ("--steps", "12", "--episodes", "1", "--policies", "nearest")


@pytest.mark.daily
def test_bits_differ_when_a_reward_changes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("pacman_env", "maps", "eval", "train"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__", "static"))
    assert main([str(tmp_path), *FEW]) == 0
    file = tmp_path / "pacman_env" / "config" / "sections.py"
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("-0.002", "-0.003"), encoding="utf-8")
    assert text != file.read_text(encoding="utf-8")
    assert main([str(tmp_path), *FEW]) == 1
    assert "PacManBot-v2 single" in capsys.readouterr().out.split("DIFFERENT")[0]
