"""Read and write the metadata of a learned planner, a JSON file next to its ONNX file, with strict checks."""

import hashlib
import json
from pathlib import Path
from typing import Any, Literal, TypeVar

import msgspec

from pacman_env.config.validation import Number, Positive, convert, located, require
from pacman_env.observations.planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES, VERSION

FORMAT: Literal[1] = 1
MAX_BYTES = 16 << 20  # limit of a file; a planner of width 64 has 0.1 MB
_MAX_METADATA_BYTES = 1 << 20

T = TypeVar("T")


class Training(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Training conditions of a planner."""

    clyde_speeds_mps: tuple[Number, Number]  # lowest, highest
    robot_speeds_mps: tuple[Number, Number]  # lowest, highest
    levels: str  # name of the levels, such as "generated:train"
    preset: str
    execution: str
    decisions: int
    seed: int
    ghosts: tuple[str, ...] = ("wander",)  # line-ups with their shares; missing in older files


class PlannerMetadata(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Metadata of a planner's ONNX file."""

    format: Literal[1]  # first, because other formats have other fields
    feature_version: int  # version of pacman_env.observations.planner_features
    candidate_features: tuple[str, ...]
    global_features: tuple[str, ...]
    width: int  # width of the hidden layers
    dropped_features: tuple[str, ...]  # candidate features that the network does not get
    dropped_kinds: tuple[str, ...]  # candidate features of the kinds that the network may not choose
    robot_speed_mps: Positive  # used for computing the features
    training: Training
    package_version: str
    commit: str  # commit of the exporting sources, "unknown" outside a repository
    metrics: dict[str, Number]
    sha256: str  # hash of the ONNX file, hexadecimal
    normalisation: str = ""  # ignored; written before 0.22


def metadata_path(path: Path) -> Path:
    """Return the path of the JSON file of an ONNX file."""
    return path.with_suffix(".json")


def dump(record: Any, path: Path) -> str:
    """Convert a record to JSON text for :func:`parse`; raises ValueError with ``path`` for a wrong type."""
    try:
        text = json.dumps(msgspec.to_builtins(record, builtin_types=(bytes,)), indent=2) + "\n"
    except TypeError as error:
        raise ValueError(f"{path}: cannot be written as JSON: {error}") from None
    parse(type(record), text, path)
    return text


def parse(kind: type[T], text: bytes | str, path: Path) -> T:
    """Parse JSON with exactly the fields and types of ``kind``; other text raises ValueError with field and rule."""
    with located(f"{path}: no JSON that can be read", ValueError, (ValueError, RecursionError)):
        content = json.loads(text, object_pairs_hook=_object)
    with located(path, ValueError):
        result: T = convert(content, kind)
    return result


def read(kind: type[T], path: Path, limit: int = MAX_BYTES) -> T:
    """Read a record from a JSON file of at most ``limit`` bytes; raises ValueError like :func:`parse`."""
    return parse(kind, content_of(path, limit), path)


def read_planner(path: Path) -> tuple[PlannerMetadata, bytes]:
    """Return metadata and content of an ONNX file; raises ValueError if this version cannot run it."""
    model = content_of(path, MAX_BYTES)
    beside = metadata_path(path)
    if not beside.exists():
        raise ValueError(f"{path}: its metadata {beside.name} is missing (pacman-env export writes both)")
    metadata = read(PlannerMetadata, beside, _MAX_METADATA_BYTES)
    with located(beside, ValueError):
        version = metadata.feature_version
        require(version == VERSION, "feature_version", version, f"must be {VERSION!r}")
        for field in ("candidate_features", "global_features", "dropped_features", "dropped_kinds"):
            names = GLOBAL_FEATURES if field == "global_features" else CANDIDATE_FEATURES
            for name in getattr(metadata, field):
                require(name in names, field, name, f"must be names of these features: {', '.join(names)}")
    if metadata.sha256 != hashlib.sha256(model).hexdigest():
        raise ValueError(f"{path}: is damaged, or is not the file that {beside.name} describes (sha256)")
    return metadata, model


def content_of(path: Path, limit: int = MAX_BYTES) -> bytes:
    """Return the content of a file of at most ``limit`` bytes; raises ValueError if it cannot be read."""
    try:
        with path.open("rb") as file:
            content = file.read(limit + 1)
    except OSError as error:
        raise ValueError(f"{path}: cannot be read: {error.strerror}") from None
    if len(content) > limit:
        raise ValueError(f"{path}: size: more than {limit} bytes, must be at most that")
    return content


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    """Return a JSON object as a dict; raises ValueError for duplicate names."""
    values = dict(pairs)
    if len(values) < len(pairs):
        raise ValueError(f"a name is given twice among {', '.join(name for name, _ in pairs)}")
    return values
