"""Real processes of a game that are killed or frozen come back, and every point counts; ``kills.py`` does it longer."""

from pathlib import Path

from tests.ros import kills


def test_killed_and_frozen_processes_lose_no_point(domain: int, tmp_path: Path) -> None:
    result = kills.play(domain, tmp_path, kills.SHORT, seed=2)
    assert result["wrong"] == []
    assert result["status"] == 0
    assert result["score"] > 0
