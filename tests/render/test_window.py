"""What the window promises, on SDL's dummy screen."""

from __future__ import annotations

import sys
import types

import numpy as np
import pytest

from pacman_env.render.window import HumanWindow


@pytest.fixture(autouse=True)
def _dummy_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")


def frame(height: int = 40, width: int = 60) -> np.ndarray:
    picture = np.zeros((height, width, 3), dtype=np.uint8)
    picture[5, 7] = (255, 140, 26)
    return picture


def test_a_frame_shows_upright_and_in_its_colours() -> None:
    pygame = pytest.importorskip("pygame")
    window = HumanWindow()
    assert window.show(frame(), 0)
    screen = pygame.display.get_surface()
    assert screen.get_size() == (60, 40)
    assert tuple(screen.get_at((7, 5)))[:3] == (255, 140, 26)
    window.close()


def test_the_window_follows_the_size_of_the_frames() -> None:
    pygame = pytest.importorskip("pygame")
    window = HumanWindow()
    window.show(frame(), 0)
    assert window.show(frame(80, 30), 0)
    assert pygame.display.get_surface().get_size() == (30, 80)
    window.close()


def test_frames_come_no_faster_than_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    pygame = pytest.importorskip("pygame")
    waits: list[float] = []
    monkeypatch.setattr(pygame.time, "Clock", lambda: types.SimpleNamespace(tick=waits.append))
    window = HumanWindow()
    for fps in (25, 25, 50):
        window.show(frame(), fps)
    assert waits == [25, 25, 50]  # pygame's clock delays each frame to that rate
    window.close()


def test_its_button_closes_the_window_and_the_program_goes_on() -> None:
    pygame = pytest.importorskip("pygame")
    window = HumanWindow()
    assert window.show(frame(), 0)
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    assert not window.show(frame(), 0)
    assert window.closed
    assert not pygame.display.get_init()
    assert not window.show(frame(), 0)
    window.close()


def test_a_window_can_follow_another_one() -> None:
    pytest.importorskip("pygame")
    first = HumanWindow()
    first.show(frame(), 0)
    first.close()
    first.close()
    second = HumanWindow()
    assert second.show(frame(), 0)
    second.close()


def test_without_pygame_the_error_names_the_extra(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pygame", None)
    with pytest.raises(ImportError, match=r"pip install .*\[render\]"):
        HumanWindow()
