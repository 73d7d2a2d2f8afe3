"""The command that tries client libraries: every script is in it, and one that fails is seen."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tools import clients
from tools.clients import CLIENTS, HERE, PAGE, SCRIPTS, VENVS, Client, Result, Venv, main, table

SHARED = {"evaluate"}  # by several scripts


def test_every_script_is_run_and_every_environment_is_used() -> None:
    assert {client.name for client in CLIENTS} == {path.stem for path in SCRIPTS.glob("*.py")} - SHARED
    assert {client.venv for client in CLIENTS} == {HERE, *VENVS}


def test_the_page_shows_each_library_at_its_pinned_version_and_none_that_fails() -> None:
    page = PAGE.read_text()
    pins = dict(pin.split("==") for venv in VENVS.values() for pin in venv.requirements)
    for client in CLIENTS:
        (row,) = [line for line in page.splitlines() if f"examples/clients/{client.name}.py" in line]
        assert client.line in row
        version = next((pin for name, pin in pins.items() if name.partition("[")[0] == client.library), "")
        assert client.venv == HERE or client.library == "gymnasium" or f"| {version} |" in row
    assert "fails" not in page.partition("<!-- clients -->")[2].partition("<!-- end -->")[0]


def test_an_environment_is_constrained_but_for_what_it_unpins() -> None:
    every, some = Venv(()).constraints().splitlines(), Venv((), ("gymnasium", "filelock")).constraints().splitlines()
    assert sorted(line.partition("==")[0] for line in {*every} - {*some}) == ["filelock", "gymnasium"]
    assert {*some} <= {*every}


def test_the_scripts_of_the_development_environment_run(tmp_path: Path) -> None:
    command = [sys.executable, str(SCRIPTS / "gymnasium_wrappers.py"), "--map", "house", "--decisions", "100"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    both = "PacManBot-v0 PacManBotFlat-v0"
    for line in (f"single TimeAwareObservation: {both}", f"vector RecordEpisodeStatistics: {both}", "RecordVideo:"):
        assert line in done.stdout
    assert done.stdout.count("sync, async, vector_entry_point are equal") == 2


@pytest.fixture
def own_scripts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A script that is well, and one that fails, in place of the project's."""
    (tmp_path / "well.py").write_text("import sys; print('well with', *sys.argv[1:])")
    (tmp_path / "bad.py").write_text("raise SystemExit('no such space')")
    (tmp_path / "learns.py").write_text(
        "import sys; sys.path.insert(0, SCRIPTS); import evaluate; args = evaluate.parser('').parse_args()\n"
        "random = lambda o, m: m.argmax(axis=1)\n"
        "print(args.map, args.decisions); evaluate.untrained(random, ['maze'], 2)\n"
        "evaluate.report(random, ['maze'], 2)\n".replace("SCRIPTS", repr(str(SCRIPTS)))
    )
    own = (
        Client("well", "numpy", HERE, "gymnasium", "unmodified", ("--seed", "3")),
        Client("bad", "numpy", HERE, "gymnasium", "unmodified"),
        Client("learns", "numpy", HERE, "gymnasium", "unmodified", ("--map", "house"), learns=True),
    )
    monkeypatch.setattr(clients, "SCRIPTS", tmp_path)
    monkeypatch.setattr(clients, "CACHE", tmp_path / "cache")
    monkeypatch.setattr(clients, "CLIENTS", own)


@pytest.mark.usefixtures("own_scripts")
def test_a_script_that_fails_is_in_the_table_and_the_status(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([]) == 1
    output = capsys.readouterr()
    well, bad, _ = output.out.splitlines()[2:]
    assert "| unmodified | [well.py]" in well
    assert "| **fails** (status 1) | [bad.py]" in bad
    assert "no such space" in output.err
    assert (tmp_path / "cache" / "well.log").read_text() == "well with --seed 3\n"


@pytest.mark.usefixtures("own_scripts")
def test_completion_before_and_after_is_read_from_a_script_that_learns(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["learns", "well", "--decisions", "70"]) == 0
    well, learns = capsys.readouterr().out.splitlines()[2:]
    assert re.search(r"\| \d+\.0 -> \d+\.0 \| \d+ \|$", learns)
    assert "->" not in well
    assert (tmp_path / "cache" / "learns.log").read_text().startswith("generated 70\n")
    assert "70" not in (tmp_path / "cache" / "well.log").read_text()


@pytest.mark.usefixtures("own_scripts")
def test_an_environment_that_cannot_be_made_is_in_the_table_and_the_others_run(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def no_pip(client: Client, *more: Any) -> Result:
        if client.name == "well":
            raise subprocess.CalledProcessError(1, "pip")
        return Result(client, "2.0", 0, 3.4)

    monkeypatch.setattr(clients, "run", no_pip)
    assert main(["well", "learns"]) == 1
    output = capsys.readouterr()
    assert output.err == "well: its environment cannot be made\n"
    assert "| **fails** (status 1) | [well.py]" in output.out
    assert "| unmodified | [learns.py]" in output.out


@pytest.mark.usefixtures("own_scripts")
def test_scripts_can_be_named(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["well"]) == 0
    assert "bad" not in capsys.readouterr().out
    for arguments, message in (
        (["good"], "no script 'good'"),
        (["well", "--write"], "--write is for the table of all"),
    ):
        with pytest.raises(SystemExit, match="2"):
            main(arguments)
        assert message in capsys.readouterr().err


@pytest.mark.usefixtures("own_scripts")
def test_the_table_is_written_between_its_marks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    page = tmp_path / "README.md"
    page.write_text("before\n<!-- clients -->\nold\n<!-- end -->\nafter\n")
    monkeypatch.setattr(clients, "ROOT", tmp_path)
    monkeypatch.setattr(clients, "PAGE", page)
    main(["--write"])
    text = page.read_text()
    assert text.startswith("before\n<!-- clients -->\n\n| Library")
    assert text.endswith("|\n\n<!-- end -->\nafter\n")
    assert "old" not in text


def test_seconds_are_whole() -> None:
    assert "| [numpy](a.md) | 2.0 | unmodified |" in (
        text := table([Result(Client("a", "numpy", HERE, "a", "unmodified"), "2.0", 0, 3.4)])
    )
    assert text.endswith("| 3 |\n")
