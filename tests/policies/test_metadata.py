"""What is read from metadata, and what is refused: each time with file, field, value and rule."""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from pacman_env.policies.metadata import (
    FORMAT,
    MAX_BYTES,
    NORMALISATION,
    PlannerMetadata,
    Training,
    dump,
    metadata_path,
    parse,
    read_planner,
)
from pacman_env.sim.observation.planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES, VERSION

MODEL = b"the network"
TRAINING = Training((0.2, 0.5), (0.22, 0.31), "generated:train", "robot", "robust", 1000, 7)
METADATA = PlannerMetadata(
    format=FORMAT,
    feature_version=VERSION,
    candidate_features=CANDIDATE_FEATURES,
    global_features=GLOBAL_FEATURES,
    width=64,
    dropped_features=CANDIDATE_FEATURES[4:6],
    dropped_kinds=(),
    normalisation=NORMALISATION,
    robot_speed_mps=0.256,
    training=TRAINING,
    package_version="1.0",
    commit="unknown",
    metrics={"completion": 0.9},
    sha256=hashlib.sha256(MODEL).hexdigest(),
)
HERE = Path("mine.json")


def written(folder: Path, change: Callable[[dict[str, Any]], object] = lambda _: None) -> Path:
    """A file with its metadata, in which something was changed."""
    path = folder / "mine.onnx"
    path.write_bytes(MODEL)
    content = json.loads(dump(METADATA, HERE))
    change(content)
    metadata_path(path).write_text(json.dumps(content))
    return path


def places(content: dict[str, Any], prefix: str = "") -> list[str]:
    """The dotted names of all fields, those of nested objects included."""
    names = []
    for name, value in content.items():
        names.append(prefix + name)
        if isinstance(value, dict) and name != "metrics":
            names += places(value, f"{prefix}{name}.")
    return names


FIELDS = places(json.loads(dump(METADATA, HERE)))


def owner(content: dict[str, Any], field: str) -> tuple[dict[str, Any], str]:
    *outer, name = field.split(".")
    for one in outer:
        content = content[one]
    return content, name


def test_what_was_written_is_read_again(tmp_path: Path) -> None:
    assert read_planner(written(tmp_path)) == (METADATA, MODEL)


@given(st.dictionaries(st.text(), st.floats(-1e300, 1e300, exclude_min=True, exclude_max=True)))
def test_any_metrics_are_read_as_they_were(metrics: dict[str, float]) -> None:
    metadata = structs.replace(METADATA, metrics=metrics)
    assert parse(PlannerMetadata, dump(metadata, HERE), HERE) == metadata


def test_a_file_without_line_ups_is_of_a_planner_trained_against_one_wandering_ghost(tmp_path: Path) -> None:
    metadata, _ = read_planner(written(tmp_path, lambda content: content["training"].pop("ghosts")))
    assert metadata.training.ghosts == ("wander",)


def test_line_ups_are_read_as_they_were_written() -> None:
    metadata = structs.replace(METADATA, training=structs.replace(TRAINING, ghosts=("wander", "arcade,chase")))
    assert parse(PlannerMetadata, dump(metadata, HERE), HERE) == metadata


@pytest.mark.parametrize("field", sorted({*FIELDS} - {"training.ghosts"}))
def test_a_missing_field_is_named(field: str, tmp_path: Path) -> None:
    def remove(content: dict[str, Any]) -> None:
        place, name = owner(content, field)
        del place[name]

    path = written(tmp_path, remove)
    group, _, name = field.rpartition(".")
    place = f"{group}: " if group else ""
    with pytest.raises(ValueError, match=rf"mine\.json: {place}Object missing required field `{name}`"):
        read_planner(path)


