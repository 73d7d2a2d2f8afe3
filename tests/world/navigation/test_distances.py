"""Distances, nearest numbers and parts of small pictures, against what trying everything gives."""

from __future__ import annotations

import numpy as np
import pytest

from pacman_env.world.navigation.grid import clearance_m, connected_parts, nearest_numbers


def drawn(seed: int, share: float) -> np.ndarray:
    return np.random.default_rng(seed).random((14, 17)) < share


@pytest.mark.parametrize("seed", range(3))
def test_clearance_is_the_exact_distance_to_the_nearest_cell_that_is_not_free(seed: int) -> None:
    free = drawn(seed, 0.95)
    r, c = np.nonzero(~free)
    rows, columns = np.indices(free.shape)
    square = ((rows[..., None] - r) ** 2 + (columns[..., None] - c) ** 2).min(axis=-1)
    np.testing.assert_array_equal(clearance_m(free, 0.05), (np.sqrt(square) * 0.05).astype(np.float32))


@pytest.mark.parametrize("seed", range(3))
def test_each_pixel_has_one_of_the_numbers_about_as_near_as_any(seed: int) -> None:
    number = np.where(drawn(seed, 0.05), np.random.default_rng(seed).permutation(14 * 17).reshape(14, 17), -1)
    found, away = nearest_numbers(number.astype(np.int32))
    place = {int(number[r, c]): (r, c) for r, c in zip(*np.nonzero(number >= 0), strict=True)}
    for r, c in np.ndindex(*number.shape):
        least = min(np.hypot(r - y, c - x) for y, x in place.values())
        y, x = place[int(found[r, c])]
        assert np.hypot(r - y, c - x) <= 1.03 * least + 1e-9
        assert away[r, c] == pytest.approx(least, rel=0.03)


@pytest.mark.parametrize("share", [0.0, 0.6, 1.0])
def test_parts_are_numbered_from_one_and_measured(share: float) -> None:
    mask = drawn(0, share)
    labels, areas = connected_parts(mask)
    np.testing.assert_array_equal(labels > 0, mask)
    assert areas[0] == 0
    assert areas.tolist()[1:] == [int((labels == k).sum()) for k in range(1, len(areas))]
    for k in (0, 1):  # what is beside one another is one part
        beside = np.roll(labels, -1, axis=k)
        inside = (labels > 0) & (beside > 0)
        inside[(-1, slice(None)) if k == 0 else (slice(None), -1)] = False
        np.testing.assert_array_equal(labels[inside], beside[inside])
