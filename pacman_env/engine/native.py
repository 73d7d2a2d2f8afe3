"""What kernels need beyond Numba's language: arrays by address, functions by address, counters that threads share.

Addresses are arguments, never constants: Numba cannot keep machine code on disk that holds one.
"""

from __future__ import annotations

import functools
import platform
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic
from numba.np import numpy_support
from numba.np.arrayobj import populate_array
from numpy.typing import NDArray

_WORD = ir.IntType(64)
_REAL = ir.DoubleType()


def address(array: NDArray[Any]) -> int:
    """Where an array lies."""
    return array.ctypes.data  # of records, too, a fifth of what __array_interface__ takes


def array_at(context, builder, kind, at, shape):  # type: ignore[no-untyped-def]
    """Code for a C-contiguous array of a type of Numba's, of a shape, that lies at an address."""
    size = _WORD(context.get_abi_sizeof(context.get_data_type(kind.dtype)))
    strides: list[Any] = []
    step = size
    for length in reversed(shape):
        strides.insert(0, step)
        step = builder.mul(step, length)
    array = context.make_array(kind)(context, builder)
    data = builder.inttoptr(at, context.get_data_type(kind.dtype).as_pointer())
    populate_array(array, data=data, shape=shape, strides=strides, itemsize=size, meminfo=None)
    return array._getvalue()


class Array(NamedTuple):
    """One array of a table or a block, as the default of a field of a named tuple: C-contiguous."""

    dtype: Any
    shape: str  # its axes: a number; N: a length that is the same within the table; k: any length


@functools.cache
def declared(arrays: type[tuple[Any, ...]]) -> dict[str, tuple[np.dtype[Any], tuple[int | str, ...]]]:
    """dtype and axes of each :class:`Array` of a named tuple, by name.

    Raises:
        TypeError: a field is none.
    """
    found: dict[str, tuple[np.dtype[Any], tuple[int | str, ...]]] = {}
    defaults = arrays._field_defaults  # type: ignore[attr-defined]
    for name in arrays._fields:  # type: ignore[attr-defined]
        if not isinstance(array := defaults.get(name), Array):
            raise TypeError(f"{arrays.__name__}.{name}: must be declared as an Array")
        axes = tuple(int(axis) if axis.isdigit() else axis for axis in array.shape.split())
        found[name] = np.dtype(array.dtype), axes
    return found


def named_tuple_type(arrays: type[tuple[Any, ...]]) -> Any:
    """Numba's type of a named tuple of arrays."""
    kinds = [types.Array(numpy_support.from_dtype(dtype), len(axes), "C") for dtype, axes in declared(arrays).values()]
    return types.NamedTuple(kinds, arrays)  # type: ignore[attr-defined]


@functools.cache
def _checks(arrays: type[tuple[Any, ...]]) -> tuple[list[Any], dict[Any, int]]:
    """Name, dtype, axes of each array, where an axis of any length has a name of its own; the axes that are numbers."""
    checks = [
        (name, dtype, tuple((name, k) if str(axis).islower() else axis for k, axis in enumerate(axes)))
        for name, (dtype, axes) in declared(arrays).items()
    ]
    return checks, {axis: axis for _, _, axes in checks for axis in axes if isinstance(axis, int)}


class Table:
    """Addresses and shapes of arrays, one after the other, for :func:`arrays_by_address`.

    Attributes:
        arrays: by name; kept as long as the table is.
        address: of the numbers, for kernels.
    """

    def __init__(self, kind: type[tuple[Any, ...]], **arrays: NDArray[Any]) -> None:
        """A table of the arrays that the named tuple ``kind`` declares.

        Raises:
            TypeError: a name is missing or unknown; an array has another dtype or shape, or is not C-contiguous.
        """
        fields = declared(kind)
        if fields.keys() != arrays.keys():
            missing, unknown = sorted(fields.keys() - arrays.keys()), sorted(arrays.keys() - fields.keys())
            raise TypeError(f"{kind.__name__}: missing arrays {missing}, unknown arrays {unknown}")
        self.arrays = arrays
        numbers: list[int] = []
        checks, fixed = _checks(kind)
        lengths = dict(fixed)
        for name, dtype, axes in checks:
            array = arrays[name]
            shape = array.shape
            fits = len(shape) == len(axes) and tuple(map(lengths.setdefault, axes, shape)) == shape
            if not fits or array.dtype != dtype or not array.flags.c_contiguous:
                wanted = f"{dtype} of shape ({', '.join(map(str, fields[name][1]))}), C-contiguous"
                raise TypeError(f"{kind.__name__}.{name}: must be {wanted}, not {array.dtype} of shape {shape}")
            numbers += [address(array), *shape]
        self.numbers = np.array(numbers, dtype=np.int64)
        self.address = address(self.numbers)


