"""A lock-step game in a process of its own, watched and asked from outside."""

import os
import signal
import sys
from pathlib import Path

import pytest

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import LOCK_STEP, NAMESPACE, REFEREE, GameSetup
from pacman_env.ros.supervisor.processes import Lost, ProcessGroup
from tests.ros.system import Probe, System
from tests.waiting import PATIENCE_S, wait_for

ROOT = Path(__file__).resolve().parents[3]


@pytest.mark.daily
def test_game_process_ends_with_its_last_messages(system: System, probe: Probe, tmp_path: Path) -> None:
    probe.record(topics.GAME_STATE, topics.GAME_COMMAND, topics.SCORE)
    extra = {REFEREE: {"state_file": str(tmp_path / "game_controller.json")}}
    shows = ("show.start_s=1.0", "show.death_s=1.0")
    setup = GameSetup("house", "clyde_aware", NAMESPACE, True, lock_step=True, settings=shows, extra=extra)
    process = system.run(LOCK_STEP, [sys.executable, "-m", *setup.command(LOCK_STEP)])
    probe.wait_for(lambda: "menu" in probe.values(topics.GAME_STATE), PATIENCE_S, "the menu")
    probe.clear()
    assert probe.call(topics.START_GAME).success
    probe.wait_for(lambda: "running" in probe.values(topics.GAME_STATE), PATIENCE_S, "the round")
    probe.wait_for(lambda: probe.values(topics.GAME_STATE)[-1] == "menu", PATIENCE_S, "the end of the game")
    assert max(probe.values(topics.SCORE)) > 0
    probe.clear()
    process.send(signal.SIGINT)
    probe.wait_for(lambda: "disable" in probe.values(topics.GAME_COMMAND), PATIENCE_S, "the referee's last command")
    assert process.wait() == 0


def test_final_process_is_not_started_again(tmp_path: Path) -> None:
    (tmp_path / "silent.py").write_text("import sys; print('goal_selector has not answered'); sys.exit(70)")
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(tmp_path)])}
    group = ProcessGroup(lambda name: [name], tmp_path, environment, print, final=("silent",))
    group.start("silent")
    with pytest.raises(Lost, match="silent ended with status 70: goal_selector has not answered"):
        wait_for(group.restart_dead, "the end")
    group.stop()
