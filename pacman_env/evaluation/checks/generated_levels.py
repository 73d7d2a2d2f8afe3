"""Check generated levels by an independent reading of their map files: ``pacman-env houses``.

Each level is saved as the YAML and PGM files that map_server loads, and read back with PyYAML and a few lines of NumPy.
An OpenCV flood fill checks that the robot's disc can go from home to every pellet. The check uses neither the project's
loader nor its grid or path fields.
"""

import argparse
import re
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml
from numpy.typing import NDArray

from pacman_env.command_line.command import Parser, count, run_command, whole_number
from pacman_env.config import make_config
from pacman_env.sim.maps.level_source import TEST_LEVEL, TEST_LEVELS, prepare_level

FAULT_STATUS = 1
FREE_ABOVE = 250  # grey, Algorithm 1


def read_pgm(path: Path) -> NDArray[np.uint8]:
    """Return the grey values (H, W) of a binary PGM file with 8 bits."""
    data = path.read_bytes()
    header = re.match(rb"P5\s+(?:#.*\n\s*)*(\d+)\s+(\d+)\s+255\s", data)
    if header is None:
        raise ValueError(f"{path}: no binary PGM with 8 bits")
    width, height = int(header[1]), int(header[2])
    pixels = np.frombuffer(data, dtype=np.uint8, offset=header.end())
    if pixels.size != width * height:
        raise ValueError(f"{path}: {pixels.size} pixels, {width} x {height} declared")
    return pixels.reshape(height, width)


def objection(yaml_path: Path, places: NDArray[np.float64], radius_m: float) -> str:
    """Explain why a disc cannot go from the first of the places (P, 2), m, to all others; "" if it can."""
    keys: dict[str, Any] = yaml.safe_load(yaml_path.read_text())
    x0, y0, yaw = keys["origin"]
    resolution = keys["resolution"]
    plain = (yaw, keys["negate"], keys["mode"]) == (0, 0, "trinary")
    if not (plain and keys["free_thresh"] < keys["occupied_thresh"]):
        raise ValueError(f"{yaml_path}: {keys}")
    free = (read_pgm(yaml_path.parent / keys["image"]) > FREE_ABOVE).astype(np.uint8)
    # Pixels beyond the image are walls; a wall passes through the centres of its pixels.
    bordered = cv2.copyMakeBorder(free, 1, 1, 1, 1, cv2.BORDER_CONSTANT)
    room_m = resolution * cv2.distanceTransform(bordered, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1]
    fits = (room_m >= radius_m).astype(np.uint8)
    column = np.floor((places[:, 0] - x0) / resolution).astype(np.int64)
    row = len(free) - 1 - np.floor((places[:, 1] - y0) / resolution).astype(np.int64)
    inside = (column >= 0) & (column < free.shape[1]) & (row >= 0) & (row < len(free))
    if not inside.all():
        return f"places {places[~inside].tolist()} are off the map"
    if not fits[row[0], column[0]]:
        return f"the disc does not fit at {places[0].tolist()}"
    reached = fits.copy()
    cv2.floodFill(reached, None, (int(column[0]), int(row[0])), 2, flags=4)
    sealed = reached[row, column] != 2
    return f"no path from {places[0].tolist()} to {places[sealed].tolist()}" if sealed.any() else ""


def judge(level: int, folder: Path) -> tuple[int, str]:
    """Return the number of pellets of a level and why it is not playable ("": it is); its files stay in the folder."""
    config = make_config()
    assets = prepare_level(level, config)
    path = assets.occupancy.save(folder / f"level-{level}.yaml")
    home, pellets = assets.grid.home[None, :2], assets.goal_xy[: assets.pellets]
    return assets.pellets, objection(path, np.concatenate([home, pellets]), config.robot.inscribed_radius_m)


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(make_parser(), argv, _report)


def make_parser() -> Parser:
    parser = Parser(prog="pacman-env houses", description=__doc__)
    parser.add_argument("--levels", type=count(), default=200, help="number of levels, half of them test levels (200)")
    parser.add_argument("--start", type=whole_number(0), default=0, help="index of the first level in each split (0)")
    return parser


def _report(arguments: argparse.Namespace) -> int:
    last = arguments.start + (arguments.levels - 1) // 2
    if last >= TEST_LEVELS:
        raise ValueError(f"levels {arguments.start} to {last} of either split: testing has 0 to {TEST_LEVELS - 1}")
    numbers = np.arange(arguments.levels) // 2 + arguments.start
    numbers[1::2] += TEST_LEVEL
    pellets, faults = [], 0
    with tempfile.TemporaryDirectory() as folder:
        for level in numbers.tolist():
            count, reason = judge(level, Path(folder))
            pellets.append(count)
            if reason:
                faults += 1
                print(f"level {level}: {reason}")
    print(f"{len(pellets)} levels, {min(pellets)} to {max(pellets)} pellets, {faults} not playable")
    return FAULT_STATUS if faults else 0
