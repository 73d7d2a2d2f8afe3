"""Arrays that are expensive to compute, kept on disk under a key.

A folder per key with one ``.npy`` file per array, written to a temporary folder and renamed, so that a reader sees
all or nothing. Nothing is unpickled. A cache that cannot be written is no error: the arrays are computed again.
"""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..jit import cache_dir

Arrays = dict[str, NDArray]


def cached_arrays(key: str, names: tuple[str, ...], compute: Callable[[], Arrays]) -> Arrays:
    """The arrays stored under ``key``, computed and stored where they are not.

    Args:
        key: hexadecimal digest of everything the arrays depend on.
        names: the arrays that ``compute`` returns.
        compute: called on a miss, and where a stored file is damaged.
    """
    folder = cache_dir() / "maps" / key
    try:
        # copy-on-write keeps the file and lets every process share its pages
        return {n: np.asarray(np.load(folder / f"{n}.npy", mmap_mode="c", allow_pickle=False)) for n in names}
    except (OSError, ValueError, EOFError):  # the last: an empty file
        arrays = compute()
    _store(folder, arrays)
    return arrays


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
