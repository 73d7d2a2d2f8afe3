"""Arrays that are expensive to compute, kept on disk: a folder per key with one ``.npy`` file per array.

A folder is renamed when it is complete. Nothing is unpickled. A cache that cannot be written is no error.
"""

import contextlib
import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...engine.jit import cache_dir

Arrays = dict[str, NDArray]
KEEP_BYTES = 2 << 30  # of arrays on disk; a house takes 2 to 5 MB, the largest real maps 300 MB


def cached_arrays(key: str, names: tuple[str, ...], compute: Callable[[], Arrays]) -> Arrays:
    """The arrays stored under ``key``, computed and stored where they are not, or where a file is damaged.

    The key is a hexadecimal digest of everything the arrays depend on; ``names`` are those that ``compute`` returns.
    """
    folder = cache_dir() / "maps" / key
    try:
        # copy-on-write keeps the file and lets every process share its pages
        arrays = {n: np.asarray(np.load(folder / f"{n}.npy", mmap_mode="c", allow_pickle=False)) for n in names}
    except (OSError, ValueError, EOFError):  # the last: an empty file
        arrays = compute()
        _store(folder, arrays)
        _prune(folder.parent)
    else:
        with contextlib.suppress(OSError):
            os.utime(folder)  # used now: pruned last
    return arrays


def _prune(root: Path) -> None:
    """Remove what was not used for longest until at most ``KEEP_BYTES`` are left."""
    with contextlib.suppress(OSError):
        folders = sorted((f for f in root.iterdir() if f.is_dir()), key=lambda f: f.stat().st_mtime, reverse=True)
        total = 0
        for folder in folders:
            total += sum(file.stat().st_size for file in folder.iterdir())
            if total > KEEP_BYTES and folder is not folders[0]:
                shutil.rmtree(folder, ignore_errors=True)


def _store(folder: Path, arrays: Arrays) -> None:
    temporary = None
    try:
        folder.parent.mkdir(parents=True, exist_ok=True)
        temporary = tempfile.mkdtemp(dir=folder.parent, prefix=".new-")
        for name, array in arrays.items():
            np.save(Path(temporary) / f"{name}.npy", array, allow_pickle=False)
        shutil.rmtree(folder, ignore_errors=True)
        os.replace(temporary, folder)
    except OSError:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)
