"""A run goes on where it was interrupted, to the same bits; what does not fit is refused by name, never unpickled."""

import dataclasses
import hashlib
import io
import json
import shutil
import zipfile
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

import torch

from pacman_env.training.arguments import Arguments
from pacman_env.training.checkpoint import Run, read_facts
from pacman_env.training.export import network_of
from pacman_env.training.ppo import train
from tests.training.planners import random_planner
from tests.training.test_arguments import tiny

State = dict[str, torch.Tensor]


class _Interrupted(Exception):
    pass


def interrupt(_: dict[str, Any]) -> None:
    raise _Interrupted


def weights(path: Path) -> State:
    """Of a checkpoint: network and optimizer."""
    with zipfile.ZipFile(path) as archive:
        network, optimizer = (
            torch.load(io.BytesIO(archive.read(name)), weights_only=True)
            for name in ("policy.pth", "policy.optimizer.pth")
        )
    moments = {f"{k}.{name}": value for k, state in optimizer["state"].items() for name, value in state.items()}
    return {**network, **moments, "rate": torch.tensor(optimizer["param_groups"][0]["lr"])}


def same(one: State, other: State) -> bool:
    return one.keys() == other.keys() and all(torch.equal(one[name], other[name]) for name in one)


def curve(folder: Path) -> list[dict[str, Any]]:
    """Of run.json, without how long it took."""
    segments = json.loads((folder / "run.json").read_text())["segments"]
    return [{k: v for k, v in record.items() if k not in ("seconds", "decisions_per_s")} for record in segments]


def again(arguments: Arguments, **changes: Any) -> Arguments:
    return dataclasses.replace(arguments, resume=True, **changes)


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Arguments:
    """A run of three segments against two line-ups, finished at once."""
    sizes = {"decisions": 192, "evaluation": 3, "ghosts": ["wander", "arcade,chase"], "teacher_nodes": 221}
    arguments = tiny(tmp_path_factory.mktemp("whole") / "run", **sizes)
    train(arguments)
    return arguments


@pytest.fixture(scope="module")
def begun(whole: Arguments, tmp_path_factory: pytest.TempPathFactory) -> Arguments:
    """The same run, interrupted after its first segment; not to be written to."""
    arguments = dataclasses.replace(whole, out=tmp_path_factory.mktemp("begun") / "run")
    with pytest.raises(_Interrupted):
        train(arguments, interrupt)
    return arguments


@pytest.fixture
def broken(begun: Arguments, tmp_path: Path) -> Arguments:
    """A copy of it to resume."""
    shutil.copytree(begun.out, tmp_path / "run")
    return again(begun, out=tmp_path / "run")


def test_run_writes_curve_and_best_and_last_checkpoint(whole: Arguments) -> None:
    assert [(record["segment"], record["decisions"]) for record in curve(whole.out)] == [(0, 64), (1, 128), (2, 192)]
    names = {path.name for path in whole.out.iterdir() if not path.name.startswith("events.")}
    files = {f"{name}{suffix}" for name in ("last", "best", "segment-2") for suffix in (".zip", ".facts.json")}
    assert names == {"run.json", *files}
    assert same(weights(whole.out / "last.zip"), weights(whole.out / "segment-2.zip"))
    facts = read_facts(whole.out / "last.facts.json")
    assert (facts.training.decisions, facts.training.seed) == (192, 0)
    assert facts.training.clyde_speeds_mps == whole.hyper.clyde_speed
    assert facts.training.ghosts == ("wander", "arcade,chase")
    assert {tuple(record["completed_against"]) for record in curve(whole.out)} == {("wander", "arcade,chase")}


@pytest.mark.parametrize("writing", [False, True])
def test_interrupted_run_resumes_to_same_bits(writing: bool, whole: Arguments, broken: Arguments) -> None:
    assert len(curve(broken.out)) == 1
    if writing:  # checkpoints of a segment that the record does not know yet, one of them torn
        shutil.copy(whole.out / "best.zip", broken.out / "best.zip")
        (broken.out / "segment-1.zip").write_bytes((whole.out / "last.zip").read_bytes()[:999])
        (broken.out / "last.zip").write_bytes(b"")
    seen: list[dict[str, Any]] = []
    folder, _ = train(dataclasses.replace(broken, threads=2), seen.append)
    assert seen == folder.segments == json.loads((broken.out / "run.json").read_text())["segments"]
    assert curve(broken.out) == curve(whole.out)
    for name in ("last.zip", "best.zip"):
        assert same(weights(broken.out / name), weights(whole.out / name)), name


def test_finished_run_is_not_trained_further(whole: Arguments, tmp_path: Path) -> None:
    shutil.copytree(whole.out, tmp_path / "run")
    before, seen = (whole.out / "run.json").read_bytes(), []
    folder, model = train(again(whole, out=tmp_path / "run"), seen.append)
    assert [record["segment"] for record in seen] == [0, 1, 2]
    assert (tmp_path / "run" / "run.json").read_bytes() == before
    saved = weights(whole.out / "last.zip")
    assert all(torch.equal(value, saved[f"network.{name}"]) for name, value in model.network.state_dict().items())
    assert len(folder.segments) == 3


def test_run_is_not_resumed_on_another_device(broken: Arguments) -> None:
    with pytest.raises(ValueError, match="device"):
        Run(dataclasses.replace(broken, device="cuda"))


