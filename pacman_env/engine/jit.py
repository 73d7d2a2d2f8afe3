"""Decorator that compiles numeric kernels, with a cache on disk (``kernel_cache.py``)."""

import functools
import types
import typing
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba
import numba.core.config as numba_config
from llvmlite import ir
from numba.core import types as numba_types

from .cache_folder import kernel_folder
from .callees import Callee
from .kernel_cache import keep_code
from .native import operation

F = TypeVar("F", bound=Callable[..., Any])

#: Modules whose plain functions are compiled when a kernel calls them.
_RULES = ("pacman_env.game.", "pacman_env.rng")


@functools.cache
def kernel(function: F, cached: bool = True, allocates: bool = True) -> F:
    """Compile ``function``, and game rules that it calls, with Numba: nopython mode, IEEE arithmetic (no fastmath).

    Use ``cached=False`` for functions from outside the package: their sources are unknown, and two of them may have
    the same name. ``allocates=False`` is for :func:`table_kernel`.
    """
    require_compiler()
    options = {} if allocates else {"_nrt": False}
    compiled: F = numba.njit(error_model="numpy", forceinline=True, nogil=True, no_cfunc_wrapper=True, **options)(
        _with_rules_compiled(function)
    )
    callee = Callee(typing.cast(Any, compiled))
    compiled.get_call_template, compiled.get_overload = callee.get_call_template, callee.get_overload  # type: ignore[attr-defined]
    if cached and Path(function.__code__.co_filename).is_file() and kernel_folder() is not None:
        keep_code(compiled)
    return compiled


def require_compiler() -> None:
    """Raise OSError if Numba's compiler is switched off, because kernels use operations that Python lacks."""
    if numba_config.DISABLE_JIT:
        raise OSError(
            "NUMBA_DISABLE_JIT is set, but the kernels of the simulator only run compiled: unset it. Without it, "
            "debuggers and coverage work in pacman_env/game, which is plain Python, and print() works in kernels"
            " (see CONTRIBUTING.md)"
        )


def table_kernel(function: F) -> F:
    """Compile a kernel that only takes numbers and creates no arrays; its code saves time by counting no references."""
    return kernel(function, allocates=False)


def _with_rules_compiled(function: F) -> F:
    """Return a copy of ``function`` that calls compiled versions of the plain functions in the ``_RULES`` modules.

    Return ``function`` itself if it calls none of them.
    """
    used = function.__globals__
    rules = {
        name: kernel(used[name])
        for name in function.__code__.co_names
        if isinstance(used.get(name), types.FunctionType) and used[name].__module__.startswith(_RULES)
    }
    if not rules:
        return function
    copy = types.FunctionType(function.__code__, {**used, **rules}, function.__name__, function.__defaults__)
    copy.__qualname__, copy.__module__ = function.__qualname__, function.__module__
    return typing.cast(F, copy)


@operation(numba_types.uint64, numba_types.uint64)
def lowest_bit(context, builder, signature, value):  # type: ignore[no-untyped-def]
    """Return the index of the lowest set bit of a uint64 other than 0."""
    return builder.cttz(value, ir.Constant(ir.IntType(1), 1))
