import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from pacman_env.evaluation.compare.__main__ import main
from pacman_env.evaluation.replay import save_video


def film(path: Path) -> list[NDArray]:
    """All frames; by OpenCV, for imageio's reader leaves the pipes of a finished ffmpeg open."""
    capture, frames = cv2.VideoCapture(str(path)), []
    while True:
        ok, frame = capture.read()
        if not ok:
            capture.release()
            return frames
        frames.append(frame)


@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_film_contains_all_frames_and_holds_last_frame(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"film{suffix}"
    # a white bar that grows, so that no two frames are one to the GIF writer
    frames = (np.where(np.arange(64)[None, :, None] < 6 * k, 255, 0).repeat(48, 0).repeat(3, 2) for k in range(9))
    save_video((f.astype(np.uint8) for f in frames), path, tick_s=0.5)
    assert list(tmp_path.iterdir()) == [path]
    shown = film(path)
    assert {frame.shape for frame in shown} == {(48, 64, 3)}
    brightness = [frame.mean() for frame in shown]
    assert brightness[0] < 10 < 100 < brightness[8]
    if suffix == ".mp4":  # a GIF holds equal frames once
        assert len(shown) == 9 + 1.5 * 8
        assert np.ptp(brightness[8:]) < 1


FULL = """
import resource, sys
import numpy as np
from pathlib import Path
from pacman_env.evaluation.replay import save_video
noise = np.random.default_rng(0)
frames = (noise.integers(0, 256, (96, 128, 3), dtype=np.uint8) for _ in range(int(sys.argv[2])))
resource.setrlimit(resource.RLIMIT_FSIZE, (4096, 4096))  # for ffmpeg, as a full disk is
try:
    save_video(frames, Path(sys.argv[1]), tick_s=0.5)
except OSError as error:
    print(error)
"""


# In a process of its own, which the limit is for; and imageio leaves its pipe open where ffmpeg has died.
@pytest.mark.parametrize("count", [40, 400])  # ffmpeg ends after the last frame, and before it
def test_incomplete_film_is_an_error_and_leaves_nothing(count: int, tmp_path: Path) -> None:
    command = [sys.executable, "-c", FULL, str(tmp_path / "film.mp4"), str(count)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "film.mp4: ffmpeg has not written the whole film" in done.stdout
    assert list(tmp_path.iterdir()) == []


def test_command_writes_film(tmp_path: Path) -> None:
    out = ["--json", str(tmp_path / "r.json"), "--video", str(tmp_path / "film.mp4")]
    assert main(["--episodes", "1", "--policies", "nearest", "--time-limit", "3", *out]) == 0
    shown = film(tmp_path / "film.mp4")
    assert len(shown) == 1 + 3 / 0.5 + 1.5 * 8
    assert shown[0].shape[0] == 720
    assert {p.name for p in tmp_path.iterdir()} == {"r.json", "r.parts", "r.png", "film.mp4"}
