"""Read the brightness of a map's image (PGM, PNG, BMP) like GraphicsMagick, which Nav2's map_server uses."""

import re
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

Grey = NDArray[np.uint8]
Mask = NDArray[np.bool_]
SUFFIXES = (".pgm", ".png", ".bmp")
MAX_PIXELS_PER_SIDE = 10_000
_PNG = b"\x89PNG\r\n\x1a\n"
_GAP = rb"(?:\s|#[^\n]*\n)+"
_PGM_HEADER = re.compile(rb"P([25])" + _GAP + rb"(\d{1,9})" + _GAP + rb"(\d{1,9})" + _GAP + rb"(\d{1,5})\s")


def read_pixels(data: bytes) -> tuple[Grey, Mask | None]:
    """Return the brightness (H, W), row 0 at the top, and the mask of opaque pixels (None without alpha).

    Raises ValueError for another format, a damaged image, or one of more than 10,000 x 10,000 pixels.

    Like in GraphicsMagick, which Nav2 uses, colour becomes grey by Rec. 601 luma, 16 bits become 8, and alpha 255 is
    opaque. OpenCV decodes PNG and BMP, but it does not rescale binary PGMs with a maxval other than 255.
    """
    pgm = _PGM_HEADER.match(data)
    if pgm:
        width, height = int(pgm[2]), int(pgm[3])
    elif data.startswith(_PNG) and len(data) > 33:
        width, height = struct.unpack(">II", data[16:24])
    elif data.startswith(b"BM") and len(data) > 26:
        width, height = map(abs, struct.unpack("<ii", data[18:26]))  # negative height: rows from the top
    else:
        raise ValueError("neither PGM (P2, P5) nor PNG nor BMP, or cut off")
    # Check before unpacking, because a small file can claim to be a huge image.
    if not (0 < width <= MAX_PIXELS_PER_SIDE and 0 < height <= MAX_PIXELS_PER_SIDE):
        raise ValueError(f"{width} x {height} pixels, must be within 1..{MAX_PIXELS_PER_SIDE} per side")
    return (_pgm(data, pgm, width, height), None) if pgm else _decode(data, width, height)


def _decode(data: bytes, width: int, height: int) -> tuple[Grey, Mask | None]:
    import cv2

    try:
        planes = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    except cv2.error:
        planes = None
    if planes is None or planes.shape[:2] != (height, width) or planes.dtype not in (np.uint8, np.uint16):
        raise ValueError("a broken image")
    if planes.ndim == 2:
        key = _transparent_grey(data)
        return _to_byte(planes), None if key is None else planes != key
    opaque = _to_byte(planes[:, :, 3]) == 255 if planes.shape[2] == 4 else None
    if data.startswith(b"BM") and opaque is not None and not planes[:, :, 3].any():
        opaque = None  # all zeros: the fourth byte is padding, not alpha
    blue, green, red = (planes[:, :, k].astype(np.uint32) for k in range(3))
    luma = (299 * red + 587 * green + 114 * blue + 500) // 1000
    return _to_byte(luma.astype(planes.dtype)), opaque


def _to_byte(plane: NDArray[Any]) -> Grey:
    """Convert 16-bit to 8-bit values, rounded."""
    return plane if plane.dtype == np.uint8 else ((plane.astype(np.uint32) + 128) // 257).astype(np.uint8)


def _transparent_grey(data: bytes) -> int | None:
    """Return the grey that a PNG's tRNS chunk makes transparent, at the decoded depth, or None; OpenCV ignores it."""
    at = len(_PNG)
    while data.startswith(_PNG) and at + 12 <= len(data) and data[at + 4 : at + 8] != b"IDAT":
        (size,) = struct.unpack(">I", data[at : at + 4])
        if data[at + 4 : at + 8] == b"tRNS" and size == 2:
            depth, (value,) = data[24], struct.unpack(">H", data[at + 8 : at + 10])
            return value * 255 // (2**depth - 1) if depth < 8 else value
        at += 12 + size
    return None


def _pgm(data: bytes, header: re.Match[bytes], width: int, height: int) -> Grey:
    maxval, count, raster = int(header[4]), width * height, data[header.end() :]
    if not 0 < maxval <= 65535:
        raise ValueError(f"maxval {maxval} must be within 1..65535")
    if header[1] == b"2":
        words = re.sub(rb"#[^\n]*", b"", raster).split(maxsplit=count)[:count]
        if not all(map(bytes.isdigit, words)):
            raise ValueError("the raster holds something that is not a number")
        values = np.array([min(int(w[:9]), maxval) for w in words], dtype=np.uint32)
    else:
        dtype = np.dtype(">u2" if maxval > 255 else "u1")
        values = np.frombuffer(raster, dtype, count=min(count, len(raster) // dtype.itemsize))
    if len(values) < count:
        raise ValueError(f"cut off after {len(values)} of {count} pixels")
    if maxval != 255:
        values = (np.minimum(values, maxval).astype(np.uint32) * 510 + maxval) // (2 * maxval)
    return values.astype(np.uint8).reshape(height, width)
