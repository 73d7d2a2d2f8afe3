"""Folders of the cache, for compiled code and prepared maps; imports no compiler."""

import contextlib
import functools
import hashlib
import os
import warnings
from collections.abc import Iterable
from pathlib import Path

from ..files import user_folder

_PACKAGE = Path(__file__).resolve().parents[1]
_KERNEL_ROOMS = ("config", "engine", "game", "world", "sim", "heuristics")  # in addition to the package's top modules


def cache_dir() -> Path:
    """Return the cache folder: $PACMAN_ENV_CACHE, or the user's cache folder.

    Raises OSError if the user has no such folder.
    """
    variable = os.environ.get("PACMAN_ENV_CACHE")
    return Path(variable) if variable else user_folder("cache")


unkept: list[OSError] = []  # first error of this process when writing to the cache


def warn_unkept(error: OSError) -> None:
    """Warn, once per process, that something could not be written to the cache."""
    if not unkept:
        unkept.append(error)
        cause = error.strerror or str(error)
        with contextlib.suppress(OSError):  # no cache folder, which the error tells
            cause = f"{cache_dir()}: {cause}"
        text = f"new compiled code and prepared maps are not kept: {cause}"
        warnings.warn(f"{text}; set PACMAN_ENV_CACHE to a folder that can be written", RuntimeWarning, stacklevel=2)


def check_kept() -> None:
    """Raise OSError if this process could not write something to the cache."""
    if unkept:
        raise OSError(f"{cache_dir()}: not everything could be kept: {unkept[0].strerror or unkept[0]}")


@functools.cache
def source_hash() -> str:
    """Return a hash of the sources that prepare maps, 12 hexadecimal digits; compiled code has its own keys."""
    rooms = (path for room in _KERNEL_ROOMS for path in (_PACKAGE / room).rglob("*.py"))
    return _hash_of([*_PACKAGE.glob("*.py"), *rooms])


@functools.cache
def package_hash() -> str:
    """Return a hash of all sources of the package, 12 hexadecimal digits."""
    return _hash_of(_PACKAGE.rglob("*.py"))


def _hash_of(paths: Iterable[Path]) -> str:
    digest = hashlib.sha256()
    for path in sorted(paths):
        digest.update(path.relative_to(_PACKAGE).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


@functools.cache
def kernel_folder() -> Path | None:
    """Return the folder of compiled code, which may be read-only; warn and return None if it cannot be created."""
    try:
        folder = cache_dir() / "kernels"
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        warn_unkept(error)
        return None
    return folder


def mark(name: str) -> Path | None:
    """Return the file that marks something as compiled from these sources, or None if it can never exist."""
    folder = kernel_folder()
    if folder is None:
        return None
    file = folder / f"{name}-{source_hash()}"
    return file if file.exists() or os.access(folder, os.W_OK) else None
