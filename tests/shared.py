"""Where tests find the real maps, pose logs and golden answers that the project uses but does not ship."""

import os
from pathlib import Path

import pytest

SHARED = Path(os.environ.get("PACMAN_ENV_SHARED") or Path(__file__).resolve().parents[2] / "shared")


def shared_path(relative: str) -> Path:
    """The file or folder; skips the test by its name where it is absent, but fails where ``.ci/run`` requires it."""
    path = SHARED / relative
    if not path.exists():
        message = f"shared data absent: {relative}"
        if os.environ.get("PACMAN_ENV_SHARED_REQUIRED"):  # not CI: hosts that test a clone have no shared data
            pytest.fail(message)
        pytest.skip(message)
    return path
