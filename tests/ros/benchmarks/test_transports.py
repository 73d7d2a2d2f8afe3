"""The command that compares transports, in a short run; how long a message takes is not looked at."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from benchmarks import transports


def test_messages_are_answered_over_each_transport(domain: int, tmp_path: Path) -> None:
    out = tmp_path / "transports.json"
    words = ["--rounds", "1", "--messages", "5", "--domain-id", str(domain), "--json", str(out)]
    assert transports.main(words) == 0
    figures = json.loads(out.read_text())
    for size in transports.SIZES:
        for name in transports.TRANSPORTS:
            assert 0.0 < figures[f"{size}, {name}"]["median_ms"] <= figures[f"{size}, {name}"]["p99_ms"]
