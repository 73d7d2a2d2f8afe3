"""What a process keeps of its start: seen from a process of its own, for it cannot be taken back."""

from __future__ import annotations

import subprocess
import sys

import pytest

PROGRAM = """
import gc, re
from pathlib import Path
import numba
from pacman_env.ros.node import settle

def resident_mb():
    return int(re.search(r"VmRSS:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]) / 1024

@numba.njit
def double(x):
    return 2 * x

@numba.njit
def triple(x):
    return 3 * x

assert double(21) == 42
before, mappings = resident_mb(), settle()
print(mappings, before - resident_mb(), gc.get_freeze_count())
assert double(21) == 42 and triple(14) == 42  # what was compiled runs on, and more can be compiled
"""


@pytest.mark.skipif(sys.platform != "linux", reason="looks at /proc, and gives pages back on Linux alone")
def test_settled_process_is_smaller_and_continues() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    mappings, smaller_by_mb, frozen = done.stdout.split()
    assert int(mappings) > 20
    assert float(smaller_by_mb) > 30.0
    assert int(frozen) > 10_000
