"""Read and write occupancy maps in map_server's format (YAML + image), and find shipped maps by name.

Each image gives two arrays: ``occupancy``, which is the same as in Nav2's costmap, and ``grey`` for the game's rule
"brighter than 250 is free".
"""

import contextlib
import hashlib
import math
import os
import re
import reprlib
import struct
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Self

import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray

from pacman_env.files import displayable, replaced, shipped
from pacman_env.plugins import suggest
from pacman_env.world.maps.map_image import MAX_PIXELS_PER_SIDE, SUFFIXES, Grey, Mask, read_pixels

Pose = tuple[float, float, float]  # x, y, yaw: m and rad
MODES = ("trinary", "scale", "raw")
_KEYS = ("image", "resolution", "origin", "occupied_thresh", "free_thresh", "negate", "mode")
#: Numbers, whole numbers and truth values that yaml-cpp, Nav2's parser, accepts.
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*", re.ASCII)
_WHOLE = re.compile(r"[+-]?(0[xX][\da-fA-F]+|0[0-7]*|[1-9]\d*)\s*", re.ASCII)
_BOOLEANS = {"y": True, "yes": True, "true": True, "on": True, "n": False, "no": False, "false": False, "off": False}
#: Largest coordinate of a map, m; float32 values of observations have steps of at most 1 mm there.
MAX_COORDINATE_M = 10_000.0
#: Exceptions of PyYAML for broken input.
_YAML_ERRORS = (yaml.YAMLError, ValueError, OverflowError, RecursionError)


class MapError(ValueError):
    """Raised if a map cannot be read or written; the message contains the file and the invalid key or image."""

    page = "docs/maps.md"  #: documentation that commands print with the error


