"""The page of the commands is what they print."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from pacman_env.cli.main import MODULES

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.skipif(sys.version_info[:2] != (3, 11), reason="argparse of another Python wraps lines elsewhere")
def test_committed_page_equals_current_command_help() -> None:
    """In a process of its own: another test may have registered policies, which helps name."""
    pytest.importorskip("torch")
    pytest.importorskip("optuna")
    done = subprocess.run([sys.executable, "-m", "tools.commands", "--check"], cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_commands_page_has_section_for_every_command() -> None:
    text = (ROOT / "docs" / "commands.md").read_text()
    for name in (*MODULES, "map generate", "ros up", "web"):
        assert f"\n## `pacman-env {name}`\n" in text
