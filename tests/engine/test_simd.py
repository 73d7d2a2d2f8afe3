"""Rows of numbers: each operation is that of NumPy on single-precision numbers, to the last bit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from pacman_env.engine import simd
from pacman_env.engine.jit import kernel
from pacman_env.engine.simd import WIDTH

OPERATIONS = {
    "plus": lambda a, b, c: a + b,
    "minus": lambda a, b, c: a - b,
    "times": lambda a, b, c: a * b,
    "lower": lambda a, b, c: np.where(a < b, a, b),
    "where_below": lambda a, b, c: np.where(a < b, c, np.float32(0.0)),
    "roots": lambda a, b, c: np.sqrt(a),
}
ROWS = arrays.arrays(np.float32, (3, WIDTH + 5), elements=st.floats(-(2.0**59), 2.0**59, width=32))


@kernel
def _all(rows, first, out):  # type: ignore[no-untyped-def]
    """Each operation on three rows that begin at ``first``, one result after the other."""
    a, b, c = simd.load(rows[0], first), simd.load(rows[1], first), simd.load(rows[2], first)
    simd.store(out, 0, simd.plus(a, b))
    simd.store(out, WIDTH, simd.minus(a, b))
    simd.store(out, 2 * WIDTH, simd.times(a, b))
    simd.store(out, 3 * WIDTH, simd.lower(a, b))
    simd.store(out, 4 * WIDTH, simd.where_below(a, b, c))
    simd.store(out, 5 * WIDTH, simd.roots(a))


@kernel
def _same(number, out):  # type: ignore[no-untyped-def]
    row = simd.all_of(number)
    for _ in range(3):  # a row is a variable like others
        row = simd.plus(row, simd.all_of(1))
    simd.store(out, 0, row)


@settings(max_examples=60, deadline=None)
@given(rows=ROWS, first=st.integers(0, 5))
def test_row_operations_equal_numpys(rows: np.ndarray, first: int) -> None:
    out = np.zeros(len(OPERATIONS) * WIDTH, np.float32)
    _all(rows, first, out)
    parts = rows[:, first : first + WIDTH]
    with np.errstate(all="ignore"):
        for name, found in zip(OPERATIONS, out.reshape(-1, WIDTH), strict=True):
            wanted = OPERATIONS[name](*parts)
            np.testing.assert_array_equal(found, wanted, err_msg=name)


@pytest.mark.parametrize("number", [0.1, 7])
def test_row_of_one_number_fills_its_width(number: float) -> None:
    out = np.zeros(WIDTH + 1, np.float32)
    _same(number, out)
    assert (out[:WIDTH] == np.float32(np.float32(number) + np.float32(1)) + np.float32(2)).all()
    assert out[WIDTH] == 0  # nothing is written beyond