@dataclass(frozen=True, eq=False)
class OccupancyMap:
    """An occupancy map; arrays are (H, W) with row 0 at the top, read-only."""

    name: str
    grey: Grey  #: 0..255 by luma, inverted if ``negate``: bright is free; 0 if not opaque
    occupancy: NDArray[np.int8]  #: 0..100 or -1 (unknown), as in Nav2 Jazzy's map_server (map_io, 1.3.8 and later)
    resolution: float  #: edge of a cell, m
    origin: Pose  #: x, y, yaw of the image's lower left corner in the map frame, m and rad
    occupied_thresh: float = 0.65  #: smallest darkness of occupied cells, 0..1
    free_thresh: float = 0.196  #: largest darkness of free cells, 0..1; wins over ``occupied_thresh``
    negate: bool = False  #: dark pixels of the image are free
    mode: str = "trinary"  #: "trinary", "scale" or "raw"
    notes: tuple[str, ...] = ()  #: remarks about the YAML file, one sentence each

    def __post_init__(self) -> None:
        grey, occupancy = np.array(self.grey, dtype=np.uint8), np.array(self.occupancy, dtype=np.int8)
        if grey.ndim != 2 or grey.size == 0 or occupancy.shape != grey.shape:
            raise MapError(f"{self.name}: grey {grey.shape} and occupancy {occupancy.shape} must be one (H, W)")
        grey.flags.writeable = occupancy.flags.writeable = False
        object.__setattr__(self, "name", displayable(self.name))
        object.__setattr__(self, "grey", grey)
        object.__setattr__(self, "occupancy", occupancy)
        object.__setattr__(self, "origin", tuple(map(float, self.origin)))
        if not (math.isfinite(self.resolution) and self.resolution > 0):
            raise MapError(f"{self.name}: key 'resolution': {self.resolution} must be above 0 m per pixel")
        if len(self.origin) != 3 or not all(map(math.isfinite, self.origin)):
            raise MapError(f"{self.name}: key 'origin': {self.origin} must be three finite numbers (x, y, yaw)")
        for key in ("occupied_thresh", "free_thresh"):
            if not 0 <= getattr(self, key) <= 1:
                raise MapError(f"{self.name}: key '{key}': {getattr(self, key)} must be within 0..1")
        if self.mode not in MODES:
            raise MapError(f"{self.name}: key 'mode': {reprlib.repr(self.mode)} must be one of {', '.join(MODES)}")
        low, high = np.array(self.extent).T
        if max(*-low, *high) > MAX_COORDINATE_M:
            near = [*(self.origin[:2] - np.round((low + high) / 2, -3)).tolist(), self.origin[2]]
            rule = f"all corners must lie within {MAX_COORDINATE_M / 1000:g} km of (0, 0)"
            raise MapError(
                f"{self.name}: key 'origin': {list(self.origin)}: {rule}: set it to {near}, here and on the robot"
            )

    def _settings(self) -> dict[str, Any]:
        keys = ("resolution", "origin", "occupied_thresh", "free_thresh", "negate", "mode")
        return {key: getattr(self, key) for key in keys}

    @classmethod
    def from_pixels(
        cls, name: str, pixels: Grey, resolution: float, origin: Pose, *, opaque: Mask | None = None, **settings: Any
    ) -> Self:
        """Return the map that map_server would create from an image.

        ``pixels`` (H, W) is the image's brightness, row 0 at the top; ``opaque`` (H, W) is False for alpha below 255.
        The class describes all other arguments. Raises MapError if a value is out of range.
        """
        plain = cls(name, pixels, np.zeros(pixels.shape, np.int8), resolution, origin, **settings)
        occupancy = plain._nav2_table()[pixels]
        grey = 255 - pixels if plain.negate else pixels
        if opaque is not None:
            grey = np.where(opaque, grey, 0)
            if plain.mode != "raw":
                occupancy = np.where(opaque, occupancy, -1)
        return replace(plain, grey=grey, occupancy=occupancy)

    def _nav2_table(self) -> NDArray[np.int8]:
        """Return the occupancy of each brightness (256,), computed in float32 like nav2_map_server's map_io."""
        levels = np.arange(256)
        if self.mode == "raw":
            return np.where(levels <= 100, levels, -1).astype(np.int8)
        dark = levels.astype(np.float32) / np.float32(255)
        if not self.negate:
            dark = np.float32(1) - dark
        occupied, free = np.float32(self.occupied_thresh), np.float32(self.free_thresh)
        table = np.where(dark >= occupied, 100, -1)
        if self.mode == "scale" and occupied > free:
            between = (dark > free) & (dark < occupied)  # for other values the share may overflow
            share = (dark[between] - free) / np.float32(self.occupied_thresh - self.free_thresh) * np.float32(100)
            table[between] = np.floor(share.astype(np.float64) + 0.5)
        return np.where(dark <= free, 0, table).astype(np.int8)

    @property
    def height(self) -> int:
        """Number of rows of the image."""
        return self.grey.shape[0]

    @property
    def width(self) -> int:
        """Number of columns of the image."""
        return self.grey.shape[1]

    @property
    def extent(self) -> tuple[tuple[float, float], tuple[float, float]]:
        """Range of x and range of y of the image's corners, m."""
        right, top = self.width - 0.5, self.height - 0.5
        x, y = self.cell_to_world([-0.5, right, -0.5, right], [-0.5, -0.5, top, top])
        return (float(x.min()), float(x.max())), (float(y.min()), float(y.max()))

    @cached_property
    def hash(self) -> str:
        """SHA-256 (hex) of grey, occupancy, resolution and origin, used as key of all data computed from a map."""
        digest = hashlib.sha256(struct.pack("<2q4d", *self.grey.shape, self.resolution, *self.origin))
        digest.update(self.grey.tobytes() + self.occupancy.tobytes())
        return digest.hexdigest()

    def game_free(self, free_grey: int = 250) -> Mask:
        """Return cells (H, W) free for the game: brighter than ``free_grey`` (Nav2's rule is ``occupancy == 0``)."""
        return self.grey > free_grey

    def cell_to_world(self, column: ArrayLike, row: ArrayLike) -> tuple[Any, Any]:
        """Return the centre (x, y) of a cell in m, by map_server's formula with yaw; floats or arrays."""
        across = (np.asarray(column, dtype=float) + 0.5) * self.resolution
        up = (self.height - np.asarray(row, dtype=float) - 0.5) * self.resolution
        x, y, yaw = self.origin
        cos, sin = math.cos(yaw), math.sin(yaw)
        return x + cos * across - sin * up, y + sin * across + cos * up

    def world_to_cell(self, x: ArrayLike, y: ArrayLike) -> tuple[Any, Any]:
        """Return (column, row) as floats, whole numbers at cell centres; the inverse of :meth:`cell_to_world`."""
        dx, dy = np.asarray(x, dtype=float) - self.origin[0], np.asarray(y, dtype=float) - self.origin[1]
        cos, sin = math.cos(self.origin[2]), math.sin(self.origin[2])
        across, up = cos * dx + sin * dy, cos * dy - sin * dx
        return across / self.resolution - 0.5, self.height - up / self.resolution - 0.5

    def save(self, yaml_path: str | os.PathLike[str], *, image: str | None = None) -> Path:
        """Write a YAML file and its image to one folder, each atomically; loading them gives the same map.

        ``image`` is a file name that ends in .pgm or .png; None: the YAML's stem with .pgm, or .png if alpha is needed.

        Raises:
            MapError: ``image`` is not a valid name, or no image of this type gives this grey and occupancy.
            OSError: a file cannot be written.
        """
        import cv2  # large, and not needed for reading a PGM

        path = Path(yaml_path)
        pixels = 255 - self.grey if self.negate else self.grey.copy()
        hidden = self._nav2_table()[pixels] != self.occupancy  # pixels that need alpha to get their occupancy
        if self.mode == "raw":
            pixels[hidden] = self.occupancy[hidden].view(np.uint8)
        read = OccupancyMap.from_pixels(self.name, pixels, opaque=~hidden, **self._settings())
        if read.hash != self.hash:
            raise MapError(f"{path}: no image yields both grey and occupancy of {self.name} in mode {self.mode}")
        image = image or f"{path.stem}{'.png' if hidden.any() else '.pgm'}"
        suffix = Path(image).suffix.lower()
        if image != Path(image).name or suffix not in (".pgm", ".png"):
            raise MapError(f"{path}: key 'image': {image!r} must be a file name that ends in .pgm or .png")
        if hidden.any() and suffix == ".pgm":
            raise MapError(f"{path}: key 'image': {image!r}: unknown cells need alpha, choose a .png")
        alpha = np.where(hidden, 0, 255).astype(np.uint8)
        planes = np.dstack((pixels, pixels, pixels, alpha)) if hidden.any() else pixels
        keys = {"image": image} | self._settings() | {"origin": list(self.origin), "negate": int(self.negate)}
        text = yaml.safe_dump(keys, sort_keys=False, default_flow_style=None)
        for file, data in ((path.parent / image, cv2.imencode(suffix, planes)[1].tobytes()), (path, text.encode())):
            with replaced(file) as temporary:
                temporary.write_bytes(data)
        return path


