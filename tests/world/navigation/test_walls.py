import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pacman_env.config import Config
from pacman_env.world.navigation.walls import clear_cells, overlap_m

RADIUS_M = Config().robot.radius_m
#: A square room of 4 m around the origin with a corner that juts in.
CORNERS = np.array([(-2, -2), (2, -2), (2, 2), (0.5, 2), (0.5, 0.5), (0, 0.5), (0, 2), (-2, 2)], dtype=np.float64)
WALLS = np.concatenate([CORNERS, np.roll(CORNERS, -1, axis=0)], axis=1)
AFFINE = np.array([20.0, 0.0, 50.0, 0.0, 20.0, 50.0])  # cells of 5 cm, 100 x 100 of them
CLEAR = clear_cells(WALLS, AFFINE, (100, 100), 0.05, RADIUS_M)


@settings(max_examples=20, deadline=None)
@given(x=st.floats(-2.4, 2.4), y=st.floats(-2.4, 2.4))
def test_clear_cells_have_no_wall_in_reach(x: float, y: float) -> None:
    column, row = int(20 * x + 50), int(20 * y + 50)
    if CLEAR[row, column]:
        corners = np.array([((column + dx - 50) / 20, (row + dy - 50) / 20) for dx in (0, 1) for dy in (0, 1)])
        assert (overlap_m(WALLS, np.concatenate([corners, [[x, y]]]), RADIUS_M) < 0).all()


def test_only_cells_near_walls_are_not_clear() -> None:
    centres = np.stack(np.meshgrid((np.arange(100) - 49.5) / 20, (np.arange(100) - 49.5) / 20), axis=-1).reshape(-1, 2)
    away = -overlap_m(WALLS, centres, RADIUS_M).reshape(100, 100)
    inner = np.s_[1:-1, 1:-1]
    assert CLEAR[inner][away[inner] > 0.04].all()
    assert not CLEAR[away < 0.035].any()
