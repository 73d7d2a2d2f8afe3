"""Hash everything that the machine code of a kernel depends on: all functions and values that the kernel reaches.

Names in the bytecode are followed through all files; other packages are represented by their versions. A value of an
unknown kind gives no key instead of a wrong one. Names of attributes (``g.x``) are also looked up as globals, which may
change a key unnecessarily but misses nothing.
"""

import dis
import enum
import functools
import hashlib
import sys
import types
from pathlib import Path
from typing import Any

import llvmlite
import numba
import numpy as np
from llvmlite import ir
from numba.core import config as numba_config
from numba.core import types as numba_types
from numba.core.dispatcher import Dispatcher
from numba.core.extending import _Intrinsic

_VERSIONED = frozenset(sys.stdlib_module_names) | {"numpy", "numba", "llvmlite"}
_VERSIONS = (
    *(sys.implementation.cache_tag, numba.__version__, llvmlite.__version__, np.__version__),
    *(numba_config.OPT, numba_config.LOOP_VECTORIZE, numba_config.SLP_VECTORIZE, numba_config.BOUNDSCHECK),
)
_NUMBERS = (int, float, complex, bool, str, bytes, type(None), type(Ellipsis))
_IMPORT_NAME = dis.opmap["IMPORT_NAME"]

#: Nested tuples of strings and numbers, whose ``repr`` is hashed.
Content = Any


class UnknownContent(TypeError):
    """Raised if a kernel reaches a value of an unknown kind."""


def kernel_key(kernel: Dispatcher) -> str:
    """Return a hash of everything that a kernel reaches now, 16 hexadecimal digits. Raises UnknownContent."""
    reached: dict[Any, int] = {kernel: 0}
    digest = hashlib.sha256(repr(_VERSIONS).encode())
    waiting = [kernel]
    for one in waiting:  # grows during the loop
        content, others = _content_and_reached(one)
        for other in others:
            if other not in reached:
                reached[other] = len(waiting)
                waiting.append(other)
        digest.update(f"{content} {[reached[other] for other in others]}".encode())
    return digest.hexdigest()[:16]


def forget() -> None:
    """Clear the cache, because the value of a global may have changed."""
    _content_and_reached.cache_clear()


def type_content(kind: numba_types.Type) -> Content:
    """Return the content of an argument's type that Numba does not compare: named tuples' fields, and added types."""
    if isinstance(kind, numba_types.BaseTuple):  # type: ignore[attr-defined]
        own = _Reader().content(kind.instance_class) if isinstance(kind, numba_types.BaseNamedTuple) else ""  # type: ignore[attr-defined]
        return own, tuple(type_content(one) for one in kind)
    return "" if _versioned(type(kind).__module__) else _Reader().content(type(kind))


@functools.cache
def _content_and_reached(function: Any) -> tuple[str, tuple[Any, ...]]:
    """Return the content of a kernel, intrinsic or function without its callees, and the callees, in order."""
    reader = _Reader()
    content: Content
    if isinstance(function, Dispatcher):
        content = ("kernel", sorted(map(repr, function.targetoptions.items())), reader.content(function.py_func))
    elif isinstance(function, _Intrinsic):
        content = ("intrinsic", function._prefer_literal, reader.content(function._defn))
    else:
        content = reader.function(function)
    return repr(content), tuple(reader.reached)


