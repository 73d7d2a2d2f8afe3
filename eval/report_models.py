"""What is known of a policy that was learned: the facts file beside a model, read as plain data for showing."""

from __future__ import annotations

import json
from importlib import resources
from pathlib import Path
from typing import Any

_LARGEST = 1_000_000  # bytes; a facts file has some thousand
_LONGEST = 80  # characters shown of a value


def model_facts(spec: str) -> dict[str, str]:
    """The facts beside ``FILE.onnx``, or of a planner that the package ships, by dotted name; {} where there are none.

    Raises:
        ValueError: the file is no JSON object, or far too large for one.
    """
    if spec.endswith(".onnx"):
        file: Any = Path(spec).with_suffix(".json")
    elif spec.replace("_", "").isalnum():
        file = resources.files("pacman_env.policies") / "pretrained" / f"{spec}.json"
    else:
        return {}
    if not file.is_file():
        return {}
    text = file.read_text(encoding="utf-8")
    if len(text) > _LARGEST:
        raise ValueError(f"{file}: {len(text)} characters are too many for a model's facts")
    try:
        facts = json.loads(text)
    except ValueError as error:
        raise ValueError(f"{file}: no JSON: {error}") from None
    if not isinstance(facts, dict):
        raise ValueError(f"{file}: must hold a JSON object")
    return dict(_flat(facts))


def _flat(facts: dict[str, Any], prefix: str = "") -> list[tuple[str, str]]:
    result = []
    for name, value in facts.items():
        if isinstance(value, dict):
            result += _flat(value, f"{prefix}{name}.")
        else:
            words = ", ".join(map(str, value)) if isinstance(value, list) else str(value)
            result.append((prefix + name, words if len(words) <= _LONGEST else words[: _LONGEST - 1] + "…"))
    return result
