"""What is known of a policy that was learned: the metadata of its ONNX file, as words for showing."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import msgspec

from pacman_env.policies.learned import PRETRAINED
from pacman_env.policies.metadata import read_planner

_LONGEST = 80  # characters shown of a value


def model_facts(spec: str) -> dict[str, str]:
    """The metadata of ``FILE.onnx``, or of the planner that the package ships, by dotted name; {} for other policies.

    Raises:
        ValueError: the file is no planner for this version.
    """
    path = PRETRAINED if spec == "ppo" else Path(spec)
    if path.suffix != ".onnx":
        return {}
    return dict(_flat(msgspec.to_builtins(read_planner(path)[0])))


def _flat(facts: dict[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    result = []
    for name, value in facts.items():
        if isinstance(value, dict):
            result += _flat(value, f"{prefix}{name}.")
        else:
            words = ", ".join(map(str, value)) if isinstance(value, tuple) else str(value)
            result.append((prefix + name, words if len(words) <= _LONGEST else words[: _LONGEST - 1] + "…"))
    return result
