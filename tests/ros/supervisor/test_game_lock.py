"""Locks of games: a game that starts or ends on this machine is known before its nodes are."""

import os
import subprocess
import sys

from pacman_env.ros.supervisor.game_lock import GameLock

DOMAIN = 1000 + os.getpid()  # of no game
HOLDER = f"""
from pacman_env.ros.supervisor.game_lock import GameLock
with GameLock("robot_15", {DOMAIN}, True) as lock:
    assert lock.acquire() == ""
    print("held", flush=True)
    input()
"""
IN_NAMESPACE = "a game is in /robot_15 already: another ros up on this machine"
SECOND_CLOCK = "another clock runs in this ROS domain: another ros up on this machine; choose another --domain-id"


def test_second_game_in_namespace_waits_for_first() -> None:
    with GameLock("/robot_15/", DOMAIN, False) as second:
        with GameLock("robot_15", DOMAIN, False) as first:
            assert first.acquire() == ""
            assert second.acquire() == IN_NAMESPACE
            assert first.acquire() == ""  # it holds its lock already
        assert second.acquire() == ""


def test_games_elsewhere_are_free_except_second_clock() -> None:
    with GameLock("robot_15", DOMAIN, True) as first:
        assert first.acquire() == ""
        for other in (
            GameLock("robot_16", DOMAIN, False),
            GameLock("robot_15", DOMAIN - 1, True),
            GameLock("a/b", DOMAIN, False),
        ):
            with other:
                assert other.acquire() == ""
        with GameLock("robot_16", DOMAIN, True) as second:
            assert second.acquire() == SECOND_CLOCK


def test_lock_of_killed_process_is_free() -> None:
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
    with subprocess.Popen([sys.executable, "-c", HOLDER], text=True, **pipes) as process:  # type: ignore[call-overload]
        assert process.stdout.readline() == "held\n"
        with GameLock("robot_15", DOMAIN, True) as lock:
            assert lock.acquire() == IN_NAMESPACE
            process.kill()
            process.wait()
            assert lock.acquire() == ""
