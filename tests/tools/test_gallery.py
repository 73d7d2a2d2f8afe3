"""The pictures of the documentation are those that the code draws."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image as Picture

from tools.common import IMAGES
from tools.gallery import PICTURES, save_round

#: Mean difference in grey levels of equal pictures: letters of another OpenCV, a robot a little farther on.
TOLERANCE = 1.2


@pytest.mark.parametrize("name", PICTURES)
def test_committed_picture_equals_current_drawing(name: str) -> None:
    committed, drawn = cv2.imread(str(IMAGES / f"{name}.png"), cv2.IMREAD_COLOR), PICTURES[name]()
    assert committed is not None
    assert committed.shape == drawn.shape
    assert np.abs(committed[:, :, ::-1].astype(np.int16) - drawn).mean() <= TOLERANCE


def test_committed_animation_equals_current_round(tmp_path: Path) -> None:
    save_round(tmp_path / "round.webp")
    with Picture.open(IMAGES / "round.webp") as committed, Picture.open(tmp_path / "round.webp") as drawn:
        assert getattr(committed, "n_frames", 1) == getattr(drawn, "n_frames", 1) > 100
        assert 480 <= committed.width <= 720
        for moment in (0, 50, -1):
            frames = []
            for film in (committed, drawn):
                film.seek(moment % getattr(film, "n_frames", 1))
                frames.append(np.asarray(film.convert("RGB"), dtype=np.int16))
            assert np.abs(frames[0] - frames[1]).mean() <= TOLERANCE
    assert (IMAGES / "round.webp").stat().st_size < 400_000
