"""A jump of the pose that no person has answered yet, in a file: it outlives a goal selector that is started again."""

import contextlib
import os
from pathlib import Path
from typing import Any

from pacman_env.files import user_folder
from pacman_env.ros.node import parameter
from pacman_env.ros.nodes.state_file import StateFile

_MAX_AGE_S = 600.0  # of wall time: a game of long ago is not held up


class SavedJump:
    def __init__(self, node: Any) -> None:
        text = "a jump of the pose is kept in it until it is answered; auto: in the user's state folder; empty: none"
        where = parameter(node, "state_file", "auto", text)
        domain, namespace = os.environ.get("ROS_DOMAIN_ID") or "0", node.get_namespace()
        name = f"{namespace.strip('/').replace('/', '-') or 'root'}-{domain}-goal_selector.json"
        path = user_folder("state") / name if where == "auto" else Path(where) if where else None
        simulated = bool(node.get_parameter("use_sim_time").value)
        self._node, self._saved = node, ""
        self._file = StateFile(path, _MAX_AGE_S, {"namespace": namespace, "domain": domain, "simulated": simulated})

    def load(self) -> str:
        """The words of a jump that was not answered; empty if there is none."""
        try:
            saved = self._file.load()
        except (ValueError, OSError) as error:
            self._node.get_logger().warning(f"{self._file.path} is left alone: {error}; nothing is saved")
            self._file.path = None
            return ""
        self._saved = saved[:500] if isinstance(saved, str) else ""
        return self._saved

    def save(self, jump: str) -> None:
        if jump == self._saved:
            return
        self._saved = jump
        if not jump:
            self._file.remove()
            return
        with contextlib.suppress(OSError):  # then it is known as long as the node lives
            self._file.save(jump)
