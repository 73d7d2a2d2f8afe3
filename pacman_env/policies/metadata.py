"""What a learned planner's ONNX file says about itself: the JSON file beside it, read strictly, and its checks.

The file is data: nothing in it is evaluated. How the network is run is decided in :mod:`pacman_env.policies.learned`,
how the pair of files is written in ``train.export``.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
import typing
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from pacman_env.sim.observation.planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES, VERSION

FORMAT = 1
#: The name of the scaling that ``planner_features`` has built in, as the first planners' files say it.
NORMALISATION = "pacman_env.sim.features.planner_features"
MAX_BYTES = 16 << 20  # of the ONNX file; a planner of width 64 has 0.1 MB
_MAX_SIDECAR_BYTES = 1 << 20
_LARGEST = 1e300  # finite, and its type is float

T = TypeVar("T")


@dataclass(frozen=True)
class Training:
    """What a planner was trained on: where it may be trusted to know its way."""

    clyde_speeds_mps: tuple[float, float]  # lowest, highest
    robot_speeds_mps: tuple[float, float]  # lowest, highest
    levels: str  # the levels by name, such as "generated:train"
    preset: str
    execution: str
    decisions: int
    seed: int


@dataclass(frozen=True)
class Sidecar:
    """Everything about a planner's ONNX file that is not in it."""

    format: int
    feature_version: int  # of pacman_env.sim.observation.planner_features
    candidate_features: tuple[str, ...]
    global_features: tuple[str, ...]
    width: int  # of the hidden layers
    dropped_features: tuple[str, ...]  # candidate features that it is not shown
    dropped_kinds: tuple[str, ...]  # candidate features that mark kinds it may not choose
    normalisation: str  # what scales the features
    robot_speed_mps: float  # with which its features are built
    training: Training
    package_version: str
    commit: str  # of the sources it was exported from, "unknown" outside a repository
    metrics: dict[str, float]
    sha256: str  # of the ONNX file, hexadecimal


def sidecar_path(path: Path) -> Path:
    """The JSON file that belongs to an ONNX file."""
    return path.with_suffix(".json")


def dump(record: Any, path: Path) -> str:
    """A dataclass as the text that :func:`parse` reads back.

    Raises:
        ValueError: a field of another type than it should have; names ``path``, the file it would go to.
    """
    try:
        text = json.dumps(dataclasses.asdict(record), indent=2) + "\n"
    except TypeError as error:
        raise ValueError(f"{path}: cannot be written as JSON: {error}") from None
    parse(type(record), text, path)
    return text


def parse(kind: type[T], text: bytes | str, path: Path) -> T:
    """The dataclass ``kind`` from JSON with exactly its fields, each of exactly its type.

    Raises:
        ValueError: anything else; names the file, the field, what was found and what was expected.
    """
    try:
        found = json.loads(text, object_pairs_hook=_object)
    except (ValueError, RecursionError) as error:
        raise ValueError(f"{path}: no JSON that can be read: {error}") from None
    known = getattr(kind, "__dataclass_fields__", {})
    if "format" in known and isinstance(found, dict) and "format" in found:
        _same(path, "format", found["format"], FORMAT)  # first: another format has other fields
    result: T = _typed(found, kind, "", path)
    return result


def read_planner(path: Path) -> tuple[Sidecar, bytes]:
    """The sidecar and the content of an ONNX file that this version of the features can feed.

    Raises:
        ValueError: a file is missing or too large, or the sidecar or the hash is not what is expected.
    """
    model = _content(path, MAX_BYTES)
    beside = sidecar_path(path)
    sidecar = parse(Sidecar, _content(beside, _MAX_SIDECAR_BYTES), beside)
    _same(beside, "feature_version", sidecar.feature_version, VERSION)
    _same(beside, "candidate_features", sidecar.candidate_features, CANDIDATE_FEATURES)
    _same(beside, "global_features", sidecar.global_features, GLOBAL_FEATURES)
    _same(beside, "normalisation", sidecar.normalisation, NORMALISATION)
    for field in ("dropped_features", "dropped_kinds"):
        for name in getattr(sidecar, field):
            if name not in CANDIDATE_FEATURES:
                _refuse(beside, field, name, "names of candidate features")
    if sidecar.robot_speed_mps <= 0:
        _refuse(beside, "robot_speed_mps", sidecar.robot_speed_mps, "a speed above 0")
    _same(beside, "sha256", sidecar.sha256, hashlib.sha256(model).hexdigest())
    return sidecar, model


def _content(path: Path, limit: int) -> bytes:
    try:
        with path.open("rb") as file:
            content = file.read(limit + 1)
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from None
    if len(content) > limit:
        raise ValueError(f"{path}: size: found more than {limit} bytes, expected at most that")
    return content


def _refuse(path: Path, field: str, found: object, expected: object) -> NoReturn:
    raise ValueError(f"{path}: {field}: found {found!r:.600}, expected {expected}")


def _same(path: Path, field: str, found: object, expected: object) -> None:
    if type(found) is not type(expected) or found != expected:
        _refuse(path, field, found, repr(expected))


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """A JSON object whose names are all different."""
    found = dict(pairs)
    if len(found) < len(pairs):
        raise ValueError(f"a name is given twice among {', '.join(name for name, _ in pairs)}")
    return found


def _typed(value: Any, kind: Any, field: str, path: Path) -> Any:
    """The value as ``kind``: a dataclass, tuple, dict of numbers, float, int or str."""
    origin, kinds = typing.get_origin(kind), typing.get_args(kind)
    if isinstance(kind, type) and dataclasses.is_dataclass(kind):
        if not isinstance(value, dict):
            _refuse(path, field or "content", value, "an object")
        hints, inner = typing.get_type_hints(kind), f"{field}." if field else ""
        for name in hints.keys() ^ value.keys():
            if name in hints:
                raise ValueError(f"{path}: {inner}{name}: found nothing, expected {_words(hints[name])}")
            _refuse(path, inner + name, value[name], "no such field")
        return kind(**{name: _typed(value[name], hint, inner + name, path) for name, hint in hints.items()})
    if origin is tuple:
        count = None if kinds[-1] is ... else len(kinds)
        if not isinstance(value, list) or (count is not None and len(value) != count):
            _refuse(path, field, value, "a list" if count is None else f"a list of {count}")
        return tuple(_typed(one, kinds[0], f"{field}[{k}]", path) for k, one in enumerate(value))
    if origin is dict:
        if not isinstance(value, dict):
            _refuse(path, field, value, "an object")
        return {name: _typed(one, kinds[1], f"{field}.{name}", path) for name, one in value.items()}
    if kind is float:
        if isinstance(value, bool) or not isinstance(value, int | float) or not -_LARGEST < value < _LARGEST:
            _refuse(path, field, value, _words(kind))
        return float(value)
    if type(value) is not kind:
        _refuse(path, field, value, _words(kind))
    return value


def _words(kind: Any) -> str:
    known = {int: "a whole number", float: "a finite number", str: "a string", tuple: "a list"}
    return known.get(typing.get_origin(kind) or kind, "an object")
