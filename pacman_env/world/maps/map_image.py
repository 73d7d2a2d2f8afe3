"""Decoding a map's image to brightness and opacity as GraphicsMagick does for Nav2: PGM, PNG and BMP.

OpenCV decodes PNG and BMP; it would not rescale a binary PGM with a maxval other than 255, so PGM is read here.
"""

import re
import struct
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

MAX_PIXELS_PER_SIDE = 10_000
_PNG = b"\x89PNG\r\n\x1a\n"
_GAP = rb"(?:\s|#[^\n]*\n)+"
_PGM_HEADER = re.compile(rb"P([25])" + _GAP + rb"(\d{1,9})" + _GAP + rb"(\d{1,9})" + _GAP + rb"(\d{1,5})\s")


class ImageError(ValueError):
    """An image cannot be read; the message has the reason, not the path."""


def read_image(path: Path) -> tuple[NDArray[np.uint8], NDArray[np.bool_] | None]:
    """Brightness (H, W), row 0 at the top, and where it is opaque (H, W), None for an image without alpha.

    Colour becomes grey by Rec. 601 luma, 16 bits become 8; opaque means an alpha of 255.
    """
    try:
        if not path.is_file():  # a device or a pipe has no end
            raise ImageError("there is no such file")
        data = path.read_bytes()
    except OSError as error:
        raise ImageError(f"cannot be read: {error.strerror}") from error
    pgm = _PGM_HEADER.match(data)
    if pgm:
        width, height = int(pgm[2]), int(pgm[3])
    elif data.startswith(_PNG) and len(data) > 33:
        width, height = struct.unpack(">II", data[16:24])
    elif data.startswith(b"BM") and len(data) > 26:
        width, height = map(abs, struct.unpack("<ii", data[18:26]))  # a negative height: rows from the top
    else:
        raise ImageError("neither PGM (P2, P5) nor PNG nor BMP, or cut off")
    # Checked before anything is unpacked: a small file can claim to be a huge image.
    if not (0 < width <= MAX_PIXELS_PER_SIDE and 0 < height <= MAX_PIXELS_PER_SIDE):
        raise ImageError(f"{width} x {height} pixels, must be within 1..{MAX_PIXELS_PER_SIDE} each way")
    return (_pgm(data, pgm, width, height), None) if pgm else _decode(data, width, height)


def _decode(data: bytes, width: int, height: int) -> tuple[NDArray[np.uint8], NDArray[np.bool_] | None]:
    import cv2

    try:
        planes = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        planes = None
    if planes is None or planes.shape[:2] != (height, width) or planes.dtype not in (np.uint8, np.uint16):
        raise ImageError("a broken image")
    if planes.ndim == 2:
        key = _transparent_grey(data)
        return _to_byte(planes), None if key is None else planes != key
    opaque = _to_byte(planes[:, :, 3]) == 255 if planes.shape[2] == 4 else None
    if data.startswith(b"BM") and opaque is not None and not planes[:, :, 3].any():
        opaque = None  # the fourth byte of a BMP is padding unless something uses it
    blue, green, red = (planes[:, :, k].astype(np.uint32) for k in range(3))
    luma = (299 * red + 587 * green + 114 * blue + 500) // 1000
    return _to_byte(luma.astype(planes.dtype)), opaque


def _to_byte(plane: NDArray[Any]) -> NDArray[np.uint8]:
    """8 bits of 16, rounded."""
    return plane if plane.dtype == np.uint8 else ((plane.astype(np.uint32) + 128) // 257).astype(np.uint8)


def _transparent_grey(data: bytes) -> int | None:
    """The grey that a PNG's tRNS chunk makes transparent, at the decoded depth: OpenCV ignores the chunk."""
    at = len(_PNG)
    while data.startswith(_PNG) and at + 12 <= len(data) and data[at + 4 : at + 8] != b"IDAT":
        (size,) = struct.unpack(">I", data[at : at + 4])
        if data[at + 4 : at + 8] == b"tRNS" and size == 2:
            depth, (value,) = data[24], struct.unpack(">H", data[at + 8 : at + 10])
            return value * 255 // (2**depth - 1) if depth < 8 else value
        at += 12 + size
    return None


def _pgm(data: bytes, header: re.Match[bytes], width: int, height: int) -> NDArray[np.uint8]:
    maxval, count, raster = int(header[4]), width * height, data[header.end() :]
    if not 0 < maxval <= 65535:
        raise ImageError(f"maxval {maxval} must be within 1..65535")
    if header[1] == b"2":
        words = re.sub(rb"#[^\n]*", b"", raster).split(maxsplit=count)[:count]
        if not all(map(bytes.isdigit, words)):
            raise ImageError("the raster holds something that is not a number")
        values = np.array([min(int(w[:9]), maxval) for w in words], dtype=np.uint32)
    else:
        dtype = np.dtype(">u2" if maxval > 255 else "u1")
        values = np.frombuffer(raster, dtype, count=min(count, len(raster) // dtype.itemsize))
    if len(values) < count:
        raise ImageError(f"cut off after {len(values)} of {count} pixels")
    if maxval != 255:
        values = (np.minimum(values, maxval).astype(np.uint32) * 510 + maxval) // (2 * maxval)
    return values.astype(np.uint8).reshape(height, width)
