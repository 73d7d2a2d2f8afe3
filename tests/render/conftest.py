"""A screen for windows, where there is none."""

from typing import Any

import pytest


@pytest.fixture
def pygame(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Return pygame with SDL's dummy screen."""
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    return pytest.importorskip("pygame")
