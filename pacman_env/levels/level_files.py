"""Cache prepared houses on disk, one file per level, whose arrays are memory-mapped without copying.

A file consists of a header (format, key, sizes, offset and shape of each declared array) and the arrays as they lie in
memory. Each configuration and source version has a folder named by its key. Files are written once and atomically, and
processes share their pages.
"""

import contextlib
import functools
import hashlib
import mmap
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..config import Config
from ..engine.arrays import Table, address, declared
from ..engine.cache_folder import cache_dir, check_kept, warn_unkept
from ..files import replaced
from .assets import MapAssets, configuration_key, prune
from .coarse_map import CoarseArrays, add_coarse_map
from .level import COARSE_MAP, PREDICTION, Level, LevelArrays, LevelFacts, PredictionArrays

_FORMAT = b"pacman_env level 1\n"
_ALIGNMENT = 64
_KEEP_BYTES = 12 << 30  # limit for all folders; a house takes 5 MB, or 20 MB with long corridors
_OWN = -1  # instead of an index of ``LevelArrays.later``: the level's own arrays
_LATER = {PREDICTION: PredictionArrays, COARSE_MAP: CoarseArrays}
_KINDS: dict[int, Any] = {_OWN: LevelArrays, **_LATER}
_HEAD = np.dtype(
    [
        ("format", f"S{len(_FORMAT)}"),
        ("key", "S64"),
        ("bytes", np.int64),  # size of the file
        ("facts", np.int64, len(LevelFacts._fields)),
        *(
            (str(place), np.int64, sum(1 + len(a.axes) for a in declared(kind).values()))
            for place, kind in _KINDS.items()
        ),
    ]
)


class LevelFiles:
    """Files of the houses of one configuration and family."""

    def __init__(self, config: Config, family: str) -> None:
        own = {"radius": config.robot.radius_m, "power": config.power.pellets}  # change levels, not prepared maps
        numbers = {"family": family, **own, "format": str(_HEAD)}
        self.key = hashlib.sha256(f"{configuration_key(config)}{numbers}".encode()).hexdigest()[:32]

    @functools.cached_property
    def _folder(self) -> Path:
        folder = cache_dir() / "houses" / self.key
        with contextlib.suppress(OSError):
            os.utime(folder)  # mark as recently used
        return folder

    def load(self, level: int, prepare: Callable[[], MapAssets]) -> Level | None:
        """Load a level from its file; return None if the file is missing, incomplete or of another kind."""
        try:
            with open(self._path(level), "rb") as file:
                mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_COPY)  # kernels require writable arrays
            return _read(np.frombuffer(mapped, dtype=np.uint8), f"{self.key}-{level}", prepare)
        except (OSError, ValueError, TypeError):  # TypeError: shorter than the header
            return None

    def keep(self, number: int, level: Level) -> bool:
        """Write a level's file and return True; if the cache cannot be written, warn once and return False."""
        try:
            check_kept()  # do not try again after a failure
            level.add_prediction_arrays()
            add_coarse_map(level)
            path = self._path(number)
            if not path.parent.is_dir():
                path.parent.mkdir(parents=True, exist_ok=True)
                prune(path.parent.parent, _KEEP_BYTES)
            with replaced(path) as temporary:
                _write(temporary, f"{self.key}-{number}", level)
        except OSError as error:
            warn_unkept(error)
            return False
        return True

    def has(self, level: int) -> bool:
        with contextlib.suppress(OSError):
            return self._path(level).is_file()
        return False

    def _path(self, level: int) -> Path:
        return self._folder / f"{level}.level"


def _write(path: Path, key: str, level: Level) -> None:
    head = np.zeros(1, dtype=_HEAD)
    arrays: list[NDArray[Any]] = []
    offsets: dict[tuple[int, int], int] = {}  # offsets by address and size, for arrays shared by tables
    at = _padded(_HEAD.itemsize)
    for place in _KINDS:
        table = level.table if place == _OWN else level.find(place)
        assert table is not None
        numbers: list[int] = []
        for array in table.arrays.values():
            place_of = offsets.setdefault((address(array), array.nbytes), at)
            numbers += [place_of, *array.shape]
            if place_of == at:
                arrays.append(array)
                at += _padded(array.nbytes)
        head[str(place)] = numbers
    head["format"], head["key"], head["bytes"] = _FORMAT, key.encode(), at
    head["facts"] = level.facts
    with open(path, "wb") as file:
        for array in (head, *arrays):
            file.write(array.tobytes().ljust(_padded(array.nbytes), b"\0"))


def _padded(size: int) -> int:
    return -(-size // _ALIGNMENT) * _ALIGNMENT


def _read(memory: NDArray[np.uint8], key: str, prepare: Callable[[], MapAssets]) -> Level:
    head = np.ndarray(1, _HEAD, memory)[0]
    if (head["format"], head["key"], head["bytes"]) != (_FORMAT, key.encode(), len(memory)):
        raise ValueError("another kind of file, or not all of it")
    tables = {place: Table.of_memory(kind, head[str(place)], memory) for place, kind in _KINDS.items()}
    level = Level(tables[_OWN], LevelFacts(*head["facts"].tolist()), prepare)
    for place in _LATER:
        level.add(place, tables[place])
    return level
