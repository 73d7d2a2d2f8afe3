import contextlib
import os
import pwd
import resource
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from pacman_env import files
from pacman_env.files import (
    commit,
    displayable,
    install_command,
    prepare,
    reason,
    replaced,
    user_folder,
    write_text,
)


def test_commit_is_independent_of_working_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    here = commit()
    monkeypatch.chdir(tmp_path)
    assert commit() == here
    assert here == "unknown" or len(here.rstrip("+")) == 40


def test_install_command_uses_checkout_if_there_is_one(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    top = tmp_path / "my clone"
    monkeypatch.setattr(files, "__file__", str(top / "pacman_env" / "files.py"))
    assert install_command("web") == "pip install 'pacman_env[web]'"
    top.mkdir()
    (top / "pyproject.toml").touch()
    assert install_command("web") == f"cd '{top}' && pip install -e '.[web]'"


@pytest.mark.parametrize(
    ("place", "added", "known"),
    [("", ".", True), (".venv/site-packages", "README", False), ("", "README", False), ("libraries", ".", False)],
    ids=["checkout", "installed in a project", "copied into a project", "tracked below the top"],
)
def test_commit_is_unknown_outside_own_checkout(place: str, added: str, known: bool, tmp_path: Path) -> None:
    package = tmp_path / place / "pacman_env"
    package.mkdir(parents=True)
    shutil.copy(files.__file__, package)
    (package / "__init__.py").touch()
    (tmp_path / "README").touch()
    git = ["git", "-c", "user.name=a", "-c", "user.email=a@b"]
    for words in (["init", "--quiet"], ["add", added], ["commit", "--quiet", "-m", "all"]):
        subprocess.run([*git, *words], cwd=tmp_path, check=True)
    code = "from pacman_env.files import commit; print(commit())"
    done = subprocess.run([sys.executable, "-c", code], cwd=package.parent, capture_output=True, text=True, check=True)
    head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert done.stdout.strip().rstrip("+") == (head.stdout.strip() if known else "unknown")


@pytest.fixture
def homeless(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The folder of temporary files; the user has no home."""
    for name in ("HOME", "XDG_CACHE_HOME", "XDG_STATE_HOME"):
        monkeypatch.delenv(name, raising=False)

    def unknown(number: int) -> None:
        raise KeyError(f"getpwuid(): uid not found: {number}")

    monkeypatch.setattr(pwd, "getpwuid", unknown)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    files.temporary_folder.cache_clear()
    yield tmp_path
    files.temporary_folder.cache_clear()


def test_user_without_home_gets_private_temporary_folder(homeless: Path) -> None:
    with pytest.warns(RuntimeWarning) as said:
        folders = [user_folder(kind) for kind in ("cache", "state", "cache")]
    assert len(said) == 1
    assert folders[0] == folders[2] != folders[1]
    assert all(folder.is_dir() and folder.is_relative_to(homeless) for folder in folders)
    (private,) = homeless.iterdir()
    assert stat.S_IMODE(private.stat().st_mode) == 0o700


def test_unwritable_home_is_replaced_by_temporary_folder(homeless: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HOME", os.devnull)
    with pytest.warns(RuntimeWarning):
        assert user_folder("cache").is_relative_to(homeless)


@pytest.mark.parametrize("kind", ["file", "link", "writable", "foreign"])
def test_unsafe_temporary_folder_is_refused(kind: str, homeless: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = homeless / f"pacman_env-{os.getuid()}"
    if kind == "file":
        folder.touch()
    elif kind == "link":
        (homeless / "prepared").mkdir(mode=0o700)
        folder.symlink_to(homeless / "prepared")
    else:
        folder.mkdir()
        folder.chmod(0o777 if kind == "writable" else 0o755)
    if kind == "foreign":
        monkeypatch.setattr(os, "geteuid", lambda: folder.stat().st_uid + 1)
    with pytest.raises(OSError, match=folder.name):
        user_folder("cache")


def test_prepare_creates_folders_or_refuses_the_path(tmp_path: Path) -> None:
    assert prepare(tmp_path / "a" / "b" / "c.json").parent.is_dir()
    (tmp_path / "file").write_text("")
    with pytest.raises(ValueError, match="is a folder"):
        prepare(tmp_path)
    with pytest.raises(ValueError, match="cannot create its folder"):
        prepare(tmp_path / "file" / "out.json")


@pytest.mark.parametrize("fails", [False, True])
def test_replaced_file_appears_only_when_complete(fails: bool, tmp_path: Path) -> None:
    path = tmp_path / "out.txt"
    path.write_text("old")
    with contextlib.suppress(RuntimeError), replaced(path) as temporary:
        temporary.write_text("new")
        assert path.read_text() == "old"
        if fails:
            raise RuntimeError
    assert path.read_text() == ("old" if fails else "new")
    assert list(tmp_path.iterdir()) == [path]


def test_write_through_symlink_replaces_target_only(tmp_path: Path) -> None:
    target, link = tmp_path / "elsewhere" / "data.json", tmp_path / "link.json"
    link.symlink_to(target)
    prepare(link)
    for content in ("first", "second"):
        with replaced(link) as temporary:
            assert temporary.suffix == ".json"
            temporary.write_text(content)
        assert link.is_symlink()
        assert target.read_text() == content
    assert list(target.parent.iterdir()) == [target]


def test_pipe_is_written_and_stays_a_pipe(tmp_path: Path) -> None:
    pipe = tmp_path / "pipe.json"
    os.mkfifo(pipe)
    read: list[str] = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_text()))
    reader.start()
    with replaced(prepare(pipe)) as temporary:
        temporary.write_text("all of it")
    reader.join()
    assert read == ["all of it"]
    assert pipe.is_fifo()
    assert list(tmp_path.iterdir()) == [pipe]


@pytest.fixture
def small_files() -> Iterator[None]:
    """Files of at most 4 KiB: to write more is refused by the system, as on a full disk."""
    limits, on_signal = resource.getrlimit(resource.RLIMIT_FSIZE), signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, limits[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    signal.signal(signal.SIGXFSZ, on_signal)


def test_system_error_names_final_file_instead_of_temporary(tmp_path: Path, small_files: None) -> None:
    def write(temporary: Path) -> None:
        with temporary.open("wb", buffering=0) as file:
            while True:
                file.write(bytes(4096))

    path = tmp_path / "out.bin"
    with pytest.raises(OSError, match="File too large") as refusal, replaced(path) as temporary:
        write(temporary)
    assert reason(refusal.value) == f"{path}: File too large"
    with pytest.raises(OSError, match="No such file") as refusal, replaced(path):
        (tmp_path / "absent").read_bytes()
    assert reason(refusal.value) == f"{tmp_path / 'absent'}: No such file or directory"
    assert list(tmp_path.iterdir()) == []


def test_deleted_current_folder_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "gone").mkdir()
    monkeypatch.chdir(tmp_path / "gone")
    (tmp_path / "gone").rmdir()
    with pytest.raises(FileNotFoundError) as caught:
        prepare(Path("out.json"))
    assert "the current folder was deleted" in reason(caught.value)


def test_undecodable_bytes_of_a_name_become_text(tmp_path: Path) -> None:
    name = os.fsdecode(b"K\xfcche")
    assert displayable(name) == "K\ufffdche"
    write_text(tmp_path / "page.html", name)
    assert (tmp_path / "page.html").read_text(encoding="utf-8") == "K\ufffdche"
