"""The command that measures how long a game takes to start and to stop; how long it takes is not looked at."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from benchmarks import start_stop
from pacman_env.engine.cache_folder import cache_dir


@pytest.mark.daily
def test_the_moments_of_a_start_follow_one_another(domain: int) -> None:
    moments = start_stop.measure(start_stop.ROOT, cache_dir(), "house", "nearest", int(os.environ["ROS_DOMAIN_ID"]))
    assert sorted(moments) == sorted(start_stop.COLUMNS)
    assert 0.0 < moments["first line"] < moments["menu"] < moments["drives"]
    assert moments["stop"] > 0.0


def test_a_folder_that_is_no_checkout_is_one_line(
    domain: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(start_stop, "ROOT", empty)
        patch.setenv("PYTHONPATH", str(empty))
        assert start_stop.main(["--map", "nowhere", "--domain-id", str(domain)]) == 2
    assert "does not drive" in capsys.readouterr().err
