"""Window that shows frames with pygame, and the rendering methods of environments.

pygame is only imported when a window is created.
"""

import os
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from ..files import install_command
from .palette import Theme


class HumanWindow:
    """A window for RGB frames; after the user has closed it, it stays closed and ignores frames."""

    def __init__(self) -> None:
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        try:
            import pygame
        except ImportError as error:
            raise ImportError(f"a window needs pygame: {install_command('render')}") from error
        self._pygame: Any = pygame
        self._clock: Any = None  # None: no window is open
        self.closed = False

    def show(self, frame: NDArray[np.uint8], fps: float) -> bool:
        """Show a frame (H, W, 3), limit the rate to ``fps`` (0: no limit), and return True if the window is open."""
        pygame = self._pygame
        if self.closed:
            return False
        if self._clock is None:
            pygame.display.init()
            self._clock = pygame.time.Clock()
            pygame.display.set_caption("PacManBot")
        screen, size = pygame.display.get_surface(), frame.shape[1::-1]
        if screen is None or screen.get_size() != size:
            screen = pygame.display.set_mode(size)
        screen.blit(pygame.surfarray.make_surface(frame.swapaxes(0, 1)), (0, 0))
        pygame.display.flip()
        for event in pygame.event.get():
            if event.type == pygame.QUIT:
                self.close()
                return False
        self._clock.tick(fps)
        return True

    def close(self) -> None:
        self.closed = True
        if self._clock is not None:
            self._clock = None
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
