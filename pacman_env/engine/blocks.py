"""Arrays that lie one behind the other in one block of memory, so that a kernel needs one address for all of them."""

from __future__ import annotations

import functools
from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from .native import array_at, declared, named_tuple_type

LENGTHS = "N", "C", "G"  # that a block is made for: games, candidates, ghosts
_ALIGNMENT = 8
_WORD = ir.IntType(64)


class Layout:
    """Where the arrays lie that a named tuple declares (``native.Array``).

    Attributes:
        arrays: for kernels: from a block's address and the three lengths to the named tuple of its arrays.
    """

    def __init__(self, kind: type[tuple[Any, ...]]) -> None:
        self.fields = declared(kind)
        self.arrays = _arrays_of(named_tuple_type(kind), tuple(self.fields.values()))
        self.places = functools.lru_cache(maxsize=64)(self._places)

    def _places(self, *lengths: int) -> tuple[dict[str, tuple[np.dtype[Any], tuple[int, ...], int]], int]:
        """dtype, shape and offset of each array, and the bytes of all."""
        known = dict(zip(LENGTHS, lengths, strict=True))
        places, at = {}, 0
        for name, (dtype, axes) in self.fields.items():
            shape = tuple(axis if isinstance(axis, int) else known[axis] for axis in axes)
            places[name] = dtype, shape, at
            at += -(-int(np.prod(shape)) * dtype.itemsize // _ALIGNMENT) * _ALIGNMENT
        return places, at

    def new(self, *lengths: int) -> NDArray[np.uint8]:
        """A block with whatever was in the memory before."""
        return np.empty(max(self.places(*lengths)[1], 1), dtype=np.uint8)

    def view(self, block: NDArray[np.uint8], name: str, *lengths: int) -> NDArray[Any]:
        """One of a block's arrays."""
        dtype, shape, at = self.places(*lengths)[0][name]
        return np.ndarray(shape, dtype, block, at)

    def views(self, block: NDArray[np.uint8], *lengths: int) -> dict[str, NDArray[Any]]:
        """All of them."""
        places, _ = self.places(*lengths)
        return {name: np.ndarray(shape, dtype, block, at) for name, (dtype, shape, at) in places.items()}


def _arrays_of(made: Any, fields: tuple[tuple[np.dtype[Any], tuple[int | str, ...]], ...]) -> Any:
    @intrinsic
    def arrays(typing_context, block, n, candidates, ghosts):  # type: ignore[no-untyped-def]
        del typing_context

        def generate(context, builder, signature, arguments):  # type: ignore[no-untyped-def]
            block, *lengths = arguments
            known = dict(zip(LENGTHS, lengths, strict=True))
            made_here, at = [], block
            for kind, (dtype, axes) in zip(made.types, fields, strict=True):
                shape = [_WORD(axis) if isinstance(axis, int) else known[axis] for axis in axes]
                made_here.append(array_at(context, builder, kind, at, shape))
                size = functools.reduce(builder.mul, shape, _WORD(dtype.itemsize))
                up = builder.add(size, _WORD(_ALIGNMENT - 1))
                at = builder.add(at, builder.and_(up, _WORD(-_ALIGNMENT)))
            return context.make_tuple(builder, signature.return_type, made_here)

        return made(*[types.int64] * 4), generate

    return arrays
