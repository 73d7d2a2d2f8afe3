"""What is added to Numba here."""

from __future__ import annotations

import numpy as np
import pytest

from pacman_env.jit import kernel, prefetch


@kernel
def _ask_for_all(array, beyond):  # type: ignore[no-untyped-def]
    total = 0
    for k in range(-beyond, len(array) + beyond):
        prefetch(array, k)
    for k in range(len(array)):
        total += array[k, 0]
    return total


@pytest.mark.parametrize("beyond", [0, 10**6])
def test_asking_for_memory_changes_nothing_and_never_fails(beyond: int) -> None:
    array = np.arange(12, dtype=np.uint8).reshape(4, 3)
    assert _ask_for_all(array, beyond) == 0 + 3 + 6 + 9
    np.testing.assert_array_equal(array.ravel(), np.arange(12))
