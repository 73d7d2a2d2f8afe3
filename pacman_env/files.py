"""User folders, shipped data, how to install extras, the commit of the sources, and result files, whole or absent."""

import contextlib
import functools
import json
import os
import shlex
import shutil
import stat
import tempfile
import warnings
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


def user_folder(kind: str) -> Path:
    """Return the user's folder of a kind ("cache", "log", "state"), which exists, or a temporary one without a home.

    Raises OSError if there is neither.
    """
    import platformdirs  # here: every command imports this module

    try:
        folder = Path(getattr(platformdirs, f"user_{kind}_dir")("pacman_env"))
        if not folder.is_absolute():  # older platformdirs: "~" stays if there is no home
            raise RuntimeError("could not determine the home directory")
        folder.mkdir(parents=True, exist_ok=True)
    except (OSError, RuntimeError):
        folder = temporary_folder() / kind
        folder.mkdir(exist_ok=True)
    return folder


@functools.cache
def temporary_folder() -> Path:
    """Return this user's own folder among the temporary files; warns of it.

    Raises PermissionError if another user may have made it: Numba unpickles what lies in a cache.
    """
    folder = Path(tempfile.gettempdir()) / f"pacman_env-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    status = folder.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.geteuid() or status.st_mode & 0o022:
        raise PermissionError(f"{folder}: is not this user's alone; set HOME to a folder that can be written")
    text = f"there is no home folder that can be written: pacman_env keeps its files in {folder}"
    warnings.warn(f"{text}; set HOME to change it", RuntimeWarning, stacklevel=2)
    return folder


def commit() -> str:
    """Return the commit of these sources, with "+" if files have changed since; "unknown" outside their checkout.

    The repository must track the package at its top: an installed package may lie inside another project's.
    """
    import subprocess  # every command imports this module, few ask for the commit

    file = Path(__file__).resolve()
    checkout, own = file.parents[1], file.relative_to(file.parents[1]).as_posix()
    tracked = ["ls-files", "--full-name", "--error-unmatch", own]
    described = ["describe", "--always", "--exclude=*", "--abbrev=40", "--dirty=+"]
    try:
        name, found = (
            subprocess.run(["git", *words], cwd=checkout, capture_output=True, text=True, check=True).stdout.strip()
            for words in (tracked, described)
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return found if name == own else "unknown"


def prepare(path: Path) -> Path:
    """Create the folder of a file that will be written later; raises ValueError before the work, not after it."""
    if _is_special(path):
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
    """Yield a temporary file beside ``path``, with its suffix, that replaces it if the block succeeds.

    If ``path`` is a symbolic link its target is replaced. A device or a pipe is written to directly.
    """
    if _is_special(path):  # /dev/stdout, or /dev/null, which root could replace with a file
        yield path
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
    """Return whether a path is a device, a pipe or a socket."""
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
