"""The pictures of the documentation are those that the code draws."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from tools import gallery
from tools.common import IMAGES
from tools.gallery import PICTURES, difference, main, sheet


@pytest.mark.parametrize("name", PICTURES)
def test_the_committed_picture_is_drawn_now(name: str) -> None:
    assert difference(IMAGES / f"{name}.png", PICTURES[name]()) <= gallery.TOLERANCE


def test_a_picture_is_drawn_alike_each_time(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        assert main(["ghosts", "--out", str(tmp_path / folder)]) == 0
    assert (tmp_path / "a" / "ghosts.png").read_bytes() == (tmp_path / "b" / "ghosts.png").read_bytes()
    assert main(["ghosts", "--out", str(tmp_path / "a"), "--check"]) == 0
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["ghosts.png"]


def test_check_finds_another_picture_and_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["round", "--out", str(tmp_path), "--check"]) == 1
    cv2.imwrite(str(tmp_path / "round.png"), np.zeros_like(PICTURES["round"]()))
    assert main(["round", "--out", str(tmp_path), "--check"]) == 1
    assert capsys.readouterr().out.count("run scripts/gallery round") == 2


def test_bad_arguments_are_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit, match="2"):
        main(["nothing"])
    assert "no picture 'nothing'" in capsys.readouterr().err
    (tmp_path / "file").touch()
    assert main(["round", "--out", str(tmp_path / "file")]) == 2
    assert "cannot create its folder" in capsys.readouterr().err


def test_a_sheet_holds_every_picture_in_its_place() -> None:
    pictures = [np.full((20 + k, 30 - k, 3), 10 * k, dtype=np.uint8) for k in range(5)]
    page = sheet(pictures, 2, [str(k) for k in range(5)])
    for k, picture in enumerate(pictures):
        assert (page == 10 * k).all(axis=2).sum() >= picture.shape[0] * picture.shape[1]
    assert page.shape[1] == 30 + 29 + 3 * 10
