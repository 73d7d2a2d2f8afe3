"""Where machine code is kept: a folder for each kernel, named by what it reaches (``kernel_key.py``) alone."""

from __future__ import annotations

import contextlib
import os
import shutil
import time
from pathlib import Path
from typing import Any

from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, _CacheLocator
from numba.core.dispatcher import Dispatcher
from numba.core.sigutils import normalize_signature

from . import kernel_key

KEPT_S = 30 * 86400.0  # since it was last used
_SWEPT_S = 86400.0


class KernelCache(FunctionCache):
    def __init__(self, kernel: Dispatcher, root: Path) -> None:
        self._kernel, self._root = kernel, root
        self._py_func, self._name = kernel.py_func, repr(kernel.py_func)
        self._folder: Path | None = None
        self.enable()

    def find(self) -> Path | None:
        """The folder of what the kernel reaches now, which need not exist; None without a key."""
        if self._folder is None:
            with contextlib.suppress(kernel_key.UnknownContent):
                self._folder = self._named()
                self._impl = _Reduced(self._py_func, self._folder)
                self._cache_file = IndexDataCacheFile(str(self._folder), "code", "")
        return self._folder

    def _named(self) -> Path:
        name = f"{self._py_func.__module__}.{self._py_func.__qualname__}".replace("<", "").replace(">", "")
        return self._root / f"{name[-100:]}-{kernel_key.kernel_key(self._kernel)}"

    @property
    def cache_path(self) -> str | None:
        return None if self._folder is None else str(self._folder)

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        folder = self.find()
        if folder is None:
            return None
        try:
            kept = super().load_overload(sig, target_context)
        except Exception:  # a damaged file may raise anything; it is written anew
            shutil.rmtree(folder, ignore_errors=True)
            return None
        if kept is not None:
            with contextlib.suppress(OSError):
                os.utime(folder)  # used now
        return kept

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep what was compiled, unless a value has changed since :meth:`find`; without room, nothing is kept."""
        folder = self.find()
        if folder is None:
            return
        kernel_key.forget()
        if self._named() == folder:
            with contextlib.suppress(OSError):
                super().save_overload(sig, data)
            sweep(self._root)

    def keeps(self, sig: Any) -> bool:
        """True if there is machine code for a signature and this processor."""
        if self.find() is None:
            return False
        try:
            return self._index_key(sig, self._kernel.targetctx.codegen()) in self._cache_file._load_index()
        except Exception:  # a damaged file
            return False

    @property
    def lock(self) -> Path | None:
        folder = self.find()
        return None if folder is None else folder / "lock"

    def _index_key(self, sig: Any, codegen: Any) -> Any:
        arguments, returned = normalize_signature(sig)
        content = [kernel_key.type_content(kind) for kind in arguments]
        return tuple(arguments), returned, codegen.magic_tuple(), repr(content)


class _Reduced(CompileResultCacheImpl):
    def __init__(self, function: Any, folder: Path) -> None:
        self._lineno = function.__code__.co_firstlineno
        self._locator = _Locator(function.__code__.co_filename, folder)


class _Locator(_CacheLocator):
    def __init__(self, file: str, folder: Path) -> None:
        self._py_file, self._folder = file, folder

    def get_cache_path(self) -> str:
        return str(self._folder)

    def get_source_stamp(self) -> str:
        return ""

    def get_disambiguator(self) -> str:
        return ""


def sweep(root: Path) -> None:
    """Remove what was not used for ``KEPT_S``, once a day."""
    now = time.time()
    with contextlib.suppress(OSError):
        last = root / "swept"
        if last.exists() and now - last.stat().st_mtime < _SWEPT_S:
            return
        last.touch()
        for entry in [one for one in root.iterdir() if now - one.stat().st_mtime >= KEPT_S]:
            if entry.is_dir():
                shutil.rmtree(entry, ignore_errors=True)
            else:
                entry.unlink(missing_ok=True)
