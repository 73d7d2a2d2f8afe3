"""The pictures of the documentation are those that the code draws."""

import cv2
import numpy as np
import pytest

from tools.common import IMAGES
from tools.gallery import PICTURES

#: Mean difference in grey levels of equal pictures: letters of another OpenCV, a robot a little farther on.
TOLERANCE = 1.2


@pytest.mark.parametrize("name", PICTURES)
def test_committed_picture_equals_current_drawing(name: str) -> None:
    committed, drawn = cv2.imread(str(IMAGES / f"{name}.png"), cv2.IMREAD_COLOR), PICTURES[name]()
    assert committed is not None
    assert committed.shape == drawn.shape
    assert np.abs(committed[:, :, ::-1].astype(np.int16) - drawn).mean() <= TOLERANCE
