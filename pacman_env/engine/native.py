"""Operations for kernels beyond Numba's language: memory and functions by address, shared counters, matrix blocks.

Addresses are arguments, never constants, because machine code on disk must not contain them. A code generator gets
Numba's context, an LLVM builder, the types of the call, and its arguments as LLVM values.
"""

import functools
import inspect
import platform
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic

WORD = ir.IntType(64)
_BYTE, _HALF = ir.IntType(8), ir.IntType(32)
_ATOMIC = "seq_cst"
RANGE = (types.int64, types.int64, types.int64)
ROWS, LANES = 6, 16  # size of a block in :func:`multiply_block`, whose sums fit in the registers of a processor


def operation(result: Any, *kinds: Any) -> Callable[[Callable[..., Any]], Any]:
    """Return a decorator for code generators ``(context, builder, signature, *values)`` that lets kernels call them.

    ``result`` is the type of the result or ``types.void``; ``kinds`` are the types of the arguments (None: any).
    """

    def decorate(generate: Callable[..., Any]) -> Any:
        def definition(typing_context, *given):  # type: ignore[no-untyped-def]
            """Return the signature of a call with the types ``given``, and the generator of its code."""

            def code(context, builder, signature, values):  # type: ignore[no-untyped-def]
                """Generate the code of a call; ``values`` are LLVM values."""
                value = generate(context, builder, signature, *values)
                return context.get_dummy_value() if value is None else value

            return result(*(own if kind is None else kind for kind, own in zip(kinds, given, strict=True))), code

        _, *parameters = inspect.signature(generate).parameters.values()  # ``definition`` has one parameter fewer
        definition.__signature__ = inspect.Signature(parameters[1:])  # type: ignore[attr-defined]
        definition.__name__ = definition.__qualname__ = generate.__name__
        definition.__module__ = generate.__module__
        return intrinsic(definition)

    return decorate


def _call(builder, address, kind, arguments):  # type: ignore[no-untyped-def]
    """Generate a call of the function of the LLVM type ``kind`` at ``address``, and return its result."""
    return builder.call(builder.inttoptr(address, kind.as_pointer()), arguments)


@operation(types.void, types.int64, types.int64, types.float64)
def call_step(context, builder, signature, function, handle, seconds):  # type: ignore[no-untyped-def]
    """Call ``void function(void *handle, double seconds)`` by address."""
    _call(builder, function, ir.FunctionType(ir.VoidType(), [WORD, ir.DoubleType()]), [handle, seconds])


@operation(types.void, types.int64, types.int64, types.int64)
def call_pair(context, builder, signature, function, handle, other):  # type: ignore[no-untyped-def]
    """Call ``void function(void *handle, void *other)`` by address."""
    _call(builder, function, ir.FunctionType(ir.VoidType(), [WORD] * 2), [handle, other])


@operation(types.void, types.int64, types.int64, types.int64)
def call_segment(context, builder, signature, function, handle, ends):  # type: ignore[no-untyped-def]
    """Call ``void function(void *handle, cpVect a, cpVect b)`` by address, with the four doubles at ``ends``.

    A cpVect is two doubles; the calling conventions of Linux and macOS pass it like two arguments.
    """
    kind, double = ir.FunctionType(ir.VoidType(), [WORD, *[ir.DoubleType()] * 4]), ir.DoubleType().as_pointer()
    at = builder.inttoptr(ends, double)
    _call(builder, function, kind, [handle, *(builder.load(cgutils.gep_inbounds(builder, at, k)) for k in range(4))])


@operation(types.int64, types.int64, types.int64, types.int64, types.int64)
def call_range(context, builder, signature, function, table, first, last):  # type: ignore[no-untyped-def]
    """Call a kernel ``(table, first, last) -> int64`` by address; return its result, or -1 if it raised an error."""
    # Numba's calling convention: status f(result *, exception **, arguments).
    result = cgutils.alloca_once_value(builder, WORD(-1))
    exceptions = builder.bitcast(cgutils.alloca_once(builder, _BYTE.as_pointer()), _BYTE.as_pointer().as_pointer())
    kind = ir.FunctionType(_HALF, [WORD.as_pointer(), exceptions.type, WORD, WORD, WORD])
    status = _call(builder, function, kind, [result, exceptions, table, first, last])
    return builder.select(builder.icmp_signed("==", status, _HALF(0)), builder.load(result), WORD(-1))


@functools.cache  # Numba looks it up slowly
def address_of_kernel(kernel: Any) -> int:
    """Return the address of a kernel ``(table, first, last) -> int64``, compiled if necessary."""
    if RANGE not in kernel.overloads:
        kernel.compile(RANGE)
    compiled = kernel.overloads[RANGE]
    return int(compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name))


@operation(types.void, types.int64, types.int64)
def store_int(context, builder, signature, address, value):  # type: ignore[no-untyped-def]
    """Write ``value`` to ``address`` as int32."""
    builder.store(builder.trunc(value, _HALF), builder.inttoptr(address, _HALF.as_pointer()))


