"""A window that shows frames on the screen, with pygame.

pygame is imported when the first window is made: everything else works without it.
"""

from __future__ import annotations

import os
from typing import Any

import numpy as np
from numpy.typing import NDArray


class HumanWindow:
    """A window for RGB frames. Once its user has closed it, it stays closed and showing does nothing."""

    def __init__(self, caption: str = "PacManBot") -> None:
        """Find pygame; the window opens with the first frame.

        Raises:
            ImportError: pygame is not installed.
        """
        os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
        try:
            import pygame
        except ImportError as error:
            raise ImportError("a window needs pygame: pip install pacman_env[render]") from error
        self._pygame: Any = pygame
        self._caption = caption
        self._screen: Any = None
        self._clock: Any = None
        self.closed = False

    def show(self, frame: NDArray[np.uint8], fps: float) -> bool:
        """Show a frame (H, W, 3) and wait so that calls come ``fps`` times a second at most; 0: do not wait.

        Returns:
            Whether the window is still open.
        """
        pygame = self._pygame
        if self.closed:
            return False
        size = (frame.shape[1], frame.shape[0])
        if self._screen is None:
            pygame.display.init()
            pygame.display.set_caption(self._caption)
            self._clock = pygame.time.Clock()
        if self._screen is None or self._screen.get_size() != size:
            self._screen = pygame.display.set_mode(size)
        self._screen.blit(pygame.surfarray.make_surface(frame.swapaxes(0, 1)), (0, 0))
        pygame.display.flip()
        if any(event.type == pygame.QUIT for event in pygame.event.get()):
            self.close()
            return False
        self._clock.tick(fps)
        return True

    def close(self) -> None:
        """Close the window for good; closing twice is harmless."""
        self.closed = True
        if self._screen is not None:
            self._screen = None
            self._pygame.display.quit()