class _Reader:
    def __init__(self) -> None:
        self.reached: list[Any] = []
        self._names: tuple[str, ...] = ()
        self._modules: list[types.ModuleType] = []

    def function(self, function: types.FunctionType) -> Content:
        self._names = tuple(sorted(_names(function.__code__)))
        names = function.__globals__
        return (
            *(function.__module__, function.__qualname__, self._code(function.__code__)),
            self.content(function.__defaults__),
            self.content(tuple(sorted((function.__kwdefaults__ or {}).items()))),
            tuple(self.content(cell.cell_contents) for cell in function.__closure__ or ()),
            tuple((name, self.content(names[name])) for name in self._names if name in names),
        )

    def _code(self, code: types.CodeType) -> Content:
        if _IMPORT_NAME in code.co_code[::2]:
            raise UnknownContent(f"{code.co_name} imports while it runs")
        return (  # without co_flags, which Numba changes in place under a profiler
            *(code.co_code, code.co_exceptiontable, code.co_names, code.co_varnames),
            *(code.co_freevars, code.co_cellvars, code.co_argcount, code.co_posonlyargcount, code.co_kwonlyargcount),
            *(self.content(constant) for constant in code.co_consts),
        )

    def content(self, value: Any) -> Content:
        kind = type(value)
        if kind in _NUMBERS:
            return repr(value)
        if isinstance(value, types.CodeType):
            return self._code(value)
        if isinstance(value, Dispatcher | _Intrinsic | types.FunctionType):
            if _versioned(value.__module__):
                return value.__module__, getattr(value, "__name__", "")
            self.reached.append(value)
            return "reached"
        if isinstance(value, enum.Enum):
            return "member", self.content(kind), value.name
        if kind is tuple:
            return tuple(self.content(one) for one in value)
        if isinstance(value, tuple) and hasattr(value, "_fields"):
            return self.content(kind), tuple(self.content(one) for one in value)
        if kind is slice:  # a bytecode constant since Python 3.14
            return "slice", tuple(self.content(one) for one in (value.start, value.stop, value.step))
        if isinstance(value, frozenset):
            return "set", tuple(sorted(repr(self.content(one)) for one in value))
        if isinstance(value, np.dtype):
            return "dtype", repr(value)
        if isinstance(value, np.ndarray | np.generic) and not value.dtype.hasobject:
            strides = value.strides if isinstance(value, np.ndarray) else ()
            numbers = hashlib.sha256(value.tobytes()).hexdigest()
            return kind.__name__, repr(value.dtype), value.shape, strides, numbers
        if isinstance(value, types.ModuleType):
            return self._module(value)
        if isinstance(value, type):
            return self._class(value)
        if isinstance(value, numba_types.Type):
            return str(value), type_content(value)
        if isinstance(value, ir.Type):
            return "IR", repr(value)
        if isinstance(value, np.ufunc):
            return "ufunc", value.__name__
        if callable(value) and _versioned(kind.__module__) and _versioned(getattr(value, "__module__", None) or ""):
            return value.__module__, value.__name__  # built-in or of NumPy
        raise UnknownContent(f"{value!r} of {kind.__module__}.{kind.__qualname__}")

    def _module(self, module: types.ModuleType) -> Content:
        if _versioned(module.__name__) or module in self._modules:
            return "module", module.__name__
        self._modules.append(module)
        names = vars(module)
        return "module", tuple((name, self.content(names[name])) for name in self._names if name in names)

    def _class(self, kind: type) -> Content:
        name = kind.__module__, kind.__qualname__
        if _versioned(kind.__module__):
            return name
        if issubclass(kind, enum.Enum):
            return name, tuple((one, self.content(member.value)) for one, member in kind.__members__.items())
        if issubclass(kind, tuple) and hasattr(kind, "_fields"):
            defaults = kind._field_defaults  # type: ignore[attr-defined]
            return name, kind._fields, tuple((one, self.content(value)) for one, value in defaults.items())
        if issubclass(kind, numba_types.Type):
            file = getattr(sys.modules.get(kind.__module__), "__file__", None)
            if file is not None:  # the whole file, because models of types are registered without names
                return name, hashlib.sha256(Path(file).read_bytes()).hexdigest()
        raise UnknownContent(f"the class {kind.__module__}.{kind.__qualname__}")


def _names(code: types.CodeType) -> set[str]:
    inner = [_names(constant) for constant in code.co_consts if isinstance(constant, types.CodeType)]
    return set(code.co_names).union(*inner)


def _versioned(module: str) -> bool:
    return module.partition(".")[0] in _VERSIONED
