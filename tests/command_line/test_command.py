"""The frame of every command: Ctrl-C while a parser is made."""

import argparse
import os
import signal
import sys
import threading
from pathlib import Path
from typing import Any

import pytest

from pacman_env.cli.main import main
from pacman_env.command_line.command import EXTRA_OF, Parser, finite_number, guarded
from pacman_env.files import install_command


@pytest.mark.parametrize("text", ["-5.", "-1e3", "-.5e-1", "-1_0", ".3", "+60", "5.", "1_000"])
def test_parser_accepts_every_number_format_of_python(text: str) -> None:
    parser = Parser(prog="command")
    parser.add_argument("--home", nargs=2, type=finite_number())
    assert parser.parse_args(["--home", "1", text]).home == [1.0, float(text)]


def test_parser_finishes_before_ctrl_c_takes_effect(monkeypatch: pytest.MonkeyPatch) -> None:
    """Argparse imports modules meanwhile, and Python drops what is raised in some parts of an import."""
    finished = False
    add_argument = argparse.ArgumentParser.add_argument

    def interrupted(self: Parser, *names: str, **options: Any) -> argparse.Action:
        nonlocal finished
        os.kill(os.getpid(), signal.SIGINT)
        action = add_argument(self, *names, **options)
        finished = True
        return action

    monkeypatch.setattr(argparse.ArgumentParser, "add_argument", interrupted)
    with pytest.raises(KeyboardInterrupt):
        Parser(prog="command")
    assert finished


def test_error_is_wrapped_on_terminals_only(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "30")

    def fail() -> int:
        raise ValueError("a game is in /robot_15 already: ros up (process 4504 on this machine)")

    assert guarded("command", fail) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    assert guarded("command", fail) == 2
    lines = capsys.readouterr().err.splitlines()
    assert lines == ["command: a game is in", "/robot_15 already: ros up", "(process 4504 on this machine)"]


def test_command_runs_in_another_thread() -> None:
    statuses: list[int] = []
    thread = threading.Thread(target=lambda: statuses.append(main(["map", "list"])))
    thread.start()
    thread.join()
    assert statuses == [0]


@pytest.mark.parametrize(
    ("module", "extra"),
    [("ray.exceptions", "ray"), ("action_msgs", "ros"), ("tqdm", "eval"), ("pygame", "render"), ("torch", "train")],
)
def test_error_names_extra_that_installs_missing_module(
    module: str, extra: str, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail() -> int:
        raise ModuleNotFoundError(f"No module named {module!r}", name=module)

    assert guarded("command", fail) == 2
    assert f"needs {module}: {install_command(extra)}" in capsys.readouterr().err


def test_every_named_extra_exists_in_pyproject() -> None:
    tomllib = pytest.importorskip("tomllib")  # Python 3.11
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())["project"]
    assert set(EXTRA_OF.values()) <= set(project["optional-dependencies"])


def test_system_error_is_reported_as_path_and_reason(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert guarded("command", lambda: (tmp_path / "absent").read_bytes() and 0) == 2
    assert capsys.readouterr().err == f"command: {tmp_path}/absent: No such file or directory\n"


def test_empty_path_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    parser = Parser(prog="command")
    parser.add_argument("--json", type=Path)
    with pytest.raises(SystemExit):
        parser.parse_args(["--json", ""])
    assert capsys.readouterr().err == "command: argument --json: is empty, must be a path\n"


def test_ctrl_c_in_compiled_code_stops_command(capsys: pytest.CaptureFixture[str]) -> None:
    def fail() -> int:
        raise SystemError("CPUDispatcher(...) returned a result with an exception set") from KeyboardInterrupt()

    assert guarded("command", fail) == 130
    assert capsys.readouterr().err == "command: stopped\n"

    def break_down() -> int:
        raise SystemError("broken")

    with pytest.raises(SystemError, match="broken"):
        guarded("command", break_down)


def test_help_shows_description_without_sphinx_markup() -> None:
    parser = Parser(prog="command", description="What ``x`` is, see :mod:`a.b` and :func:`c`.")
    assert "What x is, see a.b and c." in parser.format_help()
