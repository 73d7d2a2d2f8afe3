from pathlib import Path

import numpy as np
import pytest

from pacman_env.evaluation.checks.generated_levels import main, objection, read_pgm
from pacman_env.world.maps.occupancy import OccupancyMap
from tests.drawn import drawn

#: Two rooms; the door between them is one square of 0.4 m wide.
ROOMS = ["#############", "#.....#.....#", "#...........#", "#.....#.....#", "#############"]
SHUT = [row.replace("#...........#", "#.....#.....#") for row in ROOMS]


def saved(rows: list[str], folder: Path) -> Path:
    return drawn(rows, square_m=0.4).save(folder / "rooms.yaml")


def place(column: int, row: int) -> tuple[float, float]:
    return (column + 0.5) * 0.4, (5 - row - 0.5) * 0.4


def test_disc_passes_only_doors_that_are_wide_enough(tmp_path: Path) -> None:
    path, places = saved(ROOMS, tmp_path), np.array([place(2, 2), place(10, 2)])
    assert objection(path, places, 0.15) == ""
    assert objection(path, places, 0.25).startswith("no path from")


def test_unreachable_and_blocked_places_are_named(tmp_path: Path) -> None:
    path = saved(SHUT, tmp_path)
    inside, sealed, wall = place(2, 2), place(10, 2), place(6, 2)
    assert objection(path, np.array([inside, place(4, 1)]), 0.15) == ""
    assert objection(path, np.array([inside, sealed]), 0.15) == f"no path from {list(inside)} to {[list(sealed)]}"
    assert objection(path, np.array([wall, inside]), 0.15) == f"the disc does not fit at {list(wall)}"
    assert objection(path, np.array([inside, (-1.0, 0.0)]), 0.15) == "places [[-1.0, 0.0]] are off the map"


def test_pgm_is_read_as_it_was_saved(tmp_path: Path) -> None:
    grey = np.random.default_rng(0).choice(np.array([0, 205, 254], dtype=np.uint8), size=(7, 11))
    OccupancyMap.from_pixels("m", grey, 0.05, (1.0, 2.0, 0.0)).save(tmp_path / "m.yaml")
    np.testing.assert_array_equal(read_pgm(tmp_path / "m.pgm"), grey)


@pytest.mark.parametrize("data", [b"P2\n1 1\n255\n0\n", b"P5\n2 2\n255\nabc", b"", b"P5\n2 2\n65535\nabcdabcd"])
def test_invalid_pgm_is_refused(data: bytes, tmp_path: Path) -> None:
    path = tmp_path / "broken.pgm"
    path.write_bytes(data)
    with pytest.raises(ValueError, match=r"broken\.pgm"):
        read_pgm(path)


def test_map_with_inverted_colours_is_refused(tmp_path: Path) -> None:
    path = saved(ROOMS, tmp_path)
    path.write_text(path.read_text().replace("negate: 0", "negate: 1"))
    with pytest.raises(ValueError, match="negate"):
        objection(path, np.array([place(2, 2)]), 0.1)


def test_command_checks_levels_of_both_splits(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--levels", "4", "--start", "30"]) == 0
    assert capsys.readouterr().out.startswith("4 levels, ")
