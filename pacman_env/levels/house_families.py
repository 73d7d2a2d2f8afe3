"""Families of generated houses: the name of each, how a house is drawn, and the bounds of its houses."""

import dataclasses
from collections.abc import Callable
from typing import Any, NamedTuple

from ..config import Config
from ..world.maps.houses import MAX_EXTENT_M, MAX_LONG_EXTENT_M, draw_house, draw_long_house
from ..world.maps.occupancy import OccupancyMap

WIDE = 2  # factor of length and width of wide houses


class HouseFamily(NamedTuple):
    """Houses of one kind; each has the same level numbers."""

    name: str  # as a value of ``map``
    draw: Callable[[int, int], OccupancyMap]  # takes level and attempt
    extent_m: float  # bound of |x| and |y|
    pellets: tuple[int, int]  # fewest and most at ``spacing_m``
    spacing_m: float = 2.0
    train_set: int = 1000  # number of houses to draw from by default, which are cached on disk
    test_set: int = 200

    def fewest_pellets(self, config: Config) -> int:
        share = (self.spacing_m / config.pellets.spacing_m) ** 2
        return min(self.pellets[0], round(self.pellets[0] * share)) or 1

    def most_pellets(self, config: Config) -> int:
        """Return the largest allowed number of pellets of a house."""
        limit = round(self.pellets[1] * max(1.0, (self.spacing_m / config.pellets.spacing_m) ** 2))
        return limit if config.max_pellets is None else min(limit, config.max_pellets)


def _draw_wide(level: int, attempt: int) -> OccupancyMap:
    house = draw_house(level, attempt)
    x, y, yaw = house.origin
    size: dict[str, Any] = {"resolution": WIDE * house.resolution, "origin": (WIDE * x, WIDE * y, yaw)}
    return dataclasses.replace(house, name=f"{house.name}-wide", **size)


HOUSES = HouseFamily("generated", draw_house, MAX_EXTENT_M, (4, 16))
WIDE_HOUSES = HouseFamily("generated:wide", _draw_wide, WIDE * MAX_EXTENT_M, (4, 16), 2.0 * WIDE)
LONG_HOUSES = HouseFamily("generated:long", draw_long_house, MAX_LONG_EXTENT_M, (6, 24), train_set=200, test_set=100)
FAMILIES = {family.name: family for family in (HOUSES, WIDE_HOUSES, LONG_HOUSES)}
