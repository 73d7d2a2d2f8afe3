from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from pacman_env.config import PelletConfig
from pacman_env.game.pellets import generate_pellets


@dataclass(frozen=True)
class GreyMap:
    """The smallest map that has pellets."""

    grey: NDArray[np.uint8]
    resolution: float = 0.1
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def game_free(self, free_grey: int) -> NDArray[np.bool_]:
        return self.grey > free_grey


def brute_force(map: GreyMap, config: PelletConfig) -> list[tuple[int, int]]:
    """Algorithm 1 as the document writes it, one candidate at a time."""
    height, width = map.grey.shape
    step, clearance = (round(config.spacing_m / map.resolution), round(config.wall_clearance_m / map.resolution))
    found = []
    for v in range(0, height, step):
        for u in range(0, width, step):
            rows, columns = range(v - clearance, v + clearance + 1), range(u - clearance, u + clearance + 1)
            if all(
                0 <= r < height and 0 <= c < width and map.grey[r, c] > config.free_grey for r in rows for c in columns
            ):
                found.append((u, v))
    return found


@given(
    seed=st.integers(0, 2**32 - 1),
    shape=st.tuples(st.integers(1, 24), st.integers(1, 24)),
    spacing=st.integers(1, 5),
    clearance=st.integers(0, 3),
    origin=st.sampled_from([(0.0, 0.0, 0.0), (-3.0, 7.0, 0.0), (1.0, 2.0, 0.7)]),
)
def test_pellets_follow_the_documented_algorithm(
    seed: int, shape: tuple[int, int], spacing: int, clearance: int, origin: tuple[float, float, float]
) -> None:
    grey = np.where(np.random.default_rng(seed).random(shape) < 0.9, 254, 205).astype(np.uint8)
    config = PelletConfig(spacing_m=spacing * 0.1, wall_clearance_m=clearance * 0.1)
    map = GreyMap(grey, origin=origin)
    pellets = generate_pellets(map, config)
    assert [tuple(p) for p in pellets.pixel.tolist()] == brute_force(map, config)
    assert pellets.ids.tolist() == list(range(len(pellets)))
    u, v = pellets.pixel.T
    place = complex(*origin[:2]) + map.resolution * (u + 1j * (shape[0] - v)) * np.exp(1j * origin[2])
    np.testing.assert_allclose(pellets.position, np.column_stack((place.real, place.imag)), atol=1e-12)


@pytest.mark.parametrize(("grey", "count"), [(250, 0), (251, 4)])
def test_free_cells_are_brighter_than_threshold(grey: int, count: int) -> None:
    map = GreyMap(np.full((2, 2), grey, np.uint8))
    assert len(generate_pellets(map, PelletConfig(spacing_m=0.1, wall_clearance_m=0.0))) == count


def test_set_without_pellets_keeps_its_shapes() -> None:
    pellets = generate_pellets(GreyMap(np.zeros((5, 5), np.uint8)), PelletConfig())
    assert [(a.shape, a.dtype) for a in (pellets.ids, pellets.position, pellets.pixel)] == [
        *[((0,), np.int64), ((0, 2), np.float64), ((0, 2), np.int64)]
    ]


def test_spacing_below_resolution_is_refused() -> None:
    with pytest.raises(ValueError, match=r"spacing_m = 0\.01"):
        generate_pellets(GreyMap(np.full((5, 5), 254, np.uint8)), PelletConfig(spacing_m=0.01))
