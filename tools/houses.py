"""Check generated houses by a flood fill in their map files, without our loader: ``python -m tools.houses``."""

import sys
import tempfile
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from pacman_env.command_line.command import Parser, run_command, whole_number
from pacman_env.config import make_config
from pacman_env.levels.house_families import FAMILIES, HOUSES, HouseFamily
from pacman_env.levels.level_source import TEST_LEVEL, prepare_level


def sealed(file: Path, places: NDArray[np.float64], radius_m: float) -> list[list[float]]:
    """Return the places (P, 2), m, that a disc cannot reach from the first one."""
    keys: Any = yaml.safe_load(file.read_text())
    free = np.asarray(cv2.imread(str(file.parent / keys["image"]), 0)) > 250  # Algorithm 1
    room = cv2.copyMakeBorder(free.astype(np.uint8), 1, 1, 1, 1, cv2.BORDER_CONSTANT)  # beyond the image are walls
    room_m = keys["resolution"] * cv2.distanceTransform(room, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    fits = (room_m >= radius_m).astype(np.uint8)
    column, row = np.floor((places - keys["origin"][:2]) / keys["resolution"]).astype(np.int64).T
    column, row = column + 1, len(free) - row
    cv2.floodFill(fits, None, (int(column[0]), int(row[0])), 2 * int(fits[row[0], column[0]]), flags=4)
    return list(places[fits[row, column] != 2].tolist())


def judge(level: int, folder: Path, family: HouseFamily = HOUSES) -> tuple[int, list[list[float]]]:
    """Return the number of pellets of a level and the places that the robot cannot reach; files stay in the folder."""
    assets = prepare_level(level, config := make_config(), family)
    places = np.concatenate([assets.grid.home[None, :2], assets.goal_xy[: assets.pellets]])
    file = assets.occupancy.save(folder / f"level-{level}.yaml")
    return assets.pellets, sealed(file, places, config.robot.inscribed_radius_m)


def _check(count: int, family: HouseFamily) -> int:
    with tempfile.TemporaryDirectory() as folder:
        found = {level: judge(level, Path(folder), family) for k in range(count) for level in (k, TEST_LEVEL + k)}
    faults = [f"level {level}: no path to {places}\n" for level, (_, places) in found.items() if places]
    pellets = [one for one, _ in found.values()]
    print(*faults, f"{len(found)} levels, {min(pellets)} to {max(pellets)} pellets, {len(faults)} not playable", sep="")
    return min(len(faults), 1)


if __name__ == "__main__":
    parser = Parser(prog="python -m tools.houses", description=__doc__)
    parser.add_argument("--levels", type=whole_number(1, 1000), default=100, help="of each split (%(default)s)")
    parser.add_argument("--map", choices=FAMILIES, default=HOUSES.name, help="kind of houses (%(default)s)")
    sys.exit(run_command(parser, None, lambda options: _check(options.levels, FAMILIES[options.map])))