def moves_cells(map: OccupancyMap) -> bool:
    """Return True if ignoring the yaw, as Nav2's costmap and AMCL do, moves any cell by half a cell or more.

    See navigation2#1511.
    """
    return abs(math.remainder(map.origin[2], math.tau)) * math.hypot(map.width, map.height) >= 0.5


def turned(map: OccupancyMap, name: str) -> OccupancyMap:
    """Return the same map with yaw 0: each cell is the nearest cell of ``map``, or unknown outside of its image.

    Raises MapError if the turned image has too many pixels.
    """
    import cv2

    sizes = [math.ceil((high - low) / map.resolution - 1e-6) for low, high in map.extent]  # sine and cosine are rounded
    if max(sizes) > MAX_PIXELS_PER_SIDE:
        raise MapError(f"{map.name}: {sizes} pixels if turned, must be within {MAX_PIXELS_PER_SIDE} per side")
    (left, _), (bottom, _) = map.extent
    darkest = int(map.grey[map.occupancy == -1].min(initial=255))
    unknown = darkest if darkest < 250 else 0  # never bright, which means free; 0 is saved as a transparent pixel
    blank, origin = np.zeros(sizes[::-1], np.uint8), (left, bottom, 0.0)
    result = replace(map, name=name, grey=blank, occupancy=blank.view(np.int8), origin=origin)
    corners = np.array(map.world_to_cell(*result.cell_to_world([0, 1, 0], [0, 0, 1])))  # (2, 3) in cells of ``map``
    affine = np.column_stack((corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0], corners[:, 0]))
    grey, occupancy = (
        cv2.warpAffine(plane, affine, sizes, flags=cv2.INTER_NEAREST | cv2.WARP_INVERSE_MAP, borderValue=outside)
        for plane, outside in ((map.grey, unknown), (map.occupancy.view(np.uint8), 255))
    )
    return replace(result, grey=grey, occupancy=occupancy.view(np.int8))


