"""Tables of arrays that kernels read."""

from typing import Any, NamedTuple

import numpy as np
import pytest

from pacman_env.engine.arrays import Array, Table


def test_table_refuses_arrays_that_kernels_would_misread() -> None:
    class Pair(NamedTuple):
        first: Any = Array(np.float64, "2 N")
        second: Any = Array(np.int32, "N")

    first, second = np.zeros((2, 4)), np.zeros(4, np.int32)
    assert list(Table(Pair, second=second, first=first).numbers[1:3]) == [2, 4]
    bad = [np.zeros((2, 2), np.float32), np.zeros(2), np.zeros((4, 8))[::2, ::2], np.zeros((4, 2)).T, np.zeros((3, 4))]
    for array in bad:
        with pytest.raises(TypeError, match=r"Pair.first: must be float64 of shape \(2, N\), C-contiguous"):
            Table(Pair, first=array, second=second)
    with pytest.raises(TypeError, match=r"Pair\.second"):
        Table(Pair, first=first, second=second[1:].copy())
    with pytest.raises(TypeError, match=r"missing arrays \['second'\], unknown arrays \['third'\]"):
        Table(Pair, first=first, third=second)
