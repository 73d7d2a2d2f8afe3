"""One small JSON file that outlives a node: whole or absent, and ignored after a while."""

import contextlib
import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ..surroundings import current

_FORMAT = 3
_LARGEST = 1_000_000  # bytes


class StateFile:
    """The file, or none; what another owner, described by plain values, has left behind is ignored.

    What was written longer than ``max_age_s`` of wall time ago is not loaded.
    """

    def __init__(self, path: Path | None, max_age_s: float, owner: Mapping[str, Any]) -> None:
        self.path = path
        self._max_age_s, self._owner = max_age_s, dict(owner)
        self._time_ns = current().time_ns

    def load(self) -> Any:
        """The state saved last; None if there is none of this owner's, or too long ago.

        Raises OSError, or ValueError with the reason why the file is of another kind and must not be overwritten.
        """
        if self.path is None or not self.path.exists():
            return None
        if not self.path.is_file():
            raise ValueError("not a file")
        with self.path.open("rb") as file:
            text = file.read(_LARGEST + 1)
        if not text.strip():  # as a power cut leaves a file
            return None
        if len(text) > _LARGEST:
            raise ValueError(f"more than {_LARGEST} bytes")
        try:
            whole = json.loads(text)
            known, written_s = whole["format"] == _FORMAT, float(whole["written_s"])
            owner, state = whole["owner"], whole["state"]
        except (ValueError, TypeError, LookupError, OverflowError, RecursionError):
            raise ValueError("damaged, or something else") from None
        if not known:
            raise ValueError("of another version")
        return state if owner == self._owner and abs(self._time_ns() * 1e-9 - written_s) <= self._max_age_s else None

    def save(self, state: Any) -> None:
        """Write plain values in place of those saved before; if that raises OSError, these may still be there."""
        if self.path is None:
            return
        whole = {"format": _FORMAT, "written_s": self._time_ns() * 1e-9, "owner": self._owner, "state": state}
        self.path.parent.mkdir(parents=True, exist_ok=True)
        temporary = self.path.with_name(f".{self.path.name}.tmp")  # one name: a kill leaves at most one behind
        temporary.write_text(json.dumps(whole))
        os.replace(temporary, self.path)

    def remove(self) -> None:
        """Remove the file; one that cannot be removed will be too old soon."""
        if self.path is not None:
            with contextlib.suppress(OSError):
                self.path.unlink(missing_ok=True)
