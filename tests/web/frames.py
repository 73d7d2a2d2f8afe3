"""Frames from the messages that a page receives."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from pacman_env.web.frame import Frame


def _to_array(kind: Any, values: Any) -> NDArray[Any]:
    """Of the dtype that the field declares."""
    return np.array(values, dtype=kind.__args__[1].__args__[0])


def decode(message: str | bytes) -> Frame:
    """A frame; ValueError if the message is none."""
    try:
        return msgspec.json.decode(message, type=Frame, dec_hook=_to_array)
    except (msgspec.DecodeError, RecursionError) as error:
        raise ValueError(f"no frame: {error}") from error


def decode_all(message: bytes) -> list[Frame]:
    """The frames of a recorded round."""
    return msgspec.json.decode(message, type=list[Frame], dec_hook=_to_array)
