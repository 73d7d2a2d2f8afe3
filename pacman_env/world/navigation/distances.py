"""Of a picture's pixels: how far away others are, which are nearest, which belong together."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ...engine.jit import kernel


def connected_parts(mask: NDArray[np.bool_]) -> tuple[NDArray[np.int32], NDArray[np.int64]]:
    """Number (H, W) of the 4-connected part (diagonal steps need both neighbours), from 1 on, and the area of each.

    What is not set has number 0 and area 0.
    """
    parts, labels = cv2.connectedComponents(mask.view(np.uint8), connectivity=4)
    return labels, _areas(labels, parts)


@kernel
def _areas(labels, parts):  # type: ignore[no-untyped-def]
    areas = np.zeros(parts, np.int64)
    for row in labels:
        for label in row:
            areas[label] += 1
    areas[0] = 0
    return areas


def nearest_numbers(number: NDArray[np.int32]) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """(H, W) of each cell the nearest number that is not negative, and how many cells away it is."""
    away, label = cv2.distanceTransformWithLabels(
        (number < 0).view(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )
    _look_up(label, number)
    return label, away


@kernel
def _look_up(label, number):  # type: ignore[no-untyped-def]
    """Put in place of each label the number that is not negative and has it; 0: none has."""
    rows, columns = label.shape
    most = 0
    for row in range(rows):
        for column in range(columns):
            most = max(most, label[row, column])
    by_label = np.zeros(most + 1, np.int32)
    for row in range(rows):
        for column in range(columns):
            if number[row, column] >= 0:
                by_label[label[row, column]] = number[row, column]
    for row in range(rows):
        for column in range(columns):
            label[row, column] = by_label[label[row, column]]


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
