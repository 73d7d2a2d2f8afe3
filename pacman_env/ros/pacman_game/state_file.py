"""A small JSON file that outlives its node; it is written whole and ignored when too old."""

import contextlib
import json
import os
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pacman_env.files import user_folder
from pacman_env.ros.node import parameter

_FORMAT = 4
_LARGEST = 1_000_000  # bytes


class StateFile:
    """State file of one owner, described by the plain values ``owner``; if ``path`` is None, nothing is saved.

    Content of another owner, or older than ``max_age_s`` of wall time, is not loaded.
    """

    def __init__(self, path: Path | None, max_age_s: float, owner: Mapping[str, Any]) -> None:
        self.path = path
        self._max_age_s, self._owner = max_age_s, dict(owner)

    @classmethod
    def of_node(cls, node: Any, text: str, max_age_s: float) -> "StateFile":
        """Declare the parameter ``state_file`` of a node, described by ``text``, and return the selected file."""
        setting = parameter(node, "state_file", "auto", f"{text}; auto: in the user's state folder; empty: none")
        domain, namespace = os.environ.get("ROS_DOMAIN_ID") or "0", node.get_namespace()
        name = f"{node.get_name()}-{namespace.strip('/').replace('/', '-') or 'root'}-{domain}.json"
        path = user_folder("state") / name if setting == "auto" else Path(setting) if setting else None
        simulated = bool(node.get_parameter("use_sim_time").value)
        return cls(path, max_age_s, {"namespace": namespace, "domain": domain, "simulated": simulated})

    def load(self) -> Any:
        """Return the last state; None if nothing was saved, if another owner saved it, or if it is too old.

        Raises OSError, or ValueError with the reason, if the file is of another kind and must not be overwritten.
        """
        if self.path is None or not self.path.exists():
            return None
        if not self.path.is_file():
            raise ValueError("not a file")
        with self.path.open("rb") as file:
            text = file.read(_LARGEST + 1)
        if not text.strip():  # left by a power cut
            return None
        if len(text) > _LARGEST:
            raise ValueError(f"more than {_LARGEST} bytes")
        try:
            whole = json.loads(text)
            is_current, written_s = whole["format"] == _FORMAT, float(whole["written_s"])
            owner, state = whole["owner"], whole["state"]
        except (ValueError, TypeError, LookupError, OverflowError, RecursionError):
            raise ValueError("damaged, or something else") from None
        if not is_current:
            raise ValueError("of another version")
        return state if owner == self._owner and abs(time.time_ns() * 1e-9 - written_s) <= self._max_age_s else None

    def save(self, state: Any) -> None:
        """Write ``state`` (plain values) to the file; after an OSError the file may still contain the old state."""
        if self.path is None:
            return
        whole = {"format": _FORMAT, "written_s": time.time_ns() * 1e-9, "owner": self._owner, "state": state}
        self.path.parent.mkdir(parents=True, exist_ok=True)
        temporary = self.path.with_name(f".{self.path.name}.tmp")  # a fixed name: a kill leaves at most one such file
        temporary.write_text(json.dumps(whole))
        os.replace(temporary, self.path)

    def remove(self) -> None:
        """Remove the file; ignore an OSError, because an old file is not loaded anyway."""
        if self.path is not None:
            with contextlib.suppress(OSError):
                self.path.unlink(missing_ok=True)
