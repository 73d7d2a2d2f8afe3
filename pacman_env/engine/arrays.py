"""Pass many arrays to kernels by one address: tables of arrays, declared by named tuples."""

import functools
import itertools
from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

import numpy as np
from numba.core import cgutils, types
from numba.np import numpy_support
from numba.np.arrayobj import populate_array
from numpy.typing import NDArray

from .native import WORD, operation


class Array(NamedTuple):
    """Declaration of a C-contiguous array, used as the default of a field in a named tuple.

    The default of a field may also be another named tuple of arrays.
    """

    dtype: Any
    shape: str  # axes: numbers, upper-case names (same length within a table), lower-case names (any length)


class Declared(NamedTuple):
    dtype: np.dtype[Any]
    axes: tuple[int | str, ...]


@functools.cache
def declared(kind: type[tuple[Any, ...]]) -> dict[str, Declared]:
    """Return dtype and axes of a named tuple's arrays by name; a nested array has the name ``tuple.array``.

    Raises TypeError for a field without a declaration.
    """
    arrays: dict[str, Declared] = {}
    defaults = kind._field_defaults  # type: ignore[attr-defined]
    for name in kind._fields:  # type: ignore[attr-defined]
        value = defaults.get(name)
        if isinstance(value, Array):
            axes = tuple(int(axis) if axis.isdigit() else axis for axis in value.shape.split())
            arrays[name] = Declared(np.dtype(value.dtype), axes)
        elif isinstance(value, type) and issubclass(value, tuple):
            arrays |= {f"{name}.{inner}": array for inner, array in declared(value).items()}
        else:
            raise TypeError(f"{kind.__name__}.{name}: must be declared as an Array")
    return arrays


def _numba_type(kind: type[tuple[Any, ...]]) -> Any:
    own, defaults = declared(kind), kind._field_defaults  # type: ignore[attr-defined]
    kinds = [
        types.Array(numpy_support.from_dtype(own[name].dtype), len(own[name].axes), "C")
        if name in own
        else _numba_type(defaults[name])
        for name in kind._fields  # type: ignore[attr-defined]
    ]
    return types.NamedTuple(kinds, kind)  # type: ignore[attr-defined]


def address(array: NDArray[Any]) -> int:
    return array.ctypes.data  # works for records, too, and is faster than __array_interface__


def _flat(arrays: Iterable[Any]) -> list[NDArray[Any]]:
    flat: list[NDArray[Any]] = []
    for one in arrays:
        flat += _flat(one) if isinstance(one, tuple) else [one]
    return flat


@functools.lru_cache(maxsize=256)
def _check(kind: type[tuple[Any, ...]], given: tuple[tuple[np.dtype[Any], tuple[int, ...], bool], ...]) -> None:
    """Raise TypeError unless the dtypes, shapes and C-contiguity ``given`` for each array are as declared."""
    lengths: dict[Any, int] = {}
    for (name, (dtype, axes)), (own, shape, contiguous) in zip(declared(kind).items(), given, strict=True):
        # Axes of any length get unique names, because their lengths may differ.
        keys = [(name, k) if str(axis).islower() else axis for k, axis in enumerate(axes)]
        lengths.update({axis: axis for axis in axes if isinstance(axis, int)})
        fits = len(shape) == len(keys) and tuple(map(lengths.setdefault, keys, shape)) == shape
        if not fits or own != dtype or not contiguous:
            expected = f"{dtype} of shape ({', '.join(map(str, axes))}), C-contiguous"
            raise TypeError(f"{kind.__name__}.{name}: must be {expected}, not {own} of shape {shape}")


