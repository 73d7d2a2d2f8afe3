"""Messages of the robot as a page shows them: the map as a picture, a scan as rays from straight ahead."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from pacman_env.ros.messages import BadMessage, Pose

RAYS = 180
FREE, UNKNOWN, SOLID = 254, 205, 0  # grey, as map_server's files have it
_MOST_CELLS = 50_000_000


@dataclass(frozen=True)
class MapPicture:
    """A map as a PNG, and where it lies."""

    png: bytes
    resolution: float  # m a pixel
    width: int
    height: int
    origin: Pose  # of the lower left corner


def picture_of(message: Any) -> MapPicture:
    """The picture of an OccupancyGrid, top row first.

    Raises:
        BadMessage: sizes that do not fit, numbers that are not finite.
    """
    info = message.info
    count = info.width * info.height
    if count != len(message.data) or not 0 < count <= _MOST_CELLS:
        raise BadMessage(f"{info.width} x {info.height} cells, {len(message.data)} values")
    position, q = info.origin.position, info.origin.orientation
    yaw = math.atan2(2.0 * (q.w * q.z + q.x * q.y), 1.0 - 2.0 * (q.y * q.y + q.z * q.z))
    resolution = float(info.resolution)
    if not (all(map(math.isfinite, (position.x, position.y, yaw, resolution))) and resolution > 0):
        raise BadMessage("numbers that are not finite")
    cells = np.frombuffer(bytes(memoryview(message.data).cast("B")), np.int8).reshape(info.height, info.width)[::-1]
    pixels = np.where(cells < 0, UNKNOWN, FREE - np.clip(cells, 0, 100).astype(np.int16) * FREE // 100)
    done, png = cv2.imencode(".png", pixels.astype(np.uint8))
    if not done:
        raise BadMessage("no picture can be made of it")
    origin = float(position.x), float(position.y), yaw
    return MapPicture(png.tobytes(), resolution, int(info.width), int(info.height), origin)


def rays_of(message: Any, yaw: float) -> NDArray[np.float64]:
    """(RAYS,) m from a LaserScan: the nearest that was met in each direction, ray 0 ahead, NaN: nothing.

    Args:
        message: the scan.
        yaw: of the lidar in the robot, rad.
    """
    ranges = np.asarray(message.ranges, dtype=np.float64)
    rays = np.full(RAYS, np.inf)
    angles = yaw + message.angle_min + message.angle_increment * np.arange(len(ranges))
    good = np.isfinite(ranges) & np.isfinite(angles) & (ranges >= message.range_min) & (ranges <= message.range_max)
    numbers = np.round(angles[good] / (2.0 * math.pi / RAYS)).astype(np.int64) % RAYS
    np.minimum.at(rays, numbers, ranges[good])
    return np.where(np.isfinite(rays), rays, np.nan)
