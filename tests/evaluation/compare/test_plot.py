from __future__ import annotations

from pathlib import Path

import imageio.v3 as imageio
import pytest

from pacman_env.evaluation.compare.plot import save_plot
from tests.evaluation.compare.test_table import rows


@pytest.mark.parametrize("endless", [False, True])
def test_plot_is_png_with_one_band_per_speed(tmp_path: Path, endless: bool) -> None:
    path, speeds = tmp_path / "plot.png", (0.25, 0.3, 0.35)
    save_plot([row for speed in speeds for row in rows(speed=speed, endless=endless)], path, "title")
    assert path.read_bytes().startswith(b"\x89PNG")
    image = imageio.imread(path)
    assert image.shape[1] > 1000
    assert image.shape[0] > 150 * (1 + len(speeds))
    assert image.std() > 10  # something is drawn
    assert list(tmp_path.iterdir()) == [path]