def zeros(kind: type[tuple[Any, ...]], names: Iterable[str], **lengths: int) -> dict[str, NDArray[Any]]:
    """Some of the arrays that a named tuple declares, by name."""
    fields = declared(kind)
    return {
        name: np.zeros([axis if isinstance(axis, int) else lengths[axis] for axis in axes], dtype)
        for name, (dtype, axes) in ((name, fields[name]) for name in names)
    }


def arrays_by_address(kind: type[tuple[Any, ...]]) -> Callable[[int], Any]:
    """A function for kernels: from the address of a :class:`Table` to the named tuple ``kind`` of its arrays.

    The tuple is made in the kernel, where it costs nothing; to pass one from Python takes 16 us and more.
    """
    made = named_tuple_type(kind)

    @intrinsic
    def arrays(typing_context, address):  # type: ignore[no-untyped-def]
        del typing_context

        def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
            at = builder.inttoptr(arguments[0], _WORD.as_pointer())
            made_here = []
            place = 0
            for kind in made.types:
                numbers = [builder.load(cgutils.gep_inbounds(builder, at, place + k)) for k in range(1 + kind.ndim)]
                place += len(numbers)
                made_here.append(array_at(context, builder, kind, numbers[0], numbers[1:]))
            return context.make_tuple(builder, signature.return_type, made_here)

        return made(types.int64), generate

    return arrays


@intrinsic
def array_by_address(typing_context, address, length):  # type: ignore[no-untyped-def]
    """So many float64 that lie at an address."""
    del typing_context
    kind = types.Array(types.float64, 1, "C")

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        count = context.cast(builder, arguments[1], signature.args[1], types.int64)
        return array_at(context, builder, kind, arguments[0], [count])

    return kind(types.int64, length), generate


def _call(builder, address, kind, arguments):  # type: ignore[no-untyped-def]
    return builder.call(builder.inttoptr(address, kind.as_pointer()), arguments)


@intrinsic
def call_step(typing_context, function, handle, seconds):  # type: ignore[no-untyped-def]
    """``void function(void *handle, double seconds)`` by its address."""
    del typing_context

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        del signature
        _call(builder, arguments[0], ir.FunctionType(ir.VoidType(), [_WORD, _REAL]), arguments[1:])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.float64), generate


@intrinsic
def call_each(typing_context, function, handle, visit, data):  # type: ignore[no-untyped-def]
    """``void function(void *handle, void *visit, void *data)`` by its address."""
    del typing_context

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        del signature
        _call(builder, arguments[0], ir.FunctionType(ir.VoidType(), [_WORD] * 3), arguments[1:])
        return context.get_dummy_value()

    return types.void(types.int64, types.int64, types.int64, types.int64), generate


@intrinsic
def store_int(typing_context, address, value):  # type: ignore[no-untyped-def]
    """Write a 32-bit number at an address."""
    del typing_context

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        del signature
        at = builder.inttoptr(arguments[0], ir.IntType(32).as_pointer())
        builder.store(builder.trunc(arguments[1], ir.IntType(32)), at)
        return context.get_dummy_value()

    return types.void(types.int64, types.int64), generate


@intrinsic
def address_of(typing_context, array):  # type: ignore[no-untyped-def]
    """The address of an array's first element."""
    del typing_context

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        view = context.make_array(signature.args[0])(context, builder, arguments[0])
        return builder.ptrtoint(view.data, _WORD)

    return types.int64(array), generate


