"""Small map files made by hand, byte by byte where the format is what a test is about."""

import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from pacman_env.world.maps.occupancy import MapError, OccupancyMap, load_map

GOOD: dict[str, Any] = {
    "image": "m.pgm",
    "resolution": 0.05,
    "origin": [1.0, 2.0, 0.0],
    "negate": 0,
    "occupied_thresh": 0.65,
    "free_thresh": 0.196,
}


def write_map(folder: Path, content: bytes | list[list[int]], *drop: str, **changes: Any) -> Path:
    """``m.yaml`` and its image in the folder: rows of a PGM or a file's bytes; keys dropped and changed."""
    keys = {k: v for k, v in (GOOD | changes).items() if k not in drop}
    (folder / "m.pgm").write_bytes(pgm(content) if isinstance(content, list) else content)
    path = folder / "m.yaml"
    path.write_text(yaml.safe_dump(keys))
    return path


def pgm(rows: list[list[int]], maxval: int = 255, magic: str = "P5") -> bytes:
    header = f"{magic}\n# made by hand\n{len(rows[0])} {len(rows)}\n{maxval}\n".encode()
    if magic == "P2":
        return header + b"\n".join(b" ".join(b"%d" % v for v in row) for row in rows)
    return header + np.array(rows, dtype=">u2" if maxval > 255 else "u1").tobytes()


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(width: int, colour: int, depth: int, row: bytes, *extra: bytes, height: int = 1) -> bytes:
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", width, height, depth, colour, 0, 0, 0))
    body = chunk(b"IDAT", zlib.compress((b"\0" + row) * min(height, 1))) + chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + header + b"".join(extra) + body


def row(m: OccupancyMap) -> list[int]:
    return m.occupancy[0].tolist()


def refusal(path: Path) -> str:
    """Why the map is refused; nothing if it is not."""
    try:
        load_map(path)
    except MapError as error:
        return str(error)
    return ""
