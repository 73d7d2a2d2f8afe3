"""User folders, shipped data, install commands, the commit of the sources, and atomic writing of result files."""

import contextlib
import errno
import functools
import json
import os
import re
import shlex
import stat
import tempfile
import threading
import uuid
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

_OURS = uuid.uuid4().hex[:8]  # in names of temporary files, because several machines may share a folder


def shipped(in_package: str, in_checkout: str) -> Path:
    """Return a folder of shipped data: ``in_package`` in the installed package, or ``in_checkout`` in a checkout."""
    package = Path(__file__).parent
    installed = package / in_package
    return installed if installed.is_dir() else package.parent / in_checkout


def install_command(extra: str) -> str:
    """Return the command that installs the optional dependencies ``extra``, from the checkout if there is one."""
    checkout = Path(__file__).resolve().parents[1]
    if (checkout / "pyproject.toml").is_file():
        return f"cd {shlex.quote(str(checkout))} && pip install -e '.[{extra}]'"
    return f"pip install 'pacman_env[{extra}]'"  # pip only adds the missing packages


def user_folder(kind: str) -> Path:
    """Return the user's folder of a kind ("cache", "log" or "state"), and create it if it does not exist.

    If this is impossible, return a temporary folder. Raises OSError if that cannot be created either.
    """
    import platformdirs  # imported here because every command imports this module

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
    """Return this user's folder for temporary files; create it if necessary, and warn that there is no home folder.

    Raises PermissionError if others own it or can write to it, because Numba unpickles cache files.
    """
    folder = Path(tempfile.gettempdir()) / f"pacman_env-{os.getuid()}"
    folder.mkdir(mode=0o700, exist_ok=True)
    status = folder.lstat()
    if not stat.S_ISDIR(status.st_mode) or status.st_uid != os.geteuid() or status.st_mode & 0o022:
        raise PermissionError(f"{folder}: is not private to this user; set HOME to a folder that can be written")
    text = f"no writable home folder: pacman_env stores its files in {folder}"
    warnings.warn(f"{text}; set HOME to change it", RuntimeWarning, stacklevel=2)
    return folder


def commit() -> str:
    """Return the commit of these sources, with "+" if files have changed; "unknown" outside a checkout.

    The repository must track this file, because an installed package may lie inside another project's checkout.
    """
    import subprocess  # every command imports this module, few ask for the commit

    file = Path(__file__).resolve()
    checkout, own = file.parents[1], file.relative_to(file.parents[1]).as_posix()
    tracked = ["ls-files", "--full-name", "--error-unmatch", own]
    described = ["describe", "--always", "--exclude=*", "--abbrev=40", "--dirty=+"]
    try:
        name, version = (
            subprocess.run(["git", *words], cwd=checkout, capture_output=True, text=True, check=True).stdout.strip()
            for words in (tracked, described)
        )
    except (OSError, subprocess.CalledProcessError):
        return "unknown"
    return version if name == own else "unknown"


def displayable(name: str) -> str:
    """Return a file name as valid text: bytes that are not UTF-8 become U+FFFD."""
    return re.sub("[\ud800-\udfff]", "\ufffd", name)  # Python decodes such bytes as lone surrogates


def prepare(path: Path) -> Path:
    """Create the folder of ``path``, a file that will be written later, and return ``path``.

    Raises ValueError if the file cannot be written there. Devices, pipes and sockets are not checked.
    """
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
    """Yield the path of a temporary file next to ``path``, with the same suffix, to be written in the block.

    The temporary files of an ONNX file and of its metadata have one stem, so that they can be tried together.
    After the block it replaces ``path``; if the block raises an error, it is deleted. If ``path`` is a symbolic link,
    the target is replaced. For a device or a pipe, yield ``path`` itself.
    """
    if _is_special(path):  # such as /dev/null, which root could replace with a file
        yield path
        return
    target = path.resolve()
    temporary = target.with_name(f".{path.stem}.{_OURS}-{threading.get_native_id()}{path.suffix}")
    try:
        yield temporary
        os.replace(temporary, target)
    except OSError as error:
        # An error that names no file (full disk) or only the temporary file names ``path`` instead.
        ours = error.filename is None or Path(os.fsdecode(error.filename)).is_relative_to(temporary)
        if error.strerror is None or not ours or isinstance(error, BrokenPipeError):
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        temporary.unlink(missing_ok=True)


def reason(error: OSError) -> str:
    """Format an OSError as ``PATH: REASON``; if it was raised with a text only, return the text."""
    if error.strerror is None:
        return str(error)
    if error.errno == errno.ENOENT and error.filename is None:  # raised by os.getcwd
        return "the current folder was deleted: change to another folder"
    return error.strerror if error.filename is None else f"{os.fsdecode(error.filename)}: {error.strerror}"


def _is_special(path: Path) -> bool:
    """Return True if a path is a device, a pipe or a socket."""
    return path.exists() and not (path.is_file() or path.is_dir())


def write_text(path: Path, text: str) -> None:
    """Write a text file atomically."""
    with replaced(path) as temporary:
        temporary.write_text(displayable(text), encoding="utf-8")


def write_json(path: Path, content: Any) -> None:
    """Write plain data as JSON; values that JSON does not support are written as text."""
    write_text(path, json.dumps(content, indent=2, default=str) + "\n")