def test_existing_run_is_not_overwritten(whole: Arguments) -> None:
    before = {path: path.read_bytes() for path in whole.out.iterdir()}
    with pytest.raises(ValueError, match=r"run: there is a run already; give --resume or another --out"):
        train(whole)
    assert {path: path.read_bytes() for path in whole.out.iterdir()} == before


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"seed": 1}, "seed = 0, not 1"),
        ({"without": ("hold",)}, r"without = \[\], not \['hold'\]"),
        ({"preset": "ideal"}, "preset = robot, not ideal"),
        ({"ghosts": ("wander", "chase")}, r"ghosts = \['wander', 'arcade,chase'\], not \['wander', 'chase'\]"),
        ({"gamma": 0.5}, r"gamma = 0\.998, not 0\.5"),
        ({"clyde_speed": (0.2, 0.5)}, r"clyde_speed = \[0\.2, 0\.6\], not \[0\.2, 0\.5\]"),
    ],
)
def test_resuming_with_other_arguments_names_changed_field(
    changes: dict[str, Any], message: str, broken: Arguments
) -> None:
    names = {field.name for field in dataclasses.fields(broken.hyper)}
    if names & changes.keys():
        changes = {"hyper": dataclasses.replace(broken.hyper, **changes)}
    with pytest.raises(ValueError, match=rf"run\.json: was started with {message}"):
        train(dataclasses.replace(broken, **changes))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (None, "no run to resume: .*No such file"),
        ("", "no run to resume"),
        ('{"arguments"', "no run to resume"),
        ("[]", "no run to resume"),
        ('{"arguments": {"hyper": {}}}', "no run to resume: 'segments'"),
        ('{"arguments": {"hyper": {}}, "segments": [3]}', "no run to resume"),
        ('{"arguments": {"hyper": {}}, "segments": [{"segment": 0}]}', "no run to resume: 'completed'"),
        (
            '{"arguments": {"hyper": {}}, "segments": [{"segment": 1, "completed": 0}]}',
            "no run to resume: its segments are not in order",
        ),
        ('{"arguments": [], "segments": []}', "no run to resume"),
    ],
)
def test_invalid_record_is_refused(content: str | None, message: str, broken: Arguments) -> None:
    record = broken.out / "run.json"
    record.unlink() if content is None else record.write_text(content)
    with pytest.raises(ValueError, match=rf"run\.json: {message}"):
        train(broken)


def test_record_of_another_version_names_missing_field(broken: Arguments) -> None:
    content = json.loads((broken.out / "run.json").read_text())
    for field in ("against_league", "again", "decisions"):
        segment = {name: value for name, value in content["segments"][0].items() if name != field}
        (broken.out / "run.json").write_text(json.dumps({**content, "segments": [segment]}))
        message = f"no run to resume: segment 0 of another version, without '{field}'"
        with pytest.raises(ValueError, match=rf"run\.json: {message}"):
            train(broken)
    del content["arguments"]["value_decisions"]
    (broken.out / "run.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match="of another version, without 'value_decisions'"):
        train(broken)


def test_start_begins_from_planner_and_is_recorded(tmp_path: Path) -> None:
    """PPO fits only values, so that the policy stays that of the file."""
    planner = random_planner(tmp_path, width=8)
    arguments = tiny(tmp_path / "run", start=planner, imitation=0, decisions=128, value_decisions=127)
    with pytest.raises(_Interrupted):
        train(arguments, interrupt)
    given, last = network_of(planner).state_dict(), weights(arguments.out / "last.zip")
    assert torch.equal(given["encode.weight"], last["network.encode.weight"])
    assert not torch.equal(given["critic.0.weight"], last["network.critic.0.weight"])
    recorded = json.loads((arguments.out / "run.json").read_text())["arguments"]["start"]
    assert recorded == hashlib.sha256(planner.read_bytes()).hexdigest()
    other = again(arguments, start=random_planner(tmp_path, "other", seed=1, width=8))
    with pytest.raises(ValueError, match=rf"run\.json: was started with start = {recorded}"):
        train(other)
    assert len(train(again(arguments))[0].segments) == 2


def test_planner_to_start_from_may_disappear_later(tmp_path: Path) -> None:
    planner = random_planner(tmp_path, width=8)
    arguments = tiny(tmp_path / "run", start=planner, imitation=0)
    folder, _ = train(arguments, lambda record: planner.unlink(missing_ok=True))
    assert len(folder.segments) == 2
    with pytest.raises(OSError, match="mine"):
        Run(dataclasses.replace(arguments, out=tmp_path / "other"))
    assert not (tmp_path / "other").exists()


def test_learning_rate_falls_over_whole_run(whole: Arguments, begun: Arguments) -> None:
    first, last = whole.hyper.learning_rate
    assert weights(begun.out / "last.zip")["rate"] == pytest.approx(first + (last - first) / 3)
    assert weights(whole.out / "last.zip")["rate"] == pytest.approx(whole.hyper.learning_rate[1])


def test_best_checkpoint_has_highest_validation_or_is_latest(tmp_path: Path) -> None:
    arguments = tiny(tmp_path / "run", decisions=64)
    folder, model = train(arguments)
    saved_at = []
    for segment, share in enumerate((0.5, 0.25, 0.5, 0.75, 0.5), start=1):
        result = {"segment": segment, "decisions": 64, "completed": share}
        folder.write(model.network, model.optimizer, result)
        saved_at.append(read_facts(folder.folder / "best.facts.json").metrics["segment"])
    assert saved_at == [1, 1, 3, 4, 4]


def test_validation_and_losses_are_logged(whole: Arguments) -> None:
    from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

    events = EventAccumulator(str(whole.out)).Reload()
    tags = set(events.Tags()["scalars"])
    assert {"validation/completed", "train/value_loss", "train/learning_rate"} <= tags
    assert {"validation/completed_wander", "validation/completed_arcade_chase"} <= tags
    assert [event.step for event in events.Scalars("validation/completed")] == [64, 128, 192]


def test_unwritable_run_folder_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OSError, match="file"):
        train(tiny(tmp_path / "file"))
