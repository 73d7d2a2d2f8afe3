"""The recognition of ghosts by their moves, on a tiny run."""

import pytest

from benchmarks.belief import main


def test_command_prints_each_ghost_of_each_line_up(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--map", "loop", "--quick", "--games", "2", "--policies", "nearest"]) == 0
    printed = capsys.readouterr().out
    for ghosts in (1, 3):
        for behaviour in ("wander", "arcade", "chase"):
            assert f"nearest {ghosts} {behaviour} 0.35" in printed
