"""The pictures of the documentation are those that the code draws."""

from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image as Picture

from pacman_env.render.palette import THEMES, Theme
from tools.common import IMAGES, SUFFIXES
from tools.gallery import PICTURES, save_round

#: Mean difference in grey levels of equal pictures: letters of another OpenCV, a robot a little farther on.
TOLERANCE = 1.2


@pytest.mark.parametrize("name", PICTURES)
def test_committed_picture_equals_current_drawing(name: str) -> None:
    committed, drawn = cv2.imread(str(IMAGES / f"{name}.png"), cv2.IMREAD_COLOR), PICTURES[name]("light")
    assert committed is not None
    assert committed.shape == drawn.shape
    assert np.abs(committed[:, :, ::-1].astype(np.int16) - drawn).mean() <= TOLERANCE


@pytest.mark.parametrize("theme", THEMES)
def test_committed_animation_equals_current_round(tmp_path: Path, theme: Theme) -> None:
    name = f"round{SUFFIXES[theme]}.webp"
    save_round(tmp_path / name, theme)
    with Picture.open(IMAGES / name) as committed, Picture.open(tmp_path / name) as drawn:
        assert getattr(committed, "n_frames", 1) == getattr(drawn, "n_frames", 1) > 100
        assert 800 <= committed.width <= 900
        for moment in (0, 50, -1):
            frames = []
            for film in (committed, drawn):
                film.seek(moment % getattr(film, "n_frames", 1))
                frames.append(np.asarray(film.convert("RGB"), dtype=np.int16))
            assert np.abs(frames[0] - frames[1]).mean() <= TOLERANCE
    assert (IMAGES / name).stat().st_size < 450_000
