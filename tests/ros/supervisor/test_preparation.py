"""What processes of their own prepare for a game, and which nodes wait for them."""

from __future__ import annotations

import os
import sys
from pathlib import Path
from subprocess import Popen
from typing import Any

import pytest

pytest.importorskip("rclpy")

from pacman_env.ros.supervisor import preparation as preparation_module
from pacman_env.ros.supervisor.game_nodes import COMPOSED, GAME, LOCK_STEP, REFEREE, SELECTOR, GameSetup
from pacman_env.ros.supervisor.preparation import GHOSTS, Preparation
from pacman_env.ros.supervisor.processes import ProcessGroup
from tests.waiting import wait_for

#: Becomes the command that follows, as soon as a file is there.
WAITS = """
import os, sys, time
while not os.path.exists(sys.argv[1]):
    time.sleep(0.02)
os.execv(sys.argv[2], sys.argv[2:])
"""


def test_nodes_that_need_nothing_of_it_do_not_wait_and_the_others_until_it_is_done(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    go_on = tmp_path / "go on"

    def waiting(command: list[str], **options: Any) -> Popen[str]:
        return Popen([sys.executable, "-c", WAITS, str(go_on), *command], **options)

    monkeypatch.setattr(preparation_module, "Popen", waiting)  # it would be done before the test has looked
    reports: list[str] = []
    preparation = Preparation(GameSetup("house", "nearest", sim=True), reports.append)
    try:
        assert preparation.holds(SELECTOR)
        assert preparation.holds(LOCK_STEP)
        assert [name for name in GAME if preparation.holds(name) and name != GHOSTS] == []
        go_on.touch()
        preparation.check()
        wait_for(lambda: not preparation.holds(LOCK_STEP), LOCK_STEP)
        assert [name for name in (*GAME, COMPOSED, SELECTOR) if preparation.holds(name)] == []
        assert preparation.words == ""
    finally:
        preparation.close()
    assert reports == []


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"policy": "brave"}, "unknown policy 'brave'"),
        ({"settings": ("clyde.ghosts=policy",)}, "clyde.ghosts"),
    ],
)
def test_what_is_wrong_is_known_before_anything_else_is_compiled(fields: dict[str, object], words: str) -> None:
    preparation = Preparation(GameSetup("house", **fields), print)  # type: ignore[arg-type]
    try:
        with pytest.raises(ValueError, match=words):
            preparation.check()
    finally:
        preparation.close()


def test_a_process_that_is_held_starts_as_soon_as_it_is_not(tmp_path: Path) -> None:
    held = {REFEREE}
    (tmp_path / f"{REFEREE}.log").write_text("of an earlier game")
    group = ProcessGroup(lambda name: ["platform"], tmp_path, dict(os.environ), print, held=lambda name: name in held)
    group.start(REFEREE)
    assert group.tend() == []
    assert REFEREE in group
    assert group.ids() == {}
    held.clear()
    group.tend()
    assert list(group.ids()) == [REFEREE]
    assert group.stop() == []
    assert "earlier" not in (tmp_path / f"{REFEREE}.log").read_text()