def load_map(source: str | os.PathLike[str]) -> OccupancyMap:
    """Read a map like Nav2 Jazzy's map_server.

    ``source`` is the name of a shipped map, a YAML file, or a folder that contains exactly one ``*.yaml``. Images are
    PGM (P2, P5), PNG or BMP of at most 10,000 x 10,000 pixels.

    Raises:
        MapError: the map cannot be read; the message contains the invalid key or image, or lists the shipped names.
    """
    path, name = _find(source)
    return _read(name, path, path.read_bytes(), _content)


def map_file(source: str | os.PathLike[str]) -> Path:
    """Return the absolute path of the YAML file that :func:`load_map` reads. Raises MapError if there is none."""
    return _find(source)[0].resolve()


def _find(source: str | os.PathLike[str]) -> tuple[Path, str]:
    """Return the YAML file and the name of a map. Raises MapError if there is none."""
    names = _shipped()
    if isinstance(source, str) and source in names:
        return names[source], source
    if not os.fspath(source):
        raise MapError("map = '': must be a shipped map's name, a YAML file or a folder with one")
    try:
        path = Path(source).expanduser()
        if path.is_dir():
            files = sorted(file for file in path.iterdir() if file.suffix.lower() == ".yaml")
            if len(files) != 1:
                raise MapError(f"{path}: a map's folder holds exactly one .yaml file, this one {len(files)}")
            return files[0], path.resolve().name
        if path.is_file() and path.suffix.lower() in SUFFIXES:
            raise MapError(f"{path}: is an image, give the YAML file of the map")
        if path.is_file():
            return path, map_name(path)
    except (OSError, RuntimeError) as error:  # no permission, or an unknown user's home
        raise MapError(f"{source}: cannot be read: {error}") from error
    if str(source).startswith("generated"):
        write = "pacman-env map generate FOLDER --map NAME --level N"
        raise MapError(f"{source}: write a level with '{write}' and name its file")
    if path.suffix or len(path.parts) > 1:
        raise MapError(f"{source}: no such file or folder")
    raise MapError(f"{source}: neither a YAML file nor a folder nor a shipped map: {suggest(str(source), names)}")


def map_name(path: Path) -> str:
    """Return the name of a map file: its stem, or the name of its folder if the file is called "map.yaml"."""
    return path.resolve().parent.name if path.stem == "map" else path.stem


def shipped_maps() -> list[str]:
    return list(_shipped())


def _shipped() -> dict[str, Path]:
    """Return the shipped YAML files by name, from the installed package or the top folder of a checkout."""
    return {p.stem: p for p in sorted(shipped("maps", "maps").glob("*.yaml"))}


class _MapLoader(yaml.BaseLoader):
    """A loader that skips tabs between the words of a line like yaml-cpp, while PyYAML refuses them."""

    def scan_to_next_token(self) -> None:
        super().scan_to_next_token()
        while self.peek() == "\t" and (self.flow_level or self.column > 0):
            if not self.flow_level:
                self.allow_simple_key = False  # a tab does not indent a key
            self.forward()
            super().scan_to_next_token()


def read_map(name: str, text: str, image: bytes) -> OccupancyMap:
    """Read a map from the content of its two files, with the rules of :func:`load_map`. Raises MapError."""
    return _read(name, Path(f"{name}.yaml"), text.encode(), lambda path: image)


