"""Read and write docs/figures.json, which contains the results of all measurements."""

import json
from collections.abc import Iterable
from typing import Any

from benchmarks.harness import machine
from pacman_env.files import commit, write_text
from tools.common import ROOT
from tools.figures.inputs import hashes

FIGURES = ROOT / "docs" / "figures.json"


def read() -> dict[str, Any]:
    """Return the records by name of the measurement."""
    return dict(json.loads(FIGURES.read_text(encoding="utf-8")))


def write(records: dict[str, Any]) -> None:
    """Write the records, with one line for each row of values."""
    write_text(FIGURES, text(records, 0) + "\n")


def record(command: str, inputs: Iterable[str], values: Any) -> dict[str, Any]:
    """Return a record with the version, commit, machine, date and inputs of now."""
    facts = machine()
    return {
        "command": command,
        "version": facts["version"],
        "commit": commit(),
        "machine": f"{facts['cores']} x {facts['processor']}",
        "date": facts["date"],
        "inputs": hashes(inputs),
        "values": values,
    }


def text(value: Any, depth: int) -> str:
    """Return JSON with one line for each row of values; depth 2 is for values in a row."""
    inner = json.dumps(value, ensure_ascii=False)
    if not value or not isinstance(value, dict | list) or (depth > 1 and len(inner) < 600):
        return inner
    indent, entries = " " * depth, []
    for key, one in value.items() if isinstance(value, dict) else enumerate(value):
        name = f"{json.dumps(key)}: " if isinstance(value, dict) else ""
        entries.append(f"{indent} {name}{text(one, depth + 1)}")
    left, right = "{}" if isinstance(value, dict) else "[]"
    return f"{left}\n" + ",\n".join(entries) + f"\n{indent}{right}"
