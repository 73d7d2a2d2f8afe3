"""Numba's cache of machine code on disk, in a folder of these sources (``cache_folder.py``)."""

import contextlib
import functools
import sys
from pathlib import Path
from typing import Any

from numba.core.caching import CompileResultCacheImpl, FunctionCache, _CacheLocator
from numba.core.compiler_lock import global_compiler_lock
from numba.core.sigutils import normalize_signature

from .cache_folder import PACKAGE, kernel_folder, warn_unkept
from .callees import quick_compilation
from .interrupts import uninterrupted

LONGEST_WAIT_S = 600.0  # for another process that compiles the same kernel; then this process compiles it, too


class _Locator(_CacheLocator):
    def __init__(self, function: Any, file: str) -> None:
        self._module, self._folder = function.__module__, Path(file).parent

    @classmethod
    def from_function(cls, function: Any, file: str) -> "_Locator":
        return cls(function, file)

    def get_cache_path(self) -> str:
        return str(kernel_folder())

    def get_source_stamp(self) -> int:
        """Return 0 for a kernel of the package, because the name of its folder contains the hash of the sources.

        For any other kernel, return the time (ns) of the last change to a file in its folder.
        """
        inside = self._folder.is_relative_to(PACKAGE)
        return 0 if inside else max(path.stat().st_mtime_ns for path in self._folder.glob("*.py"))

    def get_disambiguator(self) -> str:
        return str(self._module)


class _Files(CompileResultCacheImpl):
    _locator_classes = (_Locator,)


class KernelCache(FunctionCache):
    """The machine code of one kernel on disk; files that cannot be read or written only cost time."""

    _impl_class = _Files

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(sig, target_context)
        except OSError:  # unreadable now, but perhaps not damaged
            return None
        except Exception:  # a damaged file may raise anything
            with contextlib.suppress(OSError):
                self.flush()
            return None

    def save_overload(self, sig: Any, data: Any) -> None:
        try:
            super().save_overload(sig, data)
        except OSError as error:
            warn_unkept(error)

    def turn(self, sig: Any, kernel: Any) -> contextlib.AbstractContextManager[Any]:
        """Wait until no other process compiles ``kernel``, and return the lock to hold while compiling.

        In this way one process compiles a signature, and the others load its code.
        """
        with contextlib.suppress(Exception):  # of a damaged file, which :meth:`load_overload` replaces
            if self._index_key(sig, kernel.targetctx.codegen()) in self._cache_file._load_index():
                return contextlib.nullcontext()
        _announce()
        from filelock import FileLock  # imported late: it loads asyncio, and a warm cache needs no lock

        file = f"{self.cache_path}/{self._impl.filename_base}.lock"
        try:
            return FileLock(file, is_singleton=True).acquire(LONGEST_WAIT_S)  # re-entrant
        except OSError:  # no lock can be created, or it was held too long
            return contextlib.nullcontext()


@functools.cache
def _announce() -> None:
    if sys.stderr.isatty():
        text = (
            "compiling for the first time on this machine, up to half a minute (pacman-env warm-up does it beforehand)"
        )
        print(f"pacman_env: {text}", file=sys.stderr, flush=True)


def keep_code(kernel: Any) -> None:
    """Let ``kernel``, a Numba dispatcher, cache its machine code on disk."""
    compile_alone, cache = kernel.compile, KernelCache(kernel.py_func)

    def compile_in_turn(signature: Any) -> Any:
        if normalize_signature(signature)[0] in kernel.overloads:
            return compile_alone(signature)
        # Take Numba's lock first, so that no two threads wait for each other. LLVM would drop a KeyboardInterrupt.
        with global_compiler_lock, cache.turn(signature, kernel), uninterrupted(), quick_compilation(kernel.typingctx):
            return compile_alone(signature)

    kernel._cache, kernel.compile = cache, compile_in_turn
