"""File with a pose jump that no person has answered, so that a restarted goal selector still knows it."""

import contextlib
from typing import Any

from pacman_env.ros.nodes.state_file import StateFile

_MAX_AGE_S = 600.0  # wall time; a jump of an older game must not stop a new game


class SavedJump:
    def __init__(self, node: Any) -> None:
        self._node, self._saved = node, ""
        text = "file for a pose jump until it is answered"
        self._file = StateFile.of_node(node, text, _MAX_AGE_S, "-goal_selector")

    def load(self) -> str:
        """Return the text of the unanswered jump; empty if there is none."""
        try:
            content = self._file.load()
        except (ValueError, OSError) as error:
            self._node.get_logger().warning(f"{self._file.path} is left alone: {error}; nothing is saved")
            self._file.path = None
            return ""
        self._saved = content[:500] if isinstance(content, str) else ""
        return self._saved

    def save(self, jump: str) -> None:
        if jump == self._saved:
            return
        self._saved = jump
        if not jump:
            self._file.remove()
            return
        with contextlib.suppress(OSError):  # the node still has the jump in memory
            self._file.save(jump)