def _read(name: str, path: Path, text: bytes, content: Callable[[Path], bytes]) -> OccupancyMap:
    keys, notes = _parse(path, text)
    origin = _required(path, keys, "origin")
    if not isinstance(origin, list) or len(origin) != 3:
        raise MapError(f"{path}: key 'origin': {reprlib.repr(origin)} must be three numbers (x, y, yaw)")
    mode = keys.get("mode", "trinary")
    settings: dict[str, Any] = {
        "resolution": _number(path, keys, "resolution"),
        "origin": tuple(_number(path, {"origin": v}, "origin") for v in origin),
        "occupied_thresh": _number(path, keys, "occupied_thresh"),
        "free_thresh": _number(path, keys, "free_thresh"),
        "negate": _negate(path, keys),
        "mode": mode.lower() if isinstance(mode, str) else mode,
        "notes": notes,
    }
    image = _required(path, keys, "image")
    if not isinstance(image, str) or not image or "\0" in image:
        raise MapError(f"{path}: key 'image': {reprlib.repr(image)} must be the name of a file")
    try:
        pixels, opaque = read_pixels(content(path.parent / image))
    except ValueError as error:
        raise MapError(f"{path}: key 'image': {path.parent / image}: {error}") from error
    try:
        return OccupancyMap.from_pixels(name, pixels, opaque=opaque, **settings)
    except MapError as error:
        raise MapError(f"{path}: {error}") from error


def _parse(path: Path, text: bytes) -> tuple[dict[str, Any], tuple[str, ...]]:
    """Read the keys of map_server as strings and lists of strings, with notes about repeated keys.

    Like in yaml-cpp, the first of repeated keys counts, merge keys are ordinary, and further documents are ignored.
    """
    values: dict[str, Any] = {}
    lines: dict[str, list[int]] = {key: [] for key in _KEYS}
    try:
        loader = _MapLoader(text)
        node = loader.get_node() if loader.check_node() else None
        if not isinstance(node, yaml.MappingNode):
            raise MapError(f"{path}: a map's YAML holds keys and values")
        for key, value in node.value:
            if isinstance(key, yaml.ScalarNode) and key.value in lines:
                lines[key.value].append(key.start_mark.line + 1)
                if key.value not in values:
                    values[key.value] = loader.construct_object(value, deep=True)
    except _YAML_ERRORS as error:
        if isinstance(error, MapError):
            raise
        raise MapError(f"{path}: not a plain YAML file: {' '.join(str(error).split())}") from error
    notes = (
        f"key {key!r} is in lines {' and '.join(map(str, found))}: line {found[0]} counts, as for Nav2"
        for key, found in lines.items()
        if len(found) > 1
    )
    return values, tuple(notes)


def _required(path: Path, keys: dict[Any, Any], key: str) -> Any:
    if key not in keys:
        raise MapError(f"{path}: key '{key}' is missing")
    return keys[key]


def _number(path: Path, keys: dict[str, Any], key: str) -> float:
    value = _required(path, keys, key)
    if isinstance(value, str) and _NUMBER.fullmatch(value) and math.isfinite(float(value)):
        return float(value)
    raise MapError(f"{path}: key '{key}': {reprlib.repr(value)} must be a finite decimal number")


def _negate(path: Path, keys: dict[str, Any]) -> bool:
    """Read ``negate``: a whole number (0: False) or a truth value in lower case, upper case or capitalised."""
    value = _required(path, keys, "negate")
    if isinstance(value, str) and _WHOLE.fullmatch(value):
        return int(value, 16) != 0  # zero is zero in every base
    if isinstance(value, str) and value in (value.lower(), value.upper(), value.capitalize()):
        with contextlib.suppress(KeyError):
            return _BOOLEANS[value.lower()]
    raise MapError(f"{path}: key 'negate': {reprlib.repr(value)} must be 0 or 1")


def _content(path: Path) -> bytes:
    try:
        if not path.is_file():  # devices and pipes may never end
            raise ValueError("there is no such file")
        return path.read_bytes()
    except OSError as error:
        raise ValueError(f"cannot be read: {error.strerror}") from error
