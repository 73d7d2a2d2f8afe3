"""The page of the commands is what they print."""

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.skipif(sys.version_info[:2] != (3, 11), reason="argparse of another Python wraps lines elsewhere")
def test_committed_page_equals_current_command_help() -> None:
    """In a process of its own: another test may have registered policies, which helps name."""
    pytest.importorskip("torch")
    done = subprocess.run([sys.executable, "-m", "tools.commands", "--check"], cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
