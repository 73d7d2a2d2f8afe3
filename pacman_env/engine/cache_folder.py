"""Folders of the cache, for compiled code and prepared maps; imports no compiler."""

import ast
import contextlib
import functools
import hashlib
import importlib.metadata
import os
import shutil
import sys
import time
import warnings
from collections.abc import Iterable
from pathlib import Path

from .._version import __version__
from ..files import user_folder, write_text

PACKAGE = Path(__file__).resolve().parents[1]
_KEPT_S = 30 * 86400.0  # code that was not used for this time is removed
_KERNEL_ROOMS = ("config", "engine", "game", "world", "sim", "heuristics")  # in addition to the package's top modules


def cache_dir() -> Path:
    """Return the cache folder: $PACMAN_ENV_CACHE, or the user's cache folder.

    Raises OSError if neither the user's folder nor a temporary one can be created.
    """
    variable = os.environ.get("PACMAN_ENV_CACHE")
    return Path(variable) if variable else user_folder("cache")


unkept: list[OSError] = []  # first error of this process when writing to the cache


def warn_unkept(error: OSError) -> None:
    """Warn, once per process, that compiled code or a prepared map could not be written to the cache."""
    if not unkept:
        unkept.append(error)
        cause = error.strerror or str(error)
        with contextlib.suppress(OSError):  # there is no cache folder; ``error`` says so
            cause = f"{cache_dir()}: {cause}"
        text = f"new compiled code and prepared maps are not kept: {cause}"
        warnings.warn(f"{text}; set PACMAN_ENV_CACHE to a folder that can be written", RuntimeWarning, stacklevel=2)


def check_kept() -> None:
    """Raise OSError if any write of this process to the cache has failed."""
    if unkept:
        raise OSError(f"{cache_dir()}: not everything could be kept: {unkept[0].strerror or unkept[0]}")


@functools.cache
def package_hash() -> str:
    """Return a hash of all sources of the package, 12 hexadecimal digits."""
    return _hash_of((path, path.read_bytes()) for path in PACKAGE.rglob("*.py"))


@functools.cache
def source_hash() -> str:
    """Return a hash of the code that kernels and prepared maps depend on, without its comments and docstrings.

    The hash is cached on disk for unchanged files, because parsing them takes a quarter of a second.
    """
    paths = [*PACKAGE.glob("*.py"), *(path for room in _KERNEL_ROOMS for path in (PACKAGE / room).rglob("*.py"))]
    known = None
    with contextlib.suppress(OSError):
        known = cache_dir() / "kernels" / f"sources-{_hash_of((path, path.read_bytes()) for path in paths)}"
        return known.read_text()
    trees = {path: ast.parse(path.read_bytes()) for path in paths}
    for node in (node for tree in trees.values() for node in ast.walk(tree)):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef) and ast.get_docstring(node) is not None:
            del node.body[0]
    found = _hash_of((path, ast.dump(tree).encode()) for path, tree in trees.items())
    with contextlib.suppress(OSError):
        if known is not None:
            known.parent.mkdir(parents=True, exist_ok=True)
            write_text(known, found)
    return found


def _hash_of(contents: Iterable[tuple[Path, bytes]]) -> str:
    digest = hashlib.sha256()
    for path, content in sorted(contents):
        digest.update(path.relative_to(PACKAGE).as_posix().encode() + content)
    return digest.hexdigest()[:12]


@functools.cache
def kernel_folder() -> Path | None:
    """Return the folder of code compiled from these sources, which may be read-only; create it if necessary.

    If it cannot be created, warn and return None. When it is created, folders that were not used for ``_KEPT_S`` are
    removed.
    """
    try:
        compiler = f"{sys.implementation.cache_tag}-numba{importlib.metadata.version('numba')}"
        folder = cache_dir() / "kernels" / f"{__version__}-{compiler}-{source_hash()}"
        if not folder.exists():
            folder.mkdir(parents=True, exist_ok=True)
            for other in folder.parent.iterdir():
                if time.time() - other.stat().st_mtime > _KEPT_S:
                    shutil.rmtree(other, ignore_errors=True) if other.is_dir() else other.unlink(missing_ok=True)
    except OSError as error:
        warn_unkept(error)
        return None
    with contextlib.suppress(OSError):
        os.utime(folder)  # mark as recently used
    return folder


def is_compiled() -> bool:
    """Return True if the folder contains code compiled from these sources."""
    folder = kernel_folder()
    return folder is not None and any(folder.glob("*.nbi"))


def mark(name: str) -> Path | None:
    """Return the path of the file whose existence says that the work ``name`` is done for these sources.

    The file is not created. Returns None if it does not exist and the folder cannot be written.
    """
    folder = kernel_folder()
    if folder is None:
        return None
    file = folder / name
    return file if file.exists() or os.access(folder, os.W_OK) else None
