import cmath
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacman_env.config import Nav2Config, PelletConfig, RobotConfig
from pacman_env.world.maps.occupancy import OccupancyMap
from pacman_env.world.navigation.grid import DriveGrid, build_grid, clearance_m
from pacman_env.world.navigation.lidar import Sensor, scan
from tests.drawn import box, drawn

MINIMUM, MAXIMUM = 0.15, 12.0
RESOLUTION = 0.05
PELLETS = PelletConfig()


def grid_of(occupancy: OccupancyMap) -> DriveGrid:
    return build_grid(occupancy, RobotConfig(), Nav2Config(), PELLETS)


def field(free: np.ndarray, yaw: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Affine and clearance of cells in rows from the bottom, the lower left corner at (0, 0)."""
    c, s = math.cos(yaw) / RESOLUTION, math.sin(yaw) / RESOLUTION
    cm = np.minimum(np.floor(clearance_m(free, RESOLUTION) * 100 + 1e-3), 255)
    return np.array([c, s, 0.0, -s, c, 0.0]), cm.astype(np.uint8)


def ranges_at(
    affine: np.ndarray,
    clearance_cm: np.ndarray,
    pose: tuple[float, float, float],
    *,
    rays: int = 360,
    seed: int = 1,
    tick: int = 0,
    **sensor: float,
) -> np.ndarray:
    ranges = np.full(rays, np.nan, np.float32)
    limits = {"minimum": MINIMUM, "maximum": MAXIMUM, "noise": 0.0, **sensor}
    moment = np.uint64(seed), np.int32(tick)
    scan(affine, clearance_cm, RESOLUTION, np.array(pose), moment, Sensor(*limits.values()), ranges)
    return ranges


def slow_ranges(
    affine: np.ndarray, clearance_cm: np.ndarray, pose: tuple[float, float, float], rays: int, maximum: float
) -> np.ndarray:
    """The same without noise and minimum: every edge a ray crosses is listed, every cell between two is looked at."""
    rows, columns = clearance_cm.shape
    linear = affine.reshape(2, 3)[:, :2]
    start = linear @ pose[:2] + affine[[2, 5]]
    result = np.full(rays, maximum)
    if not ((start >= 0) & (start < (columns, rows))).all():
        return result
    for k in range(rays):
        angle = pose[2] + 2 * math.pi * k / rays
        along = linear @ (math.cos(angle), math.sin(angle))  # cells per m
        with np.errstate(divide="ignore", invalid="ignore"):
            crossed = [(np.arange(n + 1) - s) / a for n, s, a in zip((columns, rows), start, along, strict=True)]
        edges = np.concatenate(crossed)
        edges = np.concatenate([[0.0], np.sort(edges[(edges > 0) & (edges < maximum)]), [maximum]])
        column, row = np.floor(start[:, None] + along[:, None] * (edges[1:] + edges[:-1]) / 2).astype(int)
        inside = (column >= 0) & (row >= 0) & (column < columns) & (row < rows)
        solid = np.flatnonzero(~inside | (clearance_cm[np.where(inside, row, 0), np.where(inside, column, 0)] == 0))
        if len(solid) and inside[solid[0]]:
            result[k] = edges[solid[0]]
    return result


# Ranges


@settings(max_examples=60)
@given(
    st.lists(st.text("#..", min_size=9, max_size=9), min_size=2, max_size=9),
    st.integers(0, 10**6),
    st.sampled_from([0.0, 0.7, -2.0]),
    st.sampled_from([0.4, 2.0, 12.0]),
)
def test_ranges_equal_those_of_every_cell(rows: list[str], seed: int, yaw: float, maximum: float) -> None:
    free = np.flipud(drawn(rows, square_m=0.3).game_free(PELLETS.free_grey))
    if free.all():
        free[0, 0] = False
    affine, clearance_cm = field(free, yaw)
    rng = np.random.default_rng(seed)
    place = complex(rng.uniform(-0.1, 2.8), rng.uniform(-0.1, 0.3 * len(rows) + 0.1)) * cmath.exp(1j * yaw)
    pose = (place.real, place.imag, rng.uniform(-7, 7))
    fast = ranges_at(affine, clearance_cm, pose, rays=61, minimum=0.0, maximum=maximum)
    np.testing.assert_allclose(fast, slow_ranges(affine, clearance_cm, pose, 61, maximum), atol=1e-4, rtol=0)


def test_rays_turn_left_from_straight_ahead() -> None:
    grid = grid_of(drawn(box(12, 8)))  # inside, x from 0.5 to 6.5 m and y from 0.5 to 4.5 m
    pose = (2.0, 1.5, math.pi / 2)  # facing the upper wall
    np.testing.assert_allclose(ranges_at(grid.affine, grid.clearance_cm, pose, rays=4), [3.0, 1.5, 1.0, 4.5], atol=1e-4)


def test_rays_along_cell_edges_end() -> None:
    free = np.ones((40, 40), np.bool_)
    free[:, 30:] = False
    affine, clearance_cm = field(free)
    ranges = ranges_at(affine, clearance_cm, (1.0, 1.0, 0.0), rays=4)
    np.testing.assert_allclose(ranges, [0.5, MAXIMUM, MAXIMUM, MAXIMUM], atol=1e-4)


def test_ranges_are_clipped_to_minimum_and_maximum() -> None:
    affine, clearance_cm = field(np.ones((40, 40), np.bool_))  # nothing solid at all
    assert (ranges_at(affine, clearance_cm, (1.0, 1.0, 0.3), noise=0.1) == np.float32(MAXIMUM)).all()
    grid = grid_of(drawn(box(12, 8)))
    short = ranges_at(grid.affine, grid.clearance_cm, (3.5, 2.5, 0.0), rays=4, noise=0.1, maximum=2.5)
    assert (short[[0, 2]] == 2.5).all()
    assert (ranges_at(grid.affine, grid.clearance_cm, (40.0, 2.5, 0.0)) == np.float32(MAXIMUM)).all()
    for x in (0.45, 0.55):  # in a wall or close to it
        assert ranges_at(grid.affine, grid.clearance_cm, (x, 2.5, math.pi), rays=4)[0] == np.float32(MINIMUM)


@given(st.tuples(*[st.floats(allow_nan=False, allow_infinity=False)] * 3))
def test_any_finite_pose_gives_bounded_ranges(pose: tuple[float, float, float]) -> None:
    affine, clearance_cm = field(np.ones((12, 17), np.bool_))
    clearance_cm[3:6, 4] = 0
    ranges = ranges_at(affine, clearance_cm, pose, rays=8, noise=0.3)
    assert ((ranges >= np.float32(MINIMUM)) & (ranges <= np.float32(MAXIMUM))).all()


# Noise


def noise_of(seeds: range, tick: int = 5) -> np.ndarray:
    """(len(seeds), 360) noise of scans in the middle of a room, in standard deviations."""
    grid = grid_of(drawn(box(12, 8)))
    pose = (3.1, 2.4, 0.2)
    exact = ranges_at(grid.affine, grid.clearance_cm, pose).astype(np.float64)
    noisy = [ranges_at(grid.affine, grid.clearance_cm, pose, noise=0.01, seed=s, tick=tick) for s in seeds]
    return (np.array(noisy) / exact - 1) / 0.01


def test_noise_is_normal_and_independent() -> None:
    z = noise_of(range(100))
    assert abs(z.mean()) < 0.02  # 36000 draws
    assert z.std() == pytest.approx(1.0, abs=0.02)
    assert (np.abs(z) > 1.96).mean() == pytest.approx(0.05, abs=0.005)
    ticks = np.concatenate([noise_of(range(7, 8), tick=t) for t in range(100)])
    for a, b in ((z[:, 1:], z[:, :-1]), (z[1:], z[:-1]), (ticks[1:], ticks[:-1])):
        assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 0.03


def test_noise_keeps_the_bounds() -> None:
    grid = grid_of(drawn(box(12, 8)))
    ranges = ranges_at(grid.affine, grid.clearance_cm, (3.5, 2.5, 0.0), noise=0.5, minimum=1.0, maximum=3.2)
    assert ranges.min() == 1.0
    assert ranges.max() == np.float32(3.2)