class Table:
    """Addresses and shapes of ``arrays``, stored in sequence at an ``address``, for :func:`arrays_by_address`."""

    _memory: tuple[type[tuple[Any, ...]], NDArray[np.int64], NDArray[np.uint8]]  # arguments of ``of_memory``

    def __init__(self, kind: type[tuple[Any, ...]], /, **arrays: Any) -> None:
        """Check the arrays and store their addresses. Raises TypeError if they differ from the declaration ``kind``."""
        fields = kind._fields  # type: ignore[attr-defined]
        if set(fields) != arrays.keys():
            missing, unknown = sorted(set(fields) - arrays.keys()), sorted(arrays.keys() - set(fields))
            raise TypeError(f"{kind.__name__}: missing arrays {missing}, unknown arrays {unknown}")
        self.__dict__["arrays"] = arrays
        flat = [arrays[name] for name in fields]
        if len(declared(kind)) > len(fields):  # with nested tuples
            flat = _flat(flat)
        _check(kind, tuple([(array.dtype, array.shape, array.flags.c_contiguous) for array in flat]))
        numbers: list[int] = []
        for array in flat:  # like ``address``, without a call for each array: a robot does this at each decision
            numbers += [array.__array_interface__["data"][0], *array.shape]
        self.numbers = np.array(numbers, dtype=np.int64)
        self.address = address(self.numbers)

    @classmethod
    def of_memory(cls, kind: type[tuple[Any, ...]], numbers: NDArray[np.int64], memory: NDArray[np.uint8]) -> "Table":
        """Create a table of arrays in ``memory`` from a table's ``numbers`` with byte offsets as addresses."""
        table = cls.__new__(cls)
        table._memory = kind, numbers, memory
        table.numbers = numbers.copy()
        table.numbers[list(_places(kind).values())] += address(memory)
        table.address = address(table.numbers)
        return table

    @functools.cached_property
    def arrays(self) -> dict[str, Any]:
        """Arrays by name."""
        return {name: self.array(name) for name in declared(self._memory[0])}

    def array(self, name: str) -> NDArray[Any]:
        if "arrays" in self.__dict__:
            return self.arrays[name]
        kind, numbers, memory = self._memory
        dtype, axes = declared(kind)[name]
        offset, *shape = numbers[(at := _places(kind)[name]) : at + 1 + len(axes)].tolist()
        return np.ndarray(shape, dtype, memory, offset)


@functools.cache
def _places(kind: type[tuple[Any, ...]]) -> dict[str, int]:
    """Return for each array, by name, the index of its address in a table's numbers."""
    sizes = [1 + len(axes) for _, axes in declared(kind).values()]
    return dict(zip(declared(kind), np.cumsum([0, *sizes[:-1]]).tolist(), strict=True))


def zeros(kind: type[tuple[Any, ...]], names: Iterable[str], **lengths: int) -> dict[str, NDArray[Any]]:
    return {
        name: np.zeros([axis if isinstance(axis, int) else lengths[axis] for axis in axes], dtype)
        for name, (dtype, axes) in ((name, declared(kind)[name]) for name in names)
    }


def _array_at(context, builder, kind, at, shape):  # type: ignore[no-untyped-def]
    """Generate the C-contiguous array of the Numba type ``kind`` at the address ``at``; ``shape`` are LLVM integers."""
    size = WORD(context.get_abi_sizeof(context.get_data_type(kind.dtype)))
    strides: list[Any] = []
    step = size
    for length in reversed(shape):
        strides.insert(0, step)
        step = builder.mul(step, length)
    array = context.make_array(kind)(context, builder)
    data = builder.inttoptr(at, context.get_data_type(kind.dtype).as_pointer())
    populate_array(array, data=data, shape=shape, strides=strides, itemsize=size, meminfo=None)
    return array._getvalue()


def arrays_by_address(kind: type[tuple[Any, ...]]) -> Callable[[int], Any]:
    """Return a function for kernels that takes a :class:`Table`'s address and returns the tuple of its arrays.

    A call of this function from Python is slow.
    """
    tuple_type = _numba_type(kind)

    @operation(tuple_type, types.int64)
    def arrays(context, builder, signature, address):  # type: ignore[no-untyped-def]
        """Generate code that reads a :class:`Table` at ``address`` (int64) and returns its arrays as a tuple."""
        at, places = builder.inttoptr(address, WORD.as_pointer()), itertools.count()

        def number():  # type: ignore[no-untyped-def]
            """Generate code that loads the table's next number."""
            return builder.load(cgutils.gep_inbounds(builder, at, next(places)))

        def generated(kind):  # type: ignore[no-untyped-def]
            """Generate code that reads an array, or a tuple of arrays, of the Numba type ``kind``."""
            if isinstance(kind, types.BaseTuple):  # type: ignore[attr-defined]
                return context.make_tuple(builder, kind, [generated(inner) for inner in kind])
            return _array_at(context, builder, kind, number(), [number() for _ in range(kind.ndim)])

        return generated(tuple_type)

    return arrays


def _vector_at(scalar: Any) -> Callable[[int, int], Any]:
    """Return a function for kernels that takes an address and a length and returns an array of ``scalar``."""
    array_type = types.Array(scalar, 1, "C")

    @operation(array_type, types.int64, None)
    def vector_at(context, builder, signature, address, length):  # type: ignore[no-untyped-def]
        """Generate code that returns the array (``length``,) at ``address`` (int64)."""
        count = context.cast(builder, length, signature.args[1], types.int64)
        return _array_at(context, builder, array_type, address, [count])

    return vector_at


reals_at, floats_at, bytes_at = (_vector_at(scalar) for scalar in (types.float64, types.float32, types.int8))
