"""A window that shows frames on the screen and hears keys and clicks, with pygame.

pygame is imported when the first window is made: everything else works without it.
"""

from __future__ import annotations

import os
import sys
from collections import deque
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

_KEPT_INPUTS = 256
_SHIFTED = "?+"  # keys named by the character that they give, whatever the layout


class Input(NamedTuple):
    """One thing that the user of a window did."""

    kind: str  # "press" or "release" of a key, or "click" of the left mouse button
    key: str = ""  # pygame's name of the key, that of the key pad's 1 being "1" too
    at: tuple[int, int] = (0, 0)  # column, row of the frame, px


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
        self._initialized = False
        self._inputs: deque[Input] = deque(maxlen=_KEPT_INPUTS)
        self.closed = False

    def require_screen(self) -> None:
        """Make sure that somebody can see the window: without a screen, SDL draws into the void.

        Raises:
            OSError: there is no screen, and ``SDL_VIDEODRIVER`` does not ask for a pretended one.
        """
        asked_for = "SDL_VIDEODRIVER" in os.environ
        seen = asked_for or sys.platform != "linux" or not {"DISPLAY", "WAYLAND_DISPLAY"}.isdisjoint(os.environ)
        if seen:
            self._initialized = True
            try:
                self._pygame.display.init()
                seen = asked_for or self._pygame.display.get_driver() not in ("offscreen", "dummy")
            except self._pygame.error:
                seen = False
        if not seen:
            self.close()
            raise OSError("no screen to open a window on")

    @property
    def caption(self) -> str:
        """The text on the window's frame."""
        return self._caption

    @caption.setter
    def caption(self, text: str) -> None:
        if text != self._caption and self._screen is not None:
            self._pygame.display.set_caption(text)
        self._caption = text

    def inputs(self) -> list[Input]:
        """All that the user did until the last ``show``, oldest first; each is given once, at most the last 256."""
        heard = list(self._inputs)
        self._inputs.clear()
        return heard

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
            self._initialized = True
            pygame.display.init()
            pygame.display.set_caption(self._caption)
            self._clock = pygame.time.Clock()
        if self._screen is None or self._screen.get_size() != size:
            self._screen = pygame.display.set_mode(size)
        self._screen.blit(pygame.surfarray.make_surface(frame.swapaxes(0, 1)), (0, 0))
        pygame.display.flip()
        for event in pygame.event.get():
            if event.type == pygame.QUIT:
                self.close()
                return False
            self._hear(event)
        self._clock.tick(fps)
        return True

    def _hear(self, event: Any) -> None:
        pygame = self._pygame
        if event.type == pygame.MOUSEBUTTONDOWN and event.button == 1:
            self._inputs.append(Input("click", at=(event.pos[0], event.pos[1])))
        elif event.type in (pygame.KEYDOWN, pygame.KEYUP):
            character = getattr(event, "unicode", "")
            name = character if character and character in _SHIFTED else pygame.key.name(event.key).strip("[]")
            self._inputs.append(Input("press" if event.type == pygame.KEYDOWN else "release", name))

    def close(self) -> None:
        """Close the window for good; closing twice is harmless."""
        self.closed = True
        self._screen = None
        if self._initialized:
            self._initialized = False
            self._pygame.display.quit()
