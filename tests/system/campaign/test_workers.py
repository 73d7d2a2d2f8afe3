from __future__ import annotations

import os
import sys
from pathlib import Path

from tests.system.campaign.workers import errors, logged


def test_errors_in_a_log_are_found_and_warnings_are_not() -> None:
    log = """[INFO] [1.0] [robot_15.sim_robot]: faults: none
[WARN] [1.0] [robot_15.sim_robot]: goal rejected
Traceback (most recent call last):
  File "node.py", line 1
[ERROR] [1.0] [robot_15.goal_selector]: no map
"""
    assert errors(log) == ["Traceback (most recent call last):", "[ERROR] [1.0] [robot_15.goal_selector]: no map"]


def test_what_python_and_what_other_code_writes_to_stderr_is_logged_for_as_long_as_the_block_lasts(
    tmp_path: Path, capfd: object
) -> None:
    log = tmp_path / "nodes.log"
    os.write(2, b"before\n")
    with logged(log):
        print("printed by a node", file=sys.__stderr__)
        os.write(2, b"printed by the middleware\n")
    os.write(2, b"after\n")
    with logged(log):
        os.write(2, b"once more\n")
    assert log.read_text().splitlines() == ["printed by a node", "printed by the middleware", "once more"]