@operation(types.int64, None)
def address_of(context, builder, signature, array):  # type: ignore[no-untyped-def]
    """Return the address of an array's first element as int64."""
    return builder.ptrtoint(context.make_array(signature.args[0])(context, builder, array).data, WORD)


# Atomic operations on elements of an int64 array


def _element(context, builder, signature, array, index):  # type: ignore[no-untyped-def]
    """Return the pointer to an element of an int64 array."""
    return builder.gep(context.make_array(signature.args[0])(context, builder, array).data, [index])


@operation(types.int64, None, types.int64)
def load(context, builder, signature, array, index):  # type: ignore[no-untyped-def]
    """Read the element ``index`` of an int64 array atomically."""
    return builder.load_atomic(_element(context, builder, signature, array, index), _ATOMIC, 8)


@operation(types.void, None, types.int64, types.int64)
def store(context, builder, signature, array, index, value):  # type: ignore[no-untyped-def]
    """Write ``value`` to the element ``index`` of an int64 array atomically."""
    builder.store_atomic(value, _element(context, builder, signature, array, index), _ATOMIC, 8)


@operation(types.int64, None, types.int64, types.int64)
def fetch_add(context, builder, signature, array, index, value):  # type: ignore[no-untyped-def]
    """Add ``value`` to an element of an int64 array and return its old value."""
    return builder.atomic_rmw("add", _element(context, builder, signature, array, index), value, _ATOMIC)


@operation(types.int64, None, types.int64, types.int64)
def fetch_max(context, builder, signature, array, index, value):  # type: ignore[no-untyped-def]
    """Raise an element of an int64 array to at least ``value`` and return its old value."""
    return builder.atomic_rmw("max", _element(context, builder, signature, array, index), value, _ATOMIC)


@operation(types.boolean, None, types.int64, types.int64, types.int64)
def replace(context, builder, signature, array, index, expected, value):  # type: ignore[no-untyped-def]
    """Write ``value`` to an element and return True if its old value was ``expected``; otherwise return False."""
    element = _element(context, builder, signature, array, index)
    return builder.extract_value(builder.cmpxchg(element, expected, value, ordering=_ATOMIC), 1)


_HAS_PAUSE = platform.machine() in ("x86_64", "AMD64")


@operation(types.void)
def pause(context, builder, signature):  # type: ignore[no-untyped-def]
    """Let the processor save power while a thread waits in a loop (only on x86)."""
    if _HAS_PAUSE:
        kind = ir.FunctionType(ir.VoidType(), [])
        builder.call(cgutils.get_or_insert_function(builder.module, kind, "llvm.x86.sse2.pause"), [])


@operation(types.void, None, types.float32, types.int64, types.int64)
def multiply_block(context, builder, signature, arrays, least, row, column):  # type: ignore[no-untyped-def]
    """Write ``max(start[which] + inputs @ weight, least)`` to a block of ``out`` from row and column on.

    ``arrays`` are C-contiguous: inputs, weight, start and out (float32 matrices), and which (int64, one for each row).
    Products are added in order, with one rounding (fma): other rows and the processor do not change the bits.
    """
    real, vector = ir.FloatType(), ir.VectorType(ir.FloatType(), LANES)
    fma = cgutils.get_or_insert_function(builder.module, ir.FunctionType(vector, [vector] * 3), f"llvm.fma.v{LANES}f32")
    inputs, weight, start, out, which = (
        context.make_array(kind)(context, builder, builder.extract_value(arrays, k))
        for k, kind in enumerate(signature.args[0])
    )

    def at(matrix, row, column, kind=vector):  # type: ignore[no-untyped-def]
        """Return a pointer to the numbers of a row from a column on: one number, or ``LANES``."""
        index = builder.add(builder.mul(row, builder.extract_value(matrix.shape, 1)), column)
        return builder.bitcast(builder.gep(matrix.data, [index]), kind.as_pointer())

    def repeated(value):  # type: ignore[no-untyped-def]
        """Return a vector of ``LANES`` copies of a number."""
        one = builder.insert_element(vector(ir.Undefined), value, WORD(0))
        return builder.shuffle_vector(one, one, ir.VectorType(_HALF, LANES)(None))

    last, bound = builder.sub(builder.extract_value(out.shape, 0), WORD(1)), repeated(least)
    rows = [builder.add(row, WORD(k)) for k in range(ROWS)]
    rows = [builder.select(builder.icmp_signed("<", own, last), own, last) for own in rows]
    starts = [at(start, builder.load(builder.gep(which.data, [own])), column) for own in rows]
    sums = [cgutils.alloca_once_value(builder, builder.load(place, align=4)) for place in starts]
    with cgutils.for_range(builder, builder.extract_value(weight.shape, 0)) as loop:
        weights = builder.load(at(weight, loop.index, column), align=4)
        for own, total in zip(rows, sums, strict=True):
            value = repeated(builder.load(at(inputs, own, loop.index, real)))
            builder.store(builder.call(fma, [value, weights, builder.load(total)]), total)
    for own, total in zip(rows, map(builder.load, sums), strict=True):
        value = builder.select(builder.fcmp_ordered("<", total, bound), bound, total)  # NaN stays
        builder.store(value, at(out, own, column), align=4)
