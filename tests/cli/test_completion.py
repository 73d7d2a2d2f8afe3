"""The scripts of ``pacman-env completion``, read by the shells that they are for."""

import shutil
import subprocess
from pathlib import Path

import pytest

from pacman_env.cli.completion import SHELLS
from pacman_env.cli.main import main


@pytest.fixture
def scripts(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> dict[str, Path]:
    pytest.importorskip("shtab")
    found = {}
    for shell in SHELLS:
        assert main(["completion", shell]) == 0
        found[shell] = tmp_path / f"completion.{shell}"
        found[shell].write_text(capsys.readouterr().out)
    return found


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        (["com"], {"compare", "completion"}),
        (["map", ""], {"check", "list", "generate"}),
        (["compare", "--epi"], {"--episodes"}),
        (["completion", ""], set(SHELLS)),
        (["map", "check", "hom"], {"home.yaml"}),
        (["map", "generate", "hom"], {"home.yaml"}),
    ],
)
def test_bash_completes_commands_options_and_files(
    scripts: dict[str, Path], tmp_path: Path, words: list[str], offered: set[str]
) -> None:
    pytest.importorskip("psutil")
    if shutil.which("bash") is None:
        pytest.skip("no bash")
    (tmp_path / "home.yaml").touch()
    ask = 'source "$1"; shift; COMP_WORDS=(pacman-env "$@"); COMP_CWORD=$#\n'
    ask += 'words=(pacman-env "$@"); "$(complete -p pacman-env | sed -E "s/.*-F (\\S+).*/\\1/")" '
    ask += 'pacman-env "${words[-1]}" "${words[-2]}"; printf "%s\\n" "${COMPREPLY[@]}"'
    command = ["bash", "-c", ask, "bash", str(scripts["bash"]), *words]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
    assert set(done.stdout.split()) - {"-h", "--help"} == offered


@pytest.mark.parametrize(("shell", "option"), [("bash", "-n"), ("zsh", "-n"), ("fish", "--no-execute")])
def test_completion_script_is_valid_for_its_shell(scripts: dict[str, Path], shell: str, option: str) -> None:
    if shutil.which(shell) is None:
        pytest.skip(f"no {shell}")
    done = subprocess.run([shell, option, scripts[shell]], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (0, "")