@intrinsic
def call_range(typing_context, function, table, first, last):  # type: ignore[no-untyped-def]
    """Call a kernel ``(table, first, last) -> int64`` by its address (:func:`address_of_kernel`).

    Returns what it returns, or -1 if it raised.
    """
    del typing_context

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        # Numba's own convention: status f(result *, exception **, arguments).
        result = cgutils.alloca_once_value(builder, _WORD(-1))
        exception = cgutils.alloca_once(builder, ir.IntType(8).as_pointer())
        exceptions = builder.bitcast(exception, ir.IntType(8).as_pointer().as_pointer())
        kind = ir.FunctionType(ir.IntType(32), [_WORD.as_pointer(), exceptions.type, _WORD, _WORD, _WORD])
        status = _call(builder, arguments[0], kind, [result, exceptions, *arguments[1:]])
        return builder.select(builder.icmp_signed("==", status, ir.IntType(32)(0)), builder.load(result), _WORD(-1))

    return types.int64(types.int64, types.int64, types.int64, types.int64), generate


RANGE = (types.int64, types.int64, types.int64)


@functools.cache  # to ask Numba takes as long as a hundred games' decisions
def address_of_kernel(kernel: Any) -> int:
    """Where the machine code of a kernel ``(table, first, last) -> int64`` lies; compiles it if need be."""
    if RANGE not in kernel.overloads:
        kernel.compile(RANGE)
    compiled = kernel.overloads[RANGE]
    return int(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name))


def _element(context, builder, array_type, array, index):  # type: ignore[no-untyped-def]
    view = context.make_array(array_type)(context, builder, array)
    return builder.gep(view.data, [index])


def _fetching(operation: str) -> Any:
    """``(array, index, value)``: change an element of an int64 array that threads share; it returns what it was."""

    @intrinsic
    def fetch(typing_context, array, index, value):  # type: ignore[no-untyped-def]
        del typing_context

        def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
            at = _element(context, builder, signature.args[0], *arguments[:2])
            return builder.atomic_rmw(operation, at, arguments[2], "seq_cst")

        return types.int64(array, types.int64, types.int64), generate

    return fetch


fetch_add, fetch_max = _fetching("add"), _fetching("max")


@intrinsic
def load(typing_context, array, index):  # type: ignore[no-untyped-def]
    """Read an element of an int64 array that threads share."""
    del typing_context

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        at = _element(context, builder, signature.args[0], *arguments)
        return builder.load_atomic(at, "seq_cst", 8)

    return types.int64(array, types.int64), generate


@intrinsic
def store(typing_context, array, index, value):  # type: ignore[no-untyped-def]
    """Write an element of an int64 array that threads share."""
    del typing_context

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        at = _element(context, builder, signature.args[0], *arguments[:2])
        builder.store_atomic(arguments[2], at, "seq_cst", 8)
        return context.get_dummy_value()

    return types.void(array, types.int64, types.int64), generate


@intrinsic
def replace(typing_context, array, index, expected, value):  # type: ignore[no-untyped-def]
    """Write an element of an int64 array that threads share if it is as expected; returns whether it was."""
    del typing_context

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        at = _element(context, builder, signature.args[0], *arguments[:2])
        return builder.extract_value(builder.cmpxchg(at, *arguments[2:], ordering="seq_cst"), 1)

    return types.boolean(array, types.int64, types.int64, types.int64), generate


_HAS_PAUSE = platform.machine() in ("x86_64", "AMD64")


@intrinsic
def pause(typing_context):  # type: ignore[no-untyped-def]
    """Tell the processor that a loop only waits."""
    del typing_context

    def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
        del signature, arguments
        if _HAS_PAUSE:
            kind = ir.FunctionType(ir.VoidType(), [])
            builder.call(cgutils.get_or_insert_function(builder.module, kind, "llvm.x86.sse2.pause"), [])
        return context.get_dummy_value()

    return types.void(), generate
