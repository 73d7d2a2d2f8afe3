"""The folder of what can be computed again, and of compiled code in it; imports no compiler."""

import functools
import hashlib
import os
from collections.abc import Iterable
from pathlib import Path

import platformdirs

_PACKAGE = Path(__file__).resolve().parents[1]
_KERNEL_ROOMS = ("config", "engine", "game", "world", "sim", "heuristics")  # beside the modules of the package itself


def cache_dir() -> Path:
    """Folder for everything that can be computed again: $PACMAN_ENV_CACHE or the user's cache folder."""
    return Path(os.environ.get("PACMAN_ENV_CACHE") or platformdirs.user_cache_dir("pacman_env"))


@functools.cache
def source_hash() -> str:
    """Hash of the sources that prepare maps, 12 hexadecimal digits; compiled code has keys of its own."""
    rooms = (path for room in _KERNEL_ROOMS for path in (_PACKAGE / room).rglob("*.py"))
    return _hash_of([*_PACKAGE.glob("*.py"), *rooms])


@functools.cache
def package_hash() -> str:
    """Hash of all sources of the package, 12 hexadecimal digits."""
    return _hash_of(_PACKAGE.rglob("*.py"))


def _hash_of(paths: Iterable[Path]) -> str:
    digest = hashlib.sha256()
    for path in sorted(paths):
        digest.update(path.relative_to(_PACKAGE).as_posix().encode())
        digest.update(path.read_bytes())
    return digest.hexdigest()[:12]


@functools.cache
def kernel_folder() -> Path | None:
    """The folder of compiled code; None, and nothing is kept, where it cannot be written."""
    folder = cache_dir() / "kernels"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None


def mark(name: str) -> Path | None:
    """The file that marks something as compiled beforehand, from these sources; None if nothing is kept."""
    folder = kernel_folder()
    return None if folder is None else folder / f"{name}-{source_hash()}"
