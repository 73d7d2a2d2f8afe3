"""The flood fill in saved maps names the places that the robot cannot reach."""

from pathlib import Path

import numpy as np
import pytest

from tests.drawn import drawn
from tools.houses import sealed

#: Two rooms; the door between them is one square of 0.4 m wide.
ROOMS = ["#############", "#.....#.....#", "#...........#", "#.....#.....#", "#############"]
SHUT = [row.replace("#...........#", "#.....#.....#") for row in ROOMS]
PLACES = np.array([(1.0, 1.0), (1.8, 1.4), (4.2, 1.0)])


@pytest.mark.parametrize(("rows", "radius_m", "reached"), [(ROOMS, 0.15, 3), (ROOMS, 0.25, 2), (SHUT, 0.15, 2)])
def test_disc_passes_only_wide_doors(rows: list[str], radius_m: float, reached: int, tmp_path: Path) -> None:
    file = drawn(rows, square_m=0.4).save(tmp_path / "rooms.yaml")
    assert sealed(file, PLACES, radius_m) == PLACES[reached:].tolist()
    wall = np.array([(2.6, 0.6), (1.0, 1.0)])
    assert len(sealed(file, wall, radius_m)) == 2
