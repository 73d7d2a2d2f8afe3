"""Generated houses: the same everywhere, as declared, and fit for the game."""

import hashlib
from collections import Counter
from functools import cache

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pacman_env.config import ClydeConfig, Nav2Config, PelletConfig, RobotConfig
from pacman_env.levels.ghost_cells import clyde_cells
from pacman_env.world.maps import houses
from pacman_env.world.maps.house_rooms import LOOP_QUOTA, Dice, area
from pacman_env.world.maps.house_survey import GLASS, MAX_PIXELS, OPEN, SOLID, Shape, survey
from pacman_env.world.maps.houses import MAX_EXTENT_M, House, draw_house, draw_long_house
from pacman_env.world.maps.long_rooms import lay_out_long
from pacman_env.world.maps.occupancy import OccupancyMap
from pacman_env.world.navigation.grid import DriveGrid, build_grid

LEVELS = range(20)
MANY = range(200)


@cache
def house(level: int) -> OccupancyMap:
    return draw_house(level)


@cache
def grid(level: int) -> DriveGrid:
    return build_grid(house(level), RobotConfig(), Nav2Config(), PelletConfig())


@cache
def plans() -> list[House]:
    return [House(level, 0) for level in MANY]


def loops(plan: House) -> int:
    return len(plan.doors) - len(plan.rooms) + 1


def dead_ends(plan: House) -> int:
    doors = Counter(room for door in plan.doors for room in (door.a, door.b))
    return sum(count == 1 for count in doors.values())


def holes(solid: NDArray[np.bool_]) -> int:
    """Solid parts that the robot can drive around."""
    padded = np.pad(solid, 1, constant_values=True).astype(np.uint8)
    return cv2.connectedComponents(padded, connectivity=8)[0] - 2  # without label 0 and the outside


def test_houses_have_the_recorded_bits() -> None:
    digest = hashlib.sha256("".join(draw_house(n, a).hash for n, a in ((0, 0), (0, 1), (7, 0), (10**12, 3))).encode())
    assert digest.hexdigest()[:16] == "941ea87256b30471"


def test_long_houses_have_the_recorded_bits() -> None:
    """Level 2404 has a storeroom that is too shallow for two rows of shelves."""
    digest = hashlib.sha256("".join(draw_long_house(n).hash for n in (*range(6), 2404, 10**12)).encode())
    assert digest.hexdigest()[:16] == "a2f5a307cde9b349"


def test_long_houses_have_corridors_of_8_to_20_m() -> None:
    for level in range(20):
        floor = House(level, 0, houses.LONG_SEED, lay_out_long).floor
        corridors = [floor.rooms[k] for k in floor.halls if floor.roles[k] == "corridor"]
        assert 8.0 <= max(max(x1 - x0, y1 - y0) for x0, y0, x1, y1 in corridors) <= 20.0


def test_levels_and_attempts_differ() -> None:
    maps = [draw_house(level, attempt) for level in range(3) for attempt in range(3)]
    assert len({m.hash for m in maps}) == 9
    assert [m.name for m in maps[::3]] == ["generated-0", "generated-1", "generated-2"]


def test_loops_come_in_the_declared_proportion() -> None:
    numbers = [loops(plan) for plan in plans()]
    assert all(Counter(numbers[k : k + 10]) == Counter(LOOP_QUOTA) for k in range(0, len(numbers), 10))
    share = Counter(min(n, 2) for n in numbers)
    assert (share[0], share[1], share[2]) == (40, 80, 80)
    assert [loops(House(level, 5)) for level in range(10)] == numbers[:10]
    assert len({tuple(numbers[k : k + 10]) for k in range(0, len(numbers), 10)}) > 10  # no fixed order


