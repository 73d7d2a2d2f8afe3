"""The base package decides alike under the Python and numpy of a robot's system (scripts/other_python)."""

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest

from tests.decisions import POLICIES, decisions

ROOT = Path(__file__).resolve().parents[1]
NO_PYTHON = 3  # the script's exit status


@pytest.mark.daily
@pytest.mark.timeout(900)  # an installation, and kernels from scratch
def test_policies_choose_alike_under_older_python_and_numpy() -> None:
    command = [ROOT / "scripts" / "other_python", "-W", "error", ROOT / "tests" / "decisions.py"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
    if done.returncode == NO_PYTHON and not os.environ.get("CI"):
        pytest.skip(done.stderr.strip())
    assert done.returncode == 0, done.stderr
    theirs = json.loads(done.stdout)
    assert theirs["python"].startswith("3.12.")
    assert theirs["numpy"].startswith("1.26.")
    assert Path(theirs["package"]).is_relative_to(ROOT / ".venv-numpy1")
    for policy in POLICIES:
        ours = decisions(policy)
        assert theirs[policy]["choices"] == ours["choices"], policy
        np.testing.assert_allclose(theirs[policy]["scores"], ours["scores"], rtol=1e-5, atol=1e-6, err_msg=policy)
        assert len(set(ours["choices"])) > 1, f"{policy} tells situations apart"
