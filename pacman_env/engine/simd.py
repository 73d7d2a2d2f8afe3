"""Vector operations on rows of single-precision numbers, with the same bits as operations on single numbers.

Plain loops are slower (``benchmarks/history.md``).
"""

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import models, register_model

from .native import operation

WIDTH = 24  # numbers per row: three vectors of AVX2, two of AVX-512
_ROW = ir.VectorType(ir.FloatType(), WIDTH)
_INT = ir.IntType(32)


class RowType(types.Type):
    def __init__(self) -> None:
        super().__init__(name=f"Row({WIDTH})")


ROW = RowType()


@register_model(RowType)
class _Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _ROW)


def _place(context, builder, signature, array, index):  # type: ignore[no-untyped-def]
    """Return the pointer to the row that begins at element ``index`` of a float32 array."""
    view = context.make_array(signature.args[0])(context, builder, array)
    at = builder.gep(view.data, [context.cast(builder, index, signature.args[1], types.intp)])
    return builder.bitcast(at, _ROW.as_pointer())


@operation(ROW, None, None)
def load(context, builder, signature, array, index):  # type: ignore[no-untyped-def]
    """Read the row that begins at element ``index`` of a float32 array."""
    return builder.load(_place(context, builder, signature, array, index), align=4)


@operation(types.void, None, None, ROW)
def store(context, builder, signature, array, index, row):  # type: ignore[no-untyped-def]
    """Write a row to the elements of a float32 array that begin at ``index``."""
    builder.store(row, _place(context, builder, signature, array, index), align=4)


@operation(ROW, None)
def all_of(context, builder, signature, number):  # type: ignore[no-untyped-def]
    """Return a row whose elements are all ``number``."""
    number = context.cast(builder, number, signature.args[0], types.float32)
    first = builder.insert_element(ir.Constant(_ROW, ir.Undefined), number, ir.Constant(_INT, 0))
    everywhere = ir.Constant(ir.VectorType(_INT, WIDTH), [0] * WIDTH)
    return builder.shuffle_vector(first, ir.Constant(_ROW, ir.Undefined), everywhere)


@operation(ROW, ROW, ROW)
def plus(context, builder, signature, a, b):  # type: ignore[no-untyped-def]
    """Return a + b, element by element."""
    return builder.fadd(a, b)


@operation(ROW, ROW, ROW)
def minus(context, builder, signature, a, b):  # type: ignore[no-untyped-def]
    """Return a - b, element by element."""
    return builder.fsub(a, b)


@operation(ROW, ROW, ROW)
def times(context, builder, signature, a, b):  # type: ignore[no-untyped-def]
    """Return a * b, element by element."""
    return builder.fmul(a, b)


@operation(ROW, ROW, ROW)
def lower(context, builder, signature, a, b):  # type: ignore[no-untyped-def]
    """Return the element-wise minimum; ``b`` if one of the two is NaN."""
    return builder.select(builder.fcmp_ordered("<", a, b), a, b)


@operation(ROW, ROW, ROW, ROW)
def where_below(context, builder, signature, row, limits, chosen):  # type: ignore[no-untyped-def]
    """Return a row with the elements of ``chosen`` where ``row`` is below ``limits``, and 0 elsewhere."""
    return builder.select(builder.fcmp_ordered("<", row, limits), chosen, ir.Constant(_ROW, [0.0] * WIDTH))


@operation(ROW, ROW)
def roots(context, builder, signature, row):  # type: ignore[no-untyped-def]
    """Return the square roots of a row."""
    kind = ir.FunctionType(_ROW, [_ROW])
    return builder.call(cgutils.get_or_insert_function(builder.module, kind, f"llvm.sqrt.v{WIDTH}f32"), [row])
