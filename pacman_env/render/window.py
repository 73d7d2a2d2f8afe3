"""Window that shows frames and collects keys and clicks with pygame, and the rendering methods of environments.

pygame is only imported when a window is created.
"""

import os
import sys
from collections import deque
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ..files import install_command
from .palette import Theme

_KEPT_INPUTS = 256
_SHIFTED = "?+"  # keys named by their character, independent of the keyboard layout


class Input(NamedTuple):
    kind: str  # "press" or "release" of a key, or "click" of the left mouse button
    key: str = ""  # pygame's name of the key; keypad digits have the names of digits
    at: tuple[int, int] = (0, 0)  # column, row of the frame, px


class HumanWindow:
    """A window for RGB frames; after the user has closed it, it stays closed and ignores frames."""

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
        """Raise OSError if there is no screen, unless ``SDL_VIDEODRIVER`` selects a dummy."""
        display = self._pygame.display
        uses_dummy = "SDL_VIDEODRIVER" in os.environ
        has_screen = uses_dummy or sys.platform != "linux" or not {"DISPLAY", "WAYLAND_DISPLAY"}.isdisjoint(os.environ)
        if has_screen:
            self._initialized = True
            try:
                display.init()
                has_screen = uses_dummy or display.get_driver() not in ("offscreen", "dummy")
            except self._pygame.error:
                has_screen = False
        if not has_screen:
            self.close()
            raise OSError("no screen to open a window on")

    def inputs(self) -> list[Input]:
        """Return and remove the inputs until the last ``show``, oldest first, at most 256."""
        inputs = list(self._inputs)
        self._inputs.clear()
        return inputs

    def show(self, frame: NDArray[np.uint8], fps: float) -> bool:
        """Show a frame (H, W, 3), limit the rate to ``fps`` (0: no limit), and return True if the window is open."""
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
    """Mixin with ``render``, ``close`` and copying for environments with ``render_mode``, ``started`` and ``batch``."""

    theme: Theme = "light"  #: the colours of the pictures: "light" or "dark"
    _window: Any = None

    def render(self: Any) -> NDArray[np.uint8] | None:
        """Return an image (720, W, 3) uint8 in mode ``rgb_array``, or show it in a window in mode ``human``.

        Raises ResetNeeded before the first reset.
        """
        if self.render_mode is None:
            gym.logger.warn("render() without render_mode: pass render_mode='rgb_array' or 'human'")
            return None
        if not self.started:
            raise gym.error.ResetNeeded("call reset() before render()")
        from .frames import render_frame

        frame = render_frame(self.batch, 0, theme=self.theme)
        if self.render_mode == "rgb_array":
            return frame
        if self._window is None:
            self._window = HumanWindow()
        self._window.show(frame, RENDER_FPS)
        return None

    def close(self) -> None:
        """Close the window, if any."""
        if self._window is not None:
            self._window.close()
            self._window = None

    def __getstate__(self) -> dict[str, Any]:
        return {**self.__dict__, "_window": None}  # copies open their own windows