@pytest.mark.parametrize("field", FIELDS)
@pytest.mark.parametrize("value", [None, True, [None]], ids=str)
def test_a_field_of_another_type_is_named(field: str, value: object, tmp_path: Path) -> None:
    def spoil(content: dict[str, Any]) -> None:
        place, name = owner(content, field)
        place[name] = value

    path = written(tmp_path, spoil)
    with pytest.raises(ValueError, match=rf"mine\.json: {re.escape(field)}(\[0\])? = .*: Expected "):
        read_planner(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": 2, "more": 0}, r"format = 2: must be one of \(1,\)"),
        ({"format": 1.0}, r"format = 1\.0: Expected `int`"),
        ({"feature_version": VERSION + 1}, f"feature_version = {VERSION + 1}: must be {VERSION}"),
        (
            {"candidate_features": list(CANDIDATE_FEATURES[::-1])},
            r"candidate_features = \('.*: must be .*is_pellet",
        ),
        ({"candidate_features": list(CANDIDATE_FEATURES[1:])}, "candidate_features = .*: must be .*is_pellet"),
        ({"global_features": []}, r"global_features = \(\): must be .*clyde_distance"),
        ({"normalisation": "none"}, "normalisation = 'none': must be .*planner_features"),
        ({"dropped_features": ["colour"]}, "dropped_features = 'colour': must be names of candidate features"),
        ({"dropped_kinds": ["ghost"]}, "dropped_kinds = 'ghost': must be names of candidate features"),
        ({"robot_speed_mps": 0}, r"robot_speed_mps = 0: Expected `float` > 0"),
        ({"robot_speed_mps": 10**400}, "robot_speed_mps = 10+: Number out of range"),
        ({"metrics": {"completion": float("nan")}}, r"metrics\.completion = nan: must be a finite number"),
        ({"metrics": {"completion": "high"}}, r"metrics\.completion = 'high': Expected `float`"),
        ({"width": 64.0}, r"width = 64\.0: Expected `int`"),
        ({"colour": "red"}, "Object contains unknown field `colour`"),
    ],
)
def test_what_does_not_fit_this_version_is_named(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    path = written(tmp_path, lambda content: content.update(changes))
    with pytest.raises(ValueError, match=rf"mine\.json: {message}"):
        read_planner(path)


def test_a_range_has_two_ends(tmp_path: Path) -> None:
    path = written(tmp_path, lambda content: content["training"].update(clyde_speeds_mps=[0.2]))
    with pytest.raises(ValueError, match=r"training\.clyde_speeds_mps = \[0\.2\]: Expected `array` of length 2"):
        read_planner(path)


def test_a_model_that_was_changed_since_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path)
    path.write_bytes(MODEL + b".")
    with pytest.raises(ValueError, match=r"mine\.onnx: is damaged, or is not the file that mine\.json describes"):
        read_planner(path)


@pytest.mark.parametrize(
    "content",
    [b"", b"{", b"\xff\xfe{}", b"[" * 100_000, b'{"format": 1, "format": 1}', b"[]", b"null", b"1"],
    ids=["empty", "cut", "encoding", "deep", "twice", "list", "null", "number"],
)
def test_what_is_no_object_is_refused(content: bytes, tmp_path: Path) -> None:
    path = written(tmp_path)
    metadata_path(path).write_bytes(content)
    with pytest.raises(ValueError, match=r"mine\.json: (no JSON that can be read|content = )"):
        read_planner(path)


def test_missing_and_too_large_files_are_named(tmp_path: Path) -> None:
    path = written(tmp_path)
    metadata_path(path).unlink()
    with pytest.raises(ValueError, match=r"mine\.onnx: its metadata mine\.json is missing \(pacman-env export writes"):
        read_planner(path)
    with path.open("r+b") as file:
        file.truncate(MAX_BYTES + 1)
    with pytest.raises(ValueError, match=rf"mine\.onnx: size: more than {MAX_BYTES} bytes"):
        read_planner(path)
    path.unlink()
    with pytest.raises(ValueError, match=r"mine\.onnx: cannot be read: No such file"):
        read_planner(path)


@given(
    st.recursive(
        st.none() | st.booleans() | st.integers() | st.floats() | st.text(),
        lambda inner: st.lists(inner) | st.dictionaries(st.sampled_from([*FIELDS, "more"]), inner),
        max_leaves=20,
    )
)
def test_whatever_it_holds_the_answer_is_a_value_error_with_the_file(content: object) -> None:
    with pytest.raises(ValueError, match=r"^mine\.json: "):
        parse(PlannerMetadata, json.dumps(content), HERE)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"metrics": {"completion": float("inf")}}, r"metrics\.completion = inf"),
        ({"width": "64"}, "width = '64': Expected `int`"),
        ({"commit": b"unknown"}, "cannot be written as JSON"),
    ],
)
def test_what_could_not_be_read_is_not_written(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=rf"^mine\.json: {message}"):
        dump(structs.replace(METADATA, **changes), HERE)
