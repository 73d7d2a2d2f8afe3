"""Every environment keeps the contract, under arguments of which any two meet."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest

from tests.envs.adapters import CASES
from tests.envs.cases import AXES, PAIRWISE
from tests.envs.contract import EnvContract

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def other_process() -> dict[str, str]:
    """Return the fingerprints of all cases as another process computes them."""
    code = "import json; from tests.envs.adapters import *; print(json.dumps({c: episodes(c) for c in CASES}))"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.parametrize("case", CASES)
class TestEnvironments(EnvContract):
    """Run the contract over all adapters."""


def test_cases_combine_every_pair_of_values() -> None:
    for one in AXES:
        for other in AXES:
            met = {(str(row[one]), str(row[other])) for row in PAIRWISE}
            assert len(met) == (len(AXES[one]) * len(AXES[other]) if one != other else len(AXES[one]))
