"""Draw the symbols and texts of images.

Positions are pixels (x, y) as floats, whole numbers at pixel centres, and lengths are pixels, too; angles grow
clockwise because y points down.
Symbols are drawn at a higher resolution and averaged, so that they move smoothly and stay clear if small.
"""

import contextlib
import functools
import math
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ..game import ghosts
from .palette import Colour, Palette

Image = NDArray[np.uint8]  # (H, W, 3) RGB

GHOSTS = tuple(ghost.colour for ghost in ghosts.GHOSTS)

_OVERSAMPLE = 4
_SHIFT = 4  # fractional bits of coordinates for OpenCV
_MOUTH = math.radians(36)  # half of Pac-Man's mouth
_CAP = 22  # px, height of capital letters at OpenCV's font scale 1
_HAS_WEIGHTS = int(cv2.__version__.split(".")[0]) >= 5  # older versions only have strokes of a given thickness


class _Pen:
    def __init__(self, patch: Image, corner: tuple[int, int]) -> None:
        self.patch = patch
        self._corner = np.array(corner)

    def _fixed(self, points: Any) -> NDArray[np.int32]:
        fine = (np.asarray(points, dtype=np.float64) - self._corner + 0.5) * _OVERSAMPLE - 0.5
        return np.rint(fine * (1 << _SHIFT)).astype(np.int32)

    def disc(self, centre: Any, radius: float, colour: Colour, width: float = 0.0) -> None:
        """Draw a filled disc, or a circle with a line of ``width``."""
        x, y = self._fixed(centre).tolist()
        thickness = max(1, round(width * _OVERSAMPLE)) if width else -1
        fine_radius = round(max(radius, 0) * _OVERSAMPLE * (1 << _SHIFT))
        cv2.circle(self.patch, (x, y), fine_radius, colour, thickness, cv2.LINE_AA, _SHIFT)

    def lines(self, lines: list[Any], colour: Colour, width: float, closed: bool = False) -> None:
        thickness = max(1, round(width * _OVERSAMPLE))
        fixed = [self._fixed(line) for line in lines]
        cv2.polylines(self.patch, fixed, closed, colour, thickness, cv2.LINE_AA, _SHIFT)

    def polygon(self, points: Any, fill: Colour, outline: Colour, width: float) -> None:
        """Draw a filled polygon (P, 2) with an outline."""
        cv2.fillPoly(self.patch, [self._fixed(points)], fill, cv2.LINE_AA, _SHIFT)
        self.lines([points], outline, width, closed=True)


@contextlib.contextmanager
def _pen(image: Image, centre: NDArray, reach: float) -> Iterator[_Pen]:
    """Yield a pen for the part of the image within a square of half-width ``reach``, px, around ``centre``."""
    x0, y0 = np.maximum(np.floor(centre - reach), 0).astype(int).tolist()
    x1, y1 = np.maximum(np.ceil(centre + reach) + 1, 0).astype(int).tolist()
    patch = image[y0:y1, x0:x1]
    if patch.size == 0:
        patch = np.zeros((1, 1, 3), dtype=np.uint8)
    size = (patch.shape[1], patch.shape[0])
    fine = cv2.resize(patch, (size[0] * _OVERSAMPLE, size[1] * _OVERSAMPLE), interpolation=cv2.INTER_NEAREST)
    yield _Pen(fine, (x0, y0))
    patch[:] = cv2.resize(fine, size, interpolation=cv2.INTER_AREA)


def _arc(start: float, end: float, count: int) -> NDArray[np.float64]:
    angle = np.linspace(start, end, count)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _outline(radius: float) -> float:
    return min(max(0.14 * radius, 0.9), 2.5)


_HEM = [(x, 0.95 - 0.3 * abs(math.sin(1.5 * math.pi * (x + 1)))) for x in np.linspace(0.92, -0.92, 25)]
_PAC_SHAPE = np.concatenate([_arc(_MOUTH, 2 * math.pi - _MOUTH, 40), [(-0.12, 0.0)]])
_GHOST_SHAPE = np.concatenate([_arc(math.pi, 2 * math.pi, 24) * (0.92, 0.95) - (0, 0.05), _HEM])
_HOUSE_SHAPE = np.array(
    [(0, -1.05), (1.15, 0), (0.78, 0), (0.78, 0.9), (-0.78, 0.9), (-0.78, 0), (-1.15, 0)], dtype=np.float64
)
_DIAMOND_SHAPE = np.array([(0, -1.05), (0.85, 0), (0, 1.05), (-0.85, 0)])


def pac_man(image: Image, palette: Palette, centre: NDArray, radius: float, angle: float) -> None:
    c, s = math.cos(angle), math.sin(angle)
    width = _outline(radius)
    shape = (radius - 0.5 * width) * _PAC_SHAPE @ np.array([(c, s), (-s, c)])
    with _pen(image, centre, radius + 2) as pen:
        pen.polygon(centre + shape, palette.pac, palette.outline, width)


def ghost(image: Image, palette: Palette, centre: NDArray, radius: float, eyes: NDArray, colour: Colour | None) -> None:
    """Draw a ghost that looks in the direction ``eyes`` (2,); only its eyes, with an edge, if ``colour`` is None."""
    width = _outline(radius)
    with _pen(image, centre, 1.2 * radius + 2) as pen:
        if colour is not None:
            pen.polygon(centre + radius * _GHOST_SHAPE, colour, palette.ghost_outline, width)
        for side in (-0.36, 0.36):
            eye = centre + radius * (np.array([side, -0.2]) + 0.1 * eyes)
            if colour is None:
                pen.disc(eye, 0.29 * radius + 0.7 * width, palette.outline)
            pen.disc(eye, 0.29 * radius, palette.eye)
            pen.disc(eye + 0.12 * radius * eyes, 0.16 * radius, palette.pupil)


