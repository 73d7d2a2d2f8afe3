"""The file that outlives a node: what comes back out of it, and what does not."""

import os
from pathlib import Path
from typing import Any

import pytest

from pacman_env.ros.pacman_game.state_file import StateFile

ME = {"namespace": "/robot_15", "simulated": False}


def test_saved_state_is_loaded_until_removed(tmp_path: Path) -> None:
    path = tmp_path / "new" / "game.json"
    file = StateFile(path, 60.0, ME)
    assert file.load() is None
    for score in (1, 2):
        file.save({"score": score})
    assert StateFile(path, 60.0, ME).load() == {"score": 2}
    assert os.listdir(path.parent) == ["game.json"]
    file.remove()
    file.remove()
    assert file.load() is None


def test_old_or_foreign_state_is_ignored(tmp_path: Path) -> None:
    path = tmp_path / "game.json"
    StateFile(path, 60.0, ME).save(1)
    assert StateFile(path, 60.0, {**ME, "simulated": True}).load() is None
    assert StateFile(path, 0.0, ME).load() is None
    written = path.read_text()
    for written_s in (1.0, 9e9):  # or the clock was set back
        path.write_text(written.replace(written.split('"written_s": ')[1].split(",")[0], str(written_s)))
        assert StateFile(path, 60.0, ME).load() is None


@pytest.mark.parametrize(
    "text",
    [
        *("no json", "[]", "3", "{}", '{"format": 2}', "[" * 100_000, "\0", "1" * 1_000_001),
        '{"format": 1, "written_s": 0, "owner": {}, "state": 0}',
        '{"format": 2, "written_s": "x", "owner": {}, "state": 0}',
    ],
    ids=range(10),
)
def test_invalid_file_is_an_error_and_stays(tmp_path: Path, text: str) -> None:
    path = tmp_path / "game.json"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"damaged|another version|more than"):
        StateFile(path, 60.0, ME).load()
    assert path.read_text() == text


def test_interrupted_write_keeps_last_state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = StateFile(tmp_path / "game.json", 60.0, ME)
    file.save("old")

    def cut_off(source: Any, target: Any) -> None:
        raise OSError("killed")

    with monkeypatch.context() as patch:
        patch.setattr(os, "replace", cut_off)
        with pytest.raises(OSError, match="killed"):
            file.save("new")
    assert file.load() == "old"
    file.save("newer")
    assert file.load() == "newer"
    assert os.listdir(tmp_path) == ["game.json"]


def test_empty_file_and_no_path_are_nothing(tmp_path: Path) -> None:
    (tmp_path / "game.json").touch()
    assert StateFile(tmp_path / "game.json", 60.0, ME).load() is None
    file = StateFile(None, 60.0, ME)
    file.save(1)
    file.remove()
    assert file.load() is None


def test_folder_in_place_of_file_is_an_error(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="not a file"):
        StateFile(tmp_path, 60.0, ME).load()
