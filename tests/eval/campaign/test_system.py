from __future__ import annotations

import os
from pathlib import Path

import pytest

from eval.campaign import system
from eval.campaign.system import Lateness, bad_lines
from tests.wall_clock import WallClock


def test_who_does_not_get_a_core_is_late_and_who_takes_turns_is_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    time = WallClock(100.0)
    monkeypatch.setattr(system, "time", time)

    def waited(process: int, seconds: float) -> None:
        (tmp_path / str(process)).mkdir(exist_ok=True)
        (tmp_path / str(process) / "schedstat").write_text(f"7 {round(seconds * 1e9)} 7")

    lateness = Lateness([1, 2, 3], tmp_path)  # the third has gone, and so has this process
    began = time.monotonic()
    for _ in range(55):
        time.now_s += 0.01
        waited(1, time.monotonic() - began)  # all the time
        waited(2, (time.monotonic() - began) / 2)
        lateness.look()
    lags = [lag_s for _, lag_s in lateness.lags]
    assert lags == pytest.approx([0.1, 0.2, 0.3, 0.4], abs=0.02)  # since the first look
    assert time.time_ns() - 0.1e9 <= lateness.lags[-1][0] <= time.time_ns()
    other = Lateness([2], tmp_path)
    for k in range(4):
        waited(2, 0.03 * k)
        time.now_s += Lateness.LOOK_S
        other.look()
    assert other.lags == []


def test_this_process_is_looked_at_too() -> None:
    lateness = Lateness([])
    assert lateness.lags == []
    assert [file.parent.name for file in lateness._files] == [str(os.getpid())]


def test_errors_in_a_log_are_found_and_warnings_are_not() -> None:
    log = """[INFO] [1.0] [robot_15.sim_robot]: faults: none
[WARN] [1.0] [robot_15.sim_robot]: goal rejected
Traceback (most recent call last):
  File "node.py", line 1
[ERROR] [1.0] [robot_15.goal_selector]: no map
"""
    assert bad_lines(log) == ["Traceback (most recent call last):", "[ERROR] [1.0] [robot_15.goal_selector]: no map"]