def catch_circle(image: Image, palette: Palette, centre: NDArray, radius: float, width: float) -> None:
    """Draw a tinted disc with a dashed edge, in which a ghost catches the robot."""
    count = max(9, round(radius * 0.6))
    step = 2 * math.pi / count
    with _pen(image, centre, radius + width + 1) as pen:
        tinted = pen.patch.copy()
        pen.disc(centre, radius, palette.danger)
        cv2.addWeighted(pen.patch, 0.16, tinted, 0.84, 0, dst=pen.patch)
        dashes = [centre + radius * _arc(k * step, (k + 0.55) * step, 6) for k in range(count)]
        pen.lines(dashes, palette.danger, width)


def believed_pose(image: Image, palette: Palette, centre: NDArray, radius: float, angle: float, width: float) -> None:
    direction = np.array([math.cos(angle), math.sin(angle)])
    with _pen(image, centre, 1.5 * radius + 2) as pen:
        pen.disc(centre, radius, palette.belief, width)
        pen.lines([[centre + radius * direction, centre + 1.5 * radius * direction]], palette.belief, width)


def pellet(image: Image, palette: Palette, centre: NDArray, radius: float, there: bool) -> None:
    """Draw a pellet if it is ``there``, or the faint ring of a collected pellet."""
    with _pen(image, centre, radius + 2) as pen:
        if there:
            pen.disc(centre, radius, palette.outline)
            pen.disc(centre, radius - 1.2 * _outline(radius), palette.pac)
        else:
            pen.disc(centre, 0.85 * radius, palette.collected, 0.9)


def goal_ring(image: Image, palette: Palette, centre: NDArray, radius: float, width: float) -> None:
    with _pen(image, centre, radius + width + 1) as pen:
        pen.disc(centre, radius, palette.plan, width)


def plan(image: Image, palette: Palette, points: NDArray, width: float) -> None:
    fixed = np.rint(points * (1 << _SHIFT)).astype(np.int32)
    cv2.polylines(image, [fixed], False, palette.plan, max(1, round(width)), cv2.LINE_AA, _SHIFT)


def home(image: Image, palette: Palette, centre: NDArray, radius: float) -> None:
    door = np.array([(-0.24, 0.9), (-0.24, 0.25), (0.24, 0.25), (0.24, 0.9)])
    with _pen(image, centre, 1.3 * radius + 2) as pen:
        pen.polygon(centre + radius * _HOUSE_SHAPE, palette.place, palette.place, 0.5)
        pen.polygon(centre + radius * door, palette.place_fill, palette.place_fill, 0.25)


def refuge(image: Image, palette: Palette, centre: NDArray, radius: float) -> None:
    with _pen(image, centre, 1.2 * radius + 2) as pen:
        pen.polygon(centre + radius * _DIAMOND_SHAPE, palette.place_fill, palette.place, 1.3 * _outline(radius))


def scale_bar(image: Image, centre: NDArray, half: float, radius: float, colour: Colour) -> None:
    across, down = np.array([half, 0.0]), np.array([0.0, radius])
    ends = [centre - across, centre + across]
    marks = [[end - down, end + down] for end in ends]
    with _pen(image, centre, half + 3) as pen:
        pen.lines([ends, *marks], colour, _outline(2 * radius))


@functools.lru_cache(maxsize=512)
def text(words: str, cap: float, bold: bool, colour: Colour, background: Colour) -> Image:
    """Return an image of a text with capital letters ``cap`` px high; non-ASCII characters become '?'."""
    size = cap * _OVERSAMPLE
    stroke = 1 if _HAS_WEIGHTS and not bold else max(1, round(size * (0.17 if bold else 0.12)))
    plain = words.encode("ascii", "replace").decode()
    scale = size / _CAP
    width = cv2.getTextSize(plain, cv2.FONT_HERSHEY_SIMPLEX, scale, stroke)[0][0]
    rows, columns = math.ceil(1.7 * cap), math.ceil(width / _OVERSAMPLE) + 2
    canvas = np.zeros((rows * _OVERSAMPLE, columns * _OVERSAMPLE), dtype=np.uint8)
    origin = (_OVERSAMPLE, round(1.3 * size))
    cv2.putText(canvas, plain, origin, cv2.FONT_HERSHEY_SIMPLEX, scale, 255, stroke, cv2.LINE_AA)
    share = cv2.resize(canvas, (columns, rows), interpolation=cv2.INTER_AREA)[:, :, None] / 255.0
    picture = np.rint((1 - share) * background + share * np.array(colour)).astype(np.uint8)
    picture.flags.writeable = False
    return picture


def paste(image: Image, x: float, middle: float, picture: Image) -> None:
    """Paste a text at column ``x`` with the middle of its capital letters on row ``middle``, clipped to the image."""
    left, top = max(round(x), 0), max(round(middle - 0.47 * picture.shape[0]), 0)
    target = image[top : top + picture.shape[0], left : left + picture.shape[1]]
    target[:] = picture[: target.shape[0], : target.shape[1]]
