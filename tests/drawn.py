"""Maps drawn with characters, for tests that need walls in places they know."""

import numpy as np

from pacman_env.world.maps.occupancy import OccupancyMap

GREY = {"#": 0, ".": 254, " ": 205}
#: At squares of 0.4 m: two rooms of 4 x 4 m and a doorway 0.8 m wide in a wall 0.4 m thick.
TWO_ROOMS = [
    "#" * 23,
    *["#" + "." * 10 + "#" + "." * 10 + "#"] * 4,
    *["#" + "." * 21 + "#"] * 2,
    *["#" + "." * 10 + "#" + "." * 10 + "#"] * 4,
    "#" * 23,
]


def drawn(
    rows: list[str],
    *,
    square_m: float = 0.5,
    resolution: float = 0.05,
    origin: tuple[float, float, float] = (0.0, 0.0, 0.0),
) -> OccupancyMap:
    """One square per character: ``#`` wall, ``.`` free, blank unknown; the first row is the top."""
    pixels = np.array([[GREY[c] for c in row] for row in rows], dtype=np.uint8)
    side = round(square_m / resolution)
    return OccupancyMap.from_pixels("drawn", pixels.repeat(side, axis=0).repeat(side, axis=1), resolution, origin)


def box(columns: int, rows: int) -> list[str]:
    """An empty room inside a wall one square thick."""
    return ["#" * (columns + 2), *["#" + "." * columns + "#"] * rows, "#" * (columns + 2)]


def centre(column: float, row: float, rows: int, square_m: float = 0.5) -> tuple[float, float]:
    """World position of the middle of a square, with the origin in the lower left corner."""
    return (column + 0.5) * square_m, (rows - row - 0.5) * square_m
