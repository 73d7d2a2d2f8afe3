"""The tutorial of behaviour cloning: a network learns what a policy chose, and plays as that does."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("torch")
pytest.importorskip("jax")

from pacman_env.evaluation.dataset import main

ROOT = Path(__file__).resolve().parents[2]
NAME = "pacman-env/taught-v0"


def cloned(folder: Path, recorded: list[str], learnt: list[str]) -> tuple[list[float], dict[str, float]]:
    """The share of equal choices in the decisions held out after each epoch, and rounds completed, both in %."""
    assert main([NAME, *recorded, "--root", str(folder)]) == 0
    script = [sys.executable, "-W", "error", str(ROOT / "docs" / "examples" / "cloning.py"), str(folder / NAME)]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([*script, *learnt], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    same = [float(share) for share in re.findall(r"the same choice in (\S+) %", done.stdout)]
    rates = re.findall(r"^(.*): (\S+) \[.*\] % of \d+ rounds$", done.stdout, re.MULTILINE)
    return same, {name: float(rate) for name, rate in rates}


@pytest.mark.daily
def test_clone_of_nearest_policy_agrees_with_it(tmp_path: Path) -> None:
    recorded = ["--policy", "nearest", "--map", "house", "--episodes", "60"]
    weights = tmp_path / "clone.pt"
    learnt = ["--epochs", "8", "--test", "house", "--rounds", "10", "--save", str(weights)]
    same, rates = cloned(tmp_path, recorded, learnt)
    assert len(same) == 8
    assert same[-1] > 80
    assert rates.keys() == {"nearest", "its clone"}
    assert weights.stat().st_size > 10_000


@pytest.mark.daily
def test_lookahead_clone_completes_nearly_as_many_unseen_houses(tmp_path: Path) -> None:
    levels = ["--map", "generated", "--set", "num_levels=150"]
    more = ["--set", "observation.nearest_pellets=12", "--set", "observation.nearest_refuges=3"]
    _, rates = cloned(tmp_path, [*levels, *more, "--episodes", "1500"], ["--rounds", "500"])
    assert rates["its clone"] > rates["lookahead"] - 8
