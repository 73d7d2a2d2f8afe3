"""An environment of one game shows a picture, or a window that is opened when it is first needed."""

from __future__ import annotations

from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

RENDER_FPS = 2  # one frame per decision, in real time


class Display:
    """``render``, ``close`` and copies of an environment with ``render_mode``, ``started`` and ``batch``."""

    _window: Any = None

    def render(self: Any) -> NDArray[np.uint8] | None:
        """A picture (720, W, 3) uint8 in mode ``rgb_array``; in mode ``human`` it goes to a window.

        Raises:
            ResetNeeded: before the first reset.
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
            from .window import HumanWindow

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
