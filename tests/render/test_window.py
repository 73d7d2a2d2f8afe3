"""What the window promises, on SDL's dummy screen."""

import sys
import types
from typing import Any

import numpy as np
import pytest

from pacman_env.render.window import HumanWindow


def frame(height: int = 40, width: int = 60) -> np.ndarray:
    picture = np.zeros((height, width, 3), dtype=np.uint8)
    picture[5, 7] = (255, 140, 26)
    return picture


def test_frames_show_upright_in_their_size_and_colours(pygame: Any) -> None:
    window = HumanWindow()
    for height, width in ((40, 60), (80, 30)):
        assert window.show(frame(height, width), 0)
        screen = pygame.display.get_surface()
        assert screen.get_size() == (width, height)
        assert tuple(screen.get_at((7, 5)))[:3] == (255, 140, 26)
    window.close()


def test_frames_come_no_faster_than_asked_for(pygame: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    waits: list[float] = []
    monkeypatch.setattr(pygame.time, "Clock", lambda: types.SimpleNamespace(tick=waits.append))
    window = HumanWindow()
    for fps in (25, 25, 50):
        window.show(frame(), fps)
    assert waits == [25, 25, 50]  # pygame's clock delays each frame to that rate
    window.close()


def test_closed_window_stays_closed_and_another_opens(pygame: Any) -> None:
    window = HumanWindow()
    assert window.show(frame(), 0)
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    assert not window.show(frame(), 0)
    assert window.closed
    assert not pygame.display.get_init()
    assert not window.show(frame(), 0)
    window.close()
    window.close()
    second = HumanWindow()
    assert second.show(frame(), 0)
    second.close()


def test_missing_pygame_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(ImportError, match=r"pip install .*\[render\]"):
        HumanWindow()