def test_houses_have_dead_ends_and_home_size() -> None:
    assert all(dead_ends(plan) >= 1 and 4 <= len(plan.rooms) <= 10 for plan in plans())
    assert all(30 <= sum(area(room.inner) for room in plan.rooms) <= 75 for plan in plans())
    assert len({len(plan.rooms) for plan in plans()}) >= 5
    assert np.mean([any(shape[0] == GLASS for shape in plan.shapes) for plan in plans()]) > 0.9
    assert np.median([sum(len(room.occupied) for room in plan.rooms) for plan in plans()]) >= 10


@pytest.mark.parametrize("level", range(12))
def test_house_has_room_for_robot_and_loops(level: int) -> None:
    plan, drive = house(level), grid(level)
    assert set(np.unique(plan.grey)) == {0, 205, 254}
    assert max(plan.grey.shape) <= MAX_PIXELS
    x, y, yaw = plan.origin
    assert max(-x, -y, x + plan.width * plan.resolution, y + plan.height * plan.resolution) <= MAX_EXTENT_M
    assert min(-x, -y) > 0
    assert (yaw, plan.resolution) == (0.0, 0.05)
    assert tuple(drive.home) == (0.0, 0.0, 0.0)
    column, row = drive.to_cell(0.0, 0.0)
    assert drive.clearance[row, column] >= 0.35
    assert holes(drive.cell_id < 0) >= loops(plans()[level])  # furniture adds more


def test_most_maps_show_rays_through_glass() -> None:
    """They are free cells in which the robot cannot be, on the far side of a wall."""
    outside = []
    for level in LEVELS:
        column, row, inside = grid(level).locate(
            np.stack(house(level).cell_to_world(*np.nonzero(house(level).game_free())[::-1]), axis=1)
        )
        near = cv2.dilate((grid(level).cell_id >= 0).astype(np.uint8), np.ones((21, 21), np.uint8))
        outside.append(int((~inside).sum() + (near[row[inside], column[inside]] == 0).sum()))
    assert np.mean([cells > 20 for cells in outside]) > 0.7


def room_with_glass(size: float) -> list[Shape]:
    """A room around (0, 0) with windows in all of its eastern side, as houses have them."""
    shapes: list[Shape] = [(SOLID, 0.0, 0.0, size + 0.2, size + 0.2, 0.0), (OPEN, 0.0, 0.0, size, size, 0.0)]
    across = np.arange(-size / 2 + 0.2, size / 2 - 0.2, houses._PANE_M + houses._POST_M)
    return shapes + [(GLASS, size / 2 + 0.05, float(y), 0.2, houses._PANE_M, 0.0) for y in across]


@pytest.mark.parametrize("seed", range(4))
def test_windows_cannot_be_passed(seed: int) -> None:
    dice = Dice(seed)
    turn = dice.between(-0.8, 0.8) if seed else 0.0
    plan = survey("room", room_with_glass(4.0), turn, dice.draw)
    drive = build_grid(plan, RobotConfig(), Nav2Config(), PelletConfig())
    x, y = drive.to_world(drive.cell[:, 0], drive.cell[:, 1])
    assert np.hypot(x - x.mean(), y - y.mean()).max() < 4.0 / 2 * 2**0.5 + 0.1
    assert len(x) * drive.resolution**2 < 4.0**2
    ghost = clyde_cells(plan, ClydeConfig(), PelletConfig().free_grey)
    assert ghost.part.max() == 0  # no place for him outside


def test_impossible_buildings_are_refused() -> None:
    draw = Dice(0).draw
    for numbers in ((-1, 0), (0, -1)):
        with pytest.raises(ValueError, match="must not be negative"):
            draw_house(*numbers)
    with pytest.raises(ValueError, match="closet: no place for the robot"):
        survey("closet", [(SOLID, 0.0, 0.0, 1.0, 1.0, 0.0), (OPEN, 0.0, 0.0, 0.6, 0.6, 0.0)], 0.0, draw)
    with pytest.raises(ValueError, match="hangar: the building needs 4"):
        survey("hangar", [(OPEN, 0.0, 0.0, 20.0, 5.0, 0.0)], 0.0, draw)
