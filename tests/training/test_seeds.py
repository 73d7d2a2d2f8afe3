"""Several seeds are several trainings, each to the bit; what is finished is kept, and nothing half-written."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from filelock import FileLock

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")

from pacman_env.executors.base import InProcess
from pacman_env.training import seeds, train
from pacman_env.training.seeds import Trained, forget, train_all, train_member
from tests.training.test_arguments import tiny
from tests.training.test_run import same, weights

CHANGES = {"evaluation": 4, "decisions": 64}


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of members that are not written yet; compiled code stays where it is."""
    monkeypatch.setattr(seeds, "cache_dir", lambda: tmp_path / "cache")
    return tmp_path / "cache" / "seeds"


def left(cache: Path) -> list[Path]:
    """The folders of members, without their locks."""
    return [path for path in cache.iterdir() if path.is_dir()]


@pytest.mark.daily
def test_each_seed_trains_like_a_run_alone(cache: Path, tmp_path: Path) -> None:
    told = train_all(tiny(**CHANGES), [3, 5], tmp_path / "seeds", InProcess())
    lines = told.splitlines()
    assert [line.split(" | ")[0] for line in lines[2:4]] == ["| 3", "| 5"]
    assert lines[-1].startswith("2 seeds: mean ")
    for seed in (3, 5):
        train.train(tiny(tmp_path / str(seed), seed=seed, **CHANGES))
        member = tmp_path / "seeds" / f"seed-{seed}"
        assert same(weights(member / "last.zip"), weights(tmp_path / str(seed) / "last.zip"))
        names = {path.name for path in member.iterdir() if not path.name.startswith("events.")}
        assert {"run.json", "planner.onnx", "planner.json", "member.json"} <= names
    written = json.loads((tmp_path / "seeds" / "seeds.json").read_text())
    assert [one["seed"] for one in written["members"]] == [3, 5]


def test_finished_member_is_not_trained_again(cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first = train_all(tiny(**CHANGES), [1], tmp_path, InProcess())
    monkeypatch.setattr(seeds, "train_member", lambda arguments: pytest.fail("trained again"))
    assert train_all(tiny(**CHANGES), [1], tmp_path, InProcess()) == first
    with pytest.raises(ValueError, match=r"seed-1/member\.json: was started with decisions = 64, not 128"):
        train_all(tiny(**{**CHANGES, "decisions": 128}), [1], tmp_path, InProcess())
    record = tmp_path / "seed-1" / "member.json"
    figures = json.loads(record.read_text())
    record.write_text(json.dumps({name: value for name, value in figures.items() if name != "completed_against"}))
    with pytest.raises(ValueError, match=r"seed-1/member\.json: of another version, without 'completed_against'"):
        train_all(tiny(**CHANGES), [1], tmp_path, InProcess())
    record.write_text("{")
    with pytest.raises(ValueError, match=r"seed-1/member\.json: cannot be read"):
        train_all(tiny(**CHANGES), [1], tmp_path, InProcess())


@pytest.mark.parametrize("content", [{"seed-5/notes.txt": "mine"}, {"seed-5": "a file"}])
def test_foreign_member_folder_is_refused_before_training(
    content: dict[str, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(seeds, "train_member", lambda arguments: pytest.fail("trained"))
    for name, text in content.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=r"seed-5: has no member\.json: move it away or give another --out"):
        train_all(tiny(**CHANGES), [1, 5], tmp_path, InProcess())
    assert {name: (tmp_path / name).read_text() for name in content} == content


def test_unwritten_member_is_written_next_time_without_training(
    cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    out = tmp_path / "out"
    write = seeds._write

    def too_late(out: Path, trained: Trained) -> None:
        (out / "seed-1" / "others").mkdir(parents=True)
        write(out, trained)

    with monkeypatch.context() as patch:
        patch.setattr(seeds, "_write", too_late)
        with pytest.raises(OSError, match="seed-1"):
            train_all(tiny(**CHANGES), [1], out, InProcess())
    (out / "seed-1").rename(tmp_path / "moved")
    (folder,) = left(cache)
    before = (folder / "run.json").read_bytes()  # with the seconds that it took
    train_all(tiny(**CHANGES), [1], out, InProcess())
    assert (out / "seed-1" / "run.json").read_bytes() == before
    assert left(cache) == []


def test_training_locked_by_another_process_is_kept(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(seeds, "_WAIT_S", 0.1)
    folder = seeds._cached(tiny(**CHANGES))
    folder.mkdir(parents=True)
    (folder / "run.json").write_text("of the other")
    with FileLock(folder.with_suffix(".lock")):
        with pytest.raises(ValueError, match=rf"{folder}: another command trains the same there"):
            train_member(tiny(**CHANGES))
        forget(tiny(**CHANGES))
        assert (folder / "run.json").read_text() == "of the other"
    forget(tiny(**CHANGES))
    assert left(cache) == []


def test_training_is_kept_if_its_device_is_missing(cache: Path) -> None:
    arguments = tiny(**CHANGES, device="cuda:99")
    folder = seeds._cached(arguments)
    folder.mkdir(parents=True)
    (folder / "run.json").write_text("on the device")
    with pytest.raises(ValueError, match="device = 'cuda:99': cannot be used"):
        train_member(arguments)
    assert (folder / "run.json").read_text() == "on the device"


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Trained]:
    """The cache folder with a member that is not written yet, and the member."""
    folder = tmp_path_factory.mktemp("finished")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(seeds, "cache_dir", lambda: folder)
        return folder / "seeds", train_member(tiny(**CHANGES))


@pytest.mark.parametrize(
    "damage",
    [
        lambda folder: (folder / "run.json").write_text(""),
        lambda folder: (folder / "segment-0.zip").unlink(),
        lambda folder: (folder / "run.json").rename(folder / "remains.json"),
    ],
    ids=["torn", "half-removed", "half-removed-without-its-record"],
)
def test_damaged_training_starts_again(
    damage: Callable[[Path], object], finished: tuple[Path, Trained], cache: Path
) -> None:
    before, whole = finished
    shutil.copytree(before, cache)
    (folder,) = left(cache)
    damage(folder)
    again = train_member(tiny(**CHANGES))
    assert len(again.files) == len(whole.files)  # no remains; TensorBoard's have a time in their names
    assert again.files["planner.onnx"] == whole.files["planner.onnx"]


def test_seed_given_twice_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"seeds = \[1, 1\]: a seed is given twice"):
        train_all(tiny(), [1, 1], tmp_path, InProcess())
