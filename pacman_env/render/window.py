"""A window that shows frames on the screen and collects keys and clicks, with pygame; what of it an environment shows.

pygame is imported when the first window is made: everything else works without it.
"""

import os
import sys
from collections import deque
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ..files import install_command

_KEPT_INPUTS = 256
_SHIFTED = "?+"  # keys named by the character that they give, whatever the layout


class Input(NamedTuple):
    kind: str  # "press" or "release" of a key, or "click" of the left mouse button
    key: str = ""  # pygame's name of the key, that of the key pad's 1 being "1" too
    at: tuple[int, int] = (0, 0)  # column, row of the frame, px


class HumanWindow:
    """A window for RGB frames. Once its user has closed it, it stays closed and showing does nothing."""

    def __init__(self, caption: str = "PacManBot") -> None:
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        try:
            import pygame
        except ImportError as error:
            raise ImportError(f"a window needs pygame: {install_command('render')}") from error
        self._pygame: Any = pygame
        self._clock: Any = None  # opened with the first frame
        self._initialized = False
        self._inputs: deque[Input] = deque(maxlen=_KEPT_INPUTS)
        self.caption = caption
        self.closed = False

    def require_screen(self) -> None:
        """Raise OSError where there is no screen, unless ``SDL_VIDEODRIVER`` asks for a dummy one."""
        display = self._pygame.display
        dummy_asked = "SDL_VIDEODRIVER" in os.environ
        found = dummy_asked or sys.platform != "linux" or not {"DISPLAY", "WAYLAND_DISPLAY"}.isdisjoint(os.environ)
        if found:
            self._initialized = True
            try:
                display.init()
                found = dummy_asked or display.get_driver() not in ("offscreen", "dummy")
            except self._pygame.error:
                found = False
        if not found:
            self.close()
            raise OSError("no screen to open a window on")

    def inputs(self) -> list[Input]:
        """All that the user did until the last ``show``, oldest first; each once, at most the last 256."""
        inputs = list(self._inputs)
        self._inputs.clear()
        return inputs

    def show(self, frame: NDArray[np.uint8], fps: float) -> bool:
        """Show a frame (H, W, 3) and limit the rate to ``fps``, 0: no limit; returns whether the window is open."""
        pygame = self._pygame
        if self.closed:
            return False
        if self._clock is None:
            self._initialized = True
            pygame.display.init()
            self._clock = pygame.time.Clock()
        pygame.display.set_caption(self.caption)
        screen, size = pygame.display.get_surface(), frame.shape[1::-1]
        if screen is None or screen.get_size() != size:
            screen = pygame.display.set_mode(size)
        screen.blit(pygame.surfarray.make_surface(frame.swapaxes(0, 1)), (0, 0))
        pygame.display.flip()
        for event in pygame.event.get():
            if event.type == pygame.QUIT:
                self.close()
                return False
            if event.type == pygame.MOUSEBUTTONDOWN and event.button == 1:
                self._inputs.append(Input("click", at=(event.pos[0], event.pos[1])))
            elif event.type in (pygame.KEYDOWN, pygame.KEYUP):
                character = getattr(event, "unicode", "")
                name = character if character and character in _SHIFTED else pygame.key.name(event.key).strip("[]")
                self._inputs.append(Input("press" if event.type == pygame.KEYDOWN else "release", name))
        self._clock.tick(fps)
        return True

    def close(self) -> None:
        self.closed = True
        if self._initialized:
            self._initialized = False
            self._pygame.display.quit()


RENDER_FPS = 2  # one frame per decision, in real time


class Display:
    """``render``, ``close`` and copies of an environment with ``render_mode``, ``started`` and ``batch``."""

    _window: Any = None

    def render(self: Any) -> NDArray[np.uint8] | None:
        """A picture (720, W, 3) uint8 in mode ``rgb_array``; in mode ``human`` it goes to a window.

        Raises ResetNeeded before the first reset.
        """
        if self.render_mode is None:
            gym.logger.warn("render() without render_mode: pass render_mode='rgb_array' or 'human'")
            return None
        if not self.started:
            raise gym.error.ResetNeeded("call reset() before render()")
        from .frames import render_frame

        frame = render_frame(self.batch, 0)
        if self.render_mode == "rgb_array":
            return frame
        if self._window is None:
            self._window = HumanWindow()
        self._window.show(frame, RENDER_FPS)
        return None

    def close(self) -> None:
        """Close the window, if there is one."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_window": None}  # a copy opens its own window
