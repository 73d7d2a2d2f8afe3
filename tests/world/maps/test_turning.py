import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.world.maps.occupancy import OccupancyMap, load_map, moves_cells, turned


@given(st.floats(-math.pi, math.pi), st.integers(0, 2**32 - 1), st.sampled_from(["trinary", "scale", "raw"]))
def test_turned_cells_lie_at_their_place(yaw: float, seed: int, mode: str) -> None:
    pixels = np.kron(np.random.default_rng(seed).choice([0, 205, 254], (5, 8)), np.ones((4, 4))).astype(np.uint8)
    old = OccupancyMap.from_pixels("old", pixels, 0.1, (3.0, -2.0, yaw), mode=mode)
    new = turned(old, "new")
    assert (new.origin[2], new.resolution) == (0.0, 0.1)
    rows, columns = np.indices(pixels.shape)
    column, row = (np.rint(cells).astype(int) for cells in new.world_to_cell(*old.cell_to_world(columns, rows)))
    assert min(column.min(), row.min()) >= 0
    assert (column.max() < new.width, row.max() < new.height) == (True, True)
    found = np.zeros(pixels.shape, bool)
    for right, down in itertools.product((-1, 0, 1), repeat=2):
        place = (row + down).clip(0, new.height - 1), (column + right).clip(0, new.width - 1)
        found |= (new.grey[place] == old.grey) & (new.occupancy[place] == old.occupancy)
    assert found.all()
    x, y = old.world_to_cell(*new.cell_to_world(*np.indices(new.grey.T.shape)))
    outside = ((x < -1) | (x > 32) | (y < -1) | (y > 20)).T
    assert (new.occupancy[outside] == -1).all()
    assert not new.game_free()[outside].any()


@pytest.mark.parametrize("settings", [{}, {"free_thresh": 0.25}, {"negate": True}, {"mode": "raw"}])
def test_turned_map_is_loaded_as_saved(tmp_path: Path, settings: dict[str, object]) -> None:
    pixels = np.array([[0, 254, 205], [254, 254, 0]], np.uint8)
    new = turned(OccupancyMap.from_pixels("old", pixels, 0.1, (0.0, 0.0, 0.7), **settings), "new")
    assert load_map(new.save(tmp_path / "new.yaml")).hash == new.hash


@pytest.mark.parametrize(
    ("yaw", "moves"), [(0.0, False), (1e-9, False), (2 * math.pi, False), (0.1, True), (-3.1, True)]
)
def test_yaw_counts_if_it_moves_cells(yaw: float, moves: bool) -> None:
    free = np.full((40, 60), 254, np.uint8)
    assert moves_cells(OccupancyMap.from_pixels("m", free, 0.05, (0.0, 0.0, yaw))) is moves
