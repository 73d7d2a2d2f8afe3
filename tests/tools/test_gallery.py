"""The pictures of the documentation are those that the code draws."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from tools.common import IMAGES
from tools.gallery import PICTURES, main, sheet

#: Mean difference in grey levels of equal pictures: letters of another OpenCV, a robot a little farther on.
TOLERANCE = 1.2


@pytest.mark.parametrize("name", PICTURES)
def test_committed_picture_equals_current_drawing(name: str) -> None:
    committed, drawn = cv2.imread(str(IMAGES / f"{name}.png"), cv2.IMREAD_COLOR), PICTURES[name]()
    assert committed is not None
    assert committed.shape == drawn.shape
    assert np.abs(committed[:, :, ::-1].astype(np.int16) - drawn).mean() <= TOLERANCE


def test_picture_is_identical_when_drawn_again(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        assert main(["ghosts", "--out", str(tmp_path / folder)]) == 0
    assert (tmp_path / "a" / "ghosts.png").read_bytes() == (tmp_path / "b" / "ghosts.png").read_bytes()
    assert [path.name for path in (tmp_path / "a").iterdir()] == ["ghosts.png"]


def test_sheet_contains_every_picture_in_full() -> None:
    pictures = [np.full((20 + k, 30 - k, 3), 10 * k, dtype=np.uint8) for k in range(5)]
    page = sheet(pictures, 2, [str(k) for k in range(5)])
    for k, picture in enumerate(pictures):
        assert (page == 10 * k).all(axis=2).sum() >= picture.shape[0] * picture.shape[1]
    assert page.shape[1] == 30 + 29 + 3 * 10
