"""What is read from metadata, and what is refused: each time with file, field, value and rule."""

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

from pacman_env.observations.planner_features import CANDIDATE_FEATURES, GLOBAL_FEATURES, VERSION
from pacman_env.policies.metadata import (
    FORMAT,
    MAX_BYTES,
    PlannerMetadata,
    Training,
    dump,
    metadata_path,
    parse,
    read_planner,
)

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


def test_written_planner_is_read_again(tmp_path: Path) -> None:
    assert read_planner(written(tmp_path)) == (METADATA, MODEL)


@given(st.dictionaries(st.text(), st.floats(-1e300, 1e300, exclude_min=True, exclude_max=True)))
def test_metrics_and_line_ups_are_read_again(metrics: dict[str, float]) -> None:
    training = structs.replace(TRAINING, ghosts=("wander", "arcade,chase"))
    metadata = structs.replace(METADATA, metrics=metrics, training=training)
    assert parse(PlannerMetadata, dump(metadata, HERE), HERE) == metadata


def test_file_without_line_ups_means_one_wanderer(tmp_path: Path) -> None:
    metadata, _ = read_planner(written(tmp_path, lambda content: content["training"].pop("ghosts")))
    assert metadata.training.ghosts == ("wander",)


def test_normalisation_of_older_file_is_ignored(tmp_path: Path) -> None:
    read, _ = read_planner(written(tmp_path, lambda content: content.update(normalisation="of 0.21")))
    assert structs.replace(read, normalisation="") == METADATA
    assert "normalisation" not in dump(METADATA, HERE)


@pytest.mark.parametrize("field", FIELDS)
def test_missing_or_wrong_field_is_named(field: str, tmp_path: Path) -> None:
    group, _, name = field.rpartition(".")

    def remove(content: dict[str, Any]) -> None:
        del owner(content, field)[0][name]

    if field != "training.ghosts":  # which files of old do not have
        place = f"{group}: " if group else ""
        with pytest.raises(ValueError, match=rf"mine\.json: {place}Object missing required field `{name}`"):
            read_planner(written(tmp_path, remove))
    for value in (None, True, [None]):
        path = written(tmp_path, lambda content, value=value: owner(content, field)[0].update({name: value}))
        with pytest.raises(ValueError, match=rf"mine\.json: {re.escape(field)}(\[0\])? = .*: Expected "):
            read_planner(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"format": 2, "more": 0}, r"format = 2: must be one of \(1,\)"),
        ({"feature_version": VERSION + 1}, f"feature_version = {VERSION + 1}: must be {VERSION}"),
        ({"candidate_features": ["is_pellet", "colour"]}, "candidate_features = 'colour': must be .*is_pellet"),
        ({"global_features": ["is_pellet"]}, "global_features = 'is_pellet': must be .*clyde_distance"),
        ({"dropped_features": ["colour"]}, "dropped_features = 'colour': must be .*is_pellet"),
        ({"robot_speed_mps": 0}, r"robot_speed_mps = 0: Expected `float` > 0"),
        ({"robot_speed_mps": 10**400}, "robot_speed_mps = 10+: Number out of range"),
        ({"metrics": {"completion": float("nan")}}, r"metrics\.completion = nan: must be a finite number"),
        ({"colour": "red"}, "Object contains unknown field `colour`"),
    ],
)
def test_field_unfit_for_this_version_is_named(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    path = written(tmp_path, lambda content: content.update(changes))
    with pytest.raises(ValueError, match=rf"mine\.json: {message}"):
        read_planner(path)


def test_changed_model_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path)
    path.write_bytes(MODEL + b".")
    with pytest.raises(ValueError, match=r"mine\.onnx: is damaged, or is not the file that mine\.json describes"):
        read_planner(path)


def test_metadata_that_is_no_object_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path)
    for content in (b"{", b"\xff\xfe{}", b"[" * 100_000, b'{"format": 1, "format": 1}', b"[]"):
        metadata_path(path).write_bytes(content)
        with pytest.raises(ValueError, match=r"mine\.json: (no JSON that can be read|content = )"):
            read_planner(path)


def test_missing_and_large_files_are_refused(tmp_path: Path) -> None:
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
def test_invalid_content_raises_value_error_naming_file(content: object) -> None:
    with pytest.raises(ValueError, match=r"^mine\.json: "):
        parse(PlannerMetadata, json.dumps(content), HERE)


def test_unreadable_metadata_is_not_written() -> None:
    for changes in ({"metrics": {"completion": float("inf")}}, {"width": "64"}, {"commit": b"unknown"}):
        with pytest.raises(ValueError, match=r"^mine\.json: "):
            dump(structs.replace(METADATA, **changes), HERE)
