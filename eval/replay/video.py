"""Films as files. What is seen in them is drawn in ``watching``."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eval.files import replaced

SPEED_UP = 4.0
_LAST_FRAME_S = 1.5  # of film, so that the end can be seen

Frame = NDArray[np.uint8]


def save_video(frames: Iterator[Frame], path: Path, tick_s: float) -> None:
    """Write frames, ``tick_s`` apart and of even sides, as .mp4 or .gif, ``SPEED_UP`` times as fast.

    Raises:
        ModuleNotFoundError: imageio is missing.
    """
    import imageio.v2 as imageio

    fps = SPEED_UP / tick_s
    with replaced(path) as temporary:
        if path.suffix == ".gif":
            writer = imageio.get_writer(temporary, mode="I", duration=1000 / fps, loop=0)
        else:
            writer = imageio.get_writer(temporary, fps=fps, codec="libx264", macro_block_size=2)
        with writer:
            for frame in frames:
                writer.append_data(frame)
            for _ in range(round(_LAST_FRAME_S * fps)):
                writer.append_data(frame)
