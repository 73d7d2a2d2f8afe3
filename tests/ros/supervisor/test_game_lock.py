"""Locks of games: a game that starts or ends on this machine is known before its nodes are."""

import subprocess
import sys
from pathlib import Path

import pytest

from pacman_env.ros.supervisor.game_lock import GameLock

HOLDER = """
from pacman_env.ros.supervisor.game_lock import GameLock
with GameLock("robot_15", 7, True) as lock:
    assert lock.acquire() == ""
    print("held", flush=True)
    input()
"""
IN_NAMESPACE = "a game is in /robot_15 already: another ros up on this machine"
SECOND_CLOCK = "another clock runs in this ROS domain: another ros up on this machine; choose another --domain-id"


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the user's states."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    return tmp_path / "state"


def test_second_game_in_namespace_waits_for_first() -> None:
    with GameLock("/robot_15/", 7, False) as second:
        with GameLock("robot_15", 7, False) as first:
            assert first.acquire() == ""
            assert second.acquire() == IN_NAMESPACE
            assert first.acquire() == ""  # it holds its lock already
        assert second.acquire() == ""


def test_games_elsewhere_are_free_except_second_clock() -> None:
    with GameLock("robot_15", 7, True) as first:
        assert first.acquire() == ""
        for other in (GameLock("robot_16", 7, False), GameLock("robot_15", 8, True), GameLock("a/b", 7, False)):
            with other:
                assert other.acquire() == ""
        with GameLock("robot_16", 7, True) as second:
            assert second.acquire() == SECOND_CLOCK


def test_lock_of_killed_process_is_free() -> None:
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", HOLDER], text=True, **pipes) as process:  # type: ignore[call-overload]
        assert process.stdout.readline() == "held\n"
        with GameLock("robot_15", 7, True) as lock:
            assert lock.acquire() == IN_NAMESPACE
            process.kill()
            process.wait()
            assert lock.acquire() == ""


def test_game_without_lock_folder_plays(state: Path) -> None:
    with GameLock("robot_15", 7, True) as lock:
        state.joinpath("pacman_env").rmdir()
        state.joinpath("pacman_env").touch()
        assert lock.acquire() == ""
