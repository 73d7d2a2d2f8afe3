"""The page of the commands is what they print."""

from __future__ import annotations

import subprocess
import sys

import pytest

from pacman_env.cli.main import MODULES
from tools.commands import PAGE, helps, purposes
from tools.common import ROOT


@pytest.mark.skipif(sys.version_info[:2] != (3, 11), reason="argparse of another Python wraps lines elsewhere")
def test_the_committed_page_is_what_the_commands_print_now() -> None:
    """In a process of its own: another test may have registered policies, which helps name."""
    pytest.importorskip("torch")
    pytest.importorskip("optuna")
    done = subprocess.run([sys.executable, "-m", "tools.commands", "--check"], cwd=ROOT, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_every_command_has_a_section_and_a_purpose() -> None:
    text = PAGE.read_text()
    for name, purpose in purposes().items():
        assert purpose
        assert name in ("pacman-env map", "pacman-env ros") or f"\n## `{name}`\n" in text
    assert {f"pacman-env {name}" for name in MODULES} <= set(purposes())


def test_helps_are_those_of_the_commands(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("tools.commands.MODULES", {"houses": MODULES["houses"]})
    found = helps()
    assert found["pacman-env houses"].startswith("usage: pacman-env houses ")
    assert found["pacman-env map generate"].startswith("usage: pacman-env map generate ")
