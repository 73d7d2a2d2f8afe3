"""Cache of machine code on disk, with one folder per kernel, named by its key (``kernel_key.py``).

If several processes need a kernel at once, one compiles it under a file lock, and the others load the result. Numba
looks into its cache, compiles and saves. The lock is taken after the first step, which is then repeated.
"""

import contextlib
import functools
import gc
import os
import shutil
import sys
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile, _CacheLocator
from numba.core.compiler_lock import global_compiler_lock
from numba.core.dispatcher import Dispatcher
from numba.core.errors import NumbaExperimentalFeatureWarning
from numba.core.sigutils import normalize_signature

from . import kernel_key
from .cache_folder import warn_unkept
from .callees import calls_remembered
from .interrupts import interruptible, uninterrupted

KEPT_S = 30 * 86400.0  # lifetime of unused code
_SWEPT_S = 86400.0


class KernelCache(FunctionCache):
    def __init__(self, kernel: Dispatcher, root: Path) -> None:
        self._kernel, self._root = kernel, root
        self._py_func, self._name = kernel.py_func, repr(kernel.py_func)
        self._folder: Path | None = None
        self.enable()

    def find(self) -> Path | None:
        """Return the folder for the present key of the kernel, which need not exist, or None without a key."""
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
            loaded = super().load_overload(sig, target_context)
        except OSError:  # unreadable
            return None
        except Exception:  # a damaged file may raise anything; it will be replaced
            shutil.rmtree(folder, ignore_errors=True)
            return None
        if loaded is not None:
            with contextlib.suppress(OSError):
                os.utime(folder)  # mark as recently used
        return loaded

    def save_overload(self, sig: Any, data: Any) -> None:
        """Save compiled code unless the key has changed since :meth:`find`; warn once if it cannot be written."""
        folder = self.find()
        if folder is None:
            return
        kernel_key.forget()
        if self._named() == folder:
            try:
                super().save_overload(sig, data)
            except OSError as error:
                warn_unkept(error)
            sweep(self._root)

    def keeps(self, sig: Any) -> bool:
        """Return True if the cache contains machine code for a signature and this processor."""
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
    """Remove entries that were not used for ``KEPT_S``, at most once a day."""
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


MESSAGE_AFTER_S = 1.0
LONGEST_WAIT_S = 600.0  # total wait of a process for locks, whose holder may have stopped; then it compiles itself
_WAITING = "pacman_env: another process compiles; waiting for it (pacman-env warm-up does it beforehand)"
_COMPILING = "pacman_env: compiling for the first time on this machine, about half a minute"

_waited_s = 0.0  # total wait of this process
_compiling_since: float | None = None
_helped = False  # another process compiles for this one


def take_turns(kernel: Any) -> None:
    """Let one process at a time compile ``kernel``, a Numba dispatcher with a :class:`KernelCache`.

    Deadlocks are impossible, because Numba's process lock is always taken first and callees need no lock.
    """
    load, compile_alone = kernel._cache.load_overload, kernel.compile
    turns: list[contextlib.ExitStack] = []  # at most one, protected by Numba's lock

    def load_or_wait(signature: Any, context: Any) -> Any:
        loaded = load(signature, context)
        if loaded is None and turns and (file := kernel._cache.lock) is not None:
            with interruptible():  # waiting may take long
                turns[-1].enter_context(_locked(file))
            loaded = load(signature, context)
            if loaded is None:
                _note_compiling()
        return loaded

    def compile_in_turn(signature: Any) -> Any:
        with uninterrupted(), global_compiler_lock, contextlib.ExitStack() as turn:
            turns.append(turn)
            turn.enter_context(warnings.catch_warnings())
            # Numba warns if a record is passed for another one with the same first fields.
            warnings.simplefilter("ignore", NumbaExperimentalFeatureWarning)
            turn.enter_context(calls_remembered(kernel.typingctx))
            collects = gc.isenabled()
            gc.disable()  # saves 5 to 7 % of the time, because the compiler creates many objects
            try:
                return compile_alone(signature)
            finally:
                turns.pop()
                if collects:
                    gc.enable()

    kernel._cache.load_overload, kernel.compile = load_or_wait, compile_in_turn


@contextlib.contextmanager
def _locked(file: Path) -> Iterator[None]:
    """Hold a file lock, or continue without it after the longest wait or an error."""
    global _waited_s
    from filelock import FileLock, Timeout  # imported late: it loads asyncio, and a warm cache needs no lock

    with contextlib.ExitStack() as stack:
        for limit in (MESSAGE_AFTER_S, LONGEST_WAIT_S):
            began = time.monotonic()
            try:
                file.parent.mkdir(parents=True, exist_ok=True)
                lock = FileLock(file, is_singleton=True)  # re-entrant, because a kernel may be defined twice
                stack.enter_context(lock.acquire(timeout=max(0.0, limit - _waited_s)))
                break
            except Timeout:
                if not _helped or sys.stderr.isatty():
                    _print_once(_COMPILING if _helped else _WAITING)
            except OSError:  # after Timeout, which is a subclass
                break
            finally:
                _waited_s += time.monotonic() - began
        yield


def expect_help() -> None:
    """Note that another process compiles kernels for this one."""
    global _helped
    _helped = True


def _note_compiling() -> None:
    """Print a message to a terminal once compiling has taken more than a second."""
    global _compiling_since
    if _compiling_since is None:
        _compiling_since = time.monotonic()
    elif time.monotonic() - _compiling_since > MESSAGE_AFTER_S and sys.stderr.isatty():
        _print_once(_COMPILING)


@functools.cache
def _print_once(message: str) -> None:
    print(message, file=sys.stderr, flush=True)
