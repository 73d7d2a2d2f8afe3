"""The example of a search for hyperparameters."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("optuna")
pytest.importorskip("sb3_contrib")

from pacman_env.training.arguments import load_hyperparameters
from tests.training.test_arguments import section

ROOT = Path(__file__).resolve().parents[2]


def test_study_writes_hyperparameters_that_training_reads(tmp_path: Path) -> None:
    file, out = section(tmp_path), tmp_path / "study"
    script = [sys.executable, str(ROOT / "docs" / "examples" / "tune.py"), "--config", str(file), "--out", str(out)]
    short = ["--trials", "1", "--decisions", "64", "--evaluation", "1"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run([*script, *short], capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr
    before, best = (load_hyperparameters(path, "headline") for path in (file, out / "best.yaml"))
    assert best.learning_rate[0] / best.learning_rate[1] == pytest.approx(
        before.learning_rate[0] / before.learning_rate[1]
    )
    assert best.gamma != before.gamma
    assert (best.games, best.ghosts, best.levels) == (before.games, before.ghosts, before.levels)
