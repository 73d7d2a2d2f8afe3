"""Of a picture's pixels: how far away others are, which are nearest, which belong together."""

import cv2
import numpy as np
from numpy.typing import NDArray

from ...engine.jit import kernel


def connected_parts(mask: NDArray[np.bool_]) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Number (H, W) of the 4-connected part (diagonal steps need both neighbours), from 1 on, and the area of each.

    What is not set has number 0 and area 0.
    """
    parts, labels = cv2.connectedComponents(mask.view(np.uint8), connectivity=4)
    areas = np.bincount(labels.ravel(), minlength=parts)
    areas[0] = 0
    return labels, areas


def nearest_numbers(number: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """(H, W) of each cell the nearest number that is not negative, 0: there is none, and how many cells away it is."""
    away, label = cv2.distanceTransformWithLabels(
        (number < 0).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    by_label = np.append(np.int32(0), number[number >= 0])  # OpenCV counts pixels row by row, from 1 on
    return by_label[label], away


def clearance_m(free: NDArray[np.bool_], resolution: float) -> NDArray[np.float32]:
    """Distance (H, W) of each cell's centre to that of the nearest cell that is not free, m."""
    distance = cv2.distanceTransform(free.view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return _whole_squares(distance, resolution)


@kernel
def _whole_squares(distance, resolution):  # type: ignore[no-untyped-def]
    """Distances in m. OpenCV's last bit differs from call to call; the squares are whole, so rounding is exact."""
    rounded = np.empty(distance.shape, np.float32)
    for row in range(len(distance)):
        for column in range(distance.shape[1]):
            d = np.float64(distance[row, column])
            rounded[row, column] = np.sqrt(np.rint(d * d)) * resolution
    return rounded
