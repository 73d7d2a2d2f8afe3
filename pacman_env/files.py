"""Shipped data, how to install extras, the commit of the sources, and result files that are whole or absent."""

import contextlib
import json
import os
import shlex
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any


def shipped(in_package: str, in_checkout: str) -> Path:
    """A folder of data that comes with the project: in the installed package, or at the top of a checkout."""
    package = Path(__file__).parent
    installed = package / in_package
    return installed if installed.is_dir() else package.parent / in_checkout


def install_command(extra: str) -> str:
    """Return the command that installs what ``extra`` adds: from the checkout if the package lies in one."""
    checkout = Path(__file__).resolve().parents[1]
    if (checkout / "pyproject.toml").is_file():
        return f"cd {shlex.quote(str(checkout))} && pip install -e '.[{extra}]'"
    return f"pip install 'pacman_env[{extra}]'"  # pip completes what is installed under this name


def commit() -> str:
    """The commit of these sources, with "+" after it where files have changed since; "unknown" outside a repository."""
    import subprocess  # every command imports this module, few ask for the commit

    command = ["git", "describe", "--always", "--exclude=*", "--abbrev=40", "--dirty=+"]
    try:
        done = subprocess.run(command, cwd=Path(__file__).parents[1], capture_output=True, text=True, check=True)
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return done.stdout.strip()


def prepare(path: Path) -> Path:
    """Create the folder of a file that will be written later; raises ValueError before the work, not after it."""
    if _is_special(path):
        if not os.access(path, os.W_OK):
            raise ValueError(f"{path}: cannot be written to")
        return path
    folder = path.resolve().parent
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ValueError(f"{path}: cannot create its folder: {error.strerror}") from None
    if path.is_dir():
        raise ValueError(f"{path}: is a folder, not a file")
    if not os.access(folder, os.W_OK):
        raise ValueError(f"{path}: its folder cannot be written to")
    return path


@contextlib.contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """A temporary file beside ``path``, with its suffix, that replaces it if the block succeeds.

    Where ``path`` is a symbolic link its target is replaced; a device or a pipe is written to, once all is there.
    """
    if _is_special(path):
        with tempfile.TemporaryDirectory() as folder, _named(path, Path(folder)):
            temporary = Path(folder) / path.name
            yield temporary
            with temporary.open("rb") as content, path.open("wb") as out:
                shutil.copyfileobj(content, out)
        return
    target = path.resolve()
    temporary = target.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        with _named(path, temporary):
            yield temporary
            os.replace(temporary, target)
    finally:
        temporary.unlink(missing_ok=True)


def reason(error: OSError) -> str:
    """``PATH: REASON`` of an error of the system, its text if it is one of ours."""
    if error.strerror is None:
        return str(error)
    return error.strerror if error.filename is None else f"{os.fsdecode(error.filename)}: {error.strerror}"


@contextlib.contextmanager
def _named(path: Path, temporary: Path) -> Iterator[None]:
    """Errors of the system that name no file, as that of a full disk, or a temporary one, name ``path``."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        ours = error.filename is None or Path(os.fsdecode(error.filename)).is_relative_to(temporary)
        if error.strerror is None or not ours:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error


def _is_special(path: Path) -> bool:
    """Whether it is a device, a pipe or a socket, which must stay what it is."""
    return path.exists() and not (path.is_file() or path.is_dir())


@contextlib.contextmanager
def new_folder(path: Path) -> Iterator[Path]:
    """A temporary folder beside ``path`` that becomes it if the block succeeds."""
    temporary = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        with _named(path, temporary):
            temporary.mkdir()
            yield temporary
            os.rename(temporary, path)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def write_json(path: Path, content: Any) -> None:
    """Write plain data; what JSON does not know is written as its text."""
    with replaced(path) as temporary:
        temporary.write_text(json.dumps(content, indent=2, default=str) + "\n")
