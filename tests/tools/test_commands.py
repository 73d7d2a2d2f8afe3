"""The page of the commands is what they print."""

from __future__ import annotations

import sys

import pytest

from pacman_env.cli.main import MODULES
from tools.commands import PAGE, helps, main, purposes


@pytest.mark.skipif(sys.version_info[:2] != (3, 11), reason="argparse of another Python wraps lines elsewhere")
def test_the_committed_page_is_what_the_commands_print_now(capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("torch")
    pytest.importorskip("optuna")
    assert main(["--check"]) == 0, capsys.readouterr().out


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
