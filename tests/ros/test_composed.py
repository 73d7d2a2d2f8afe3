"""The nodes of a game that share one process: each is a node as before, and they end together."""

from __future__ import annotations

import signal
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import psutil
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from pacman_env.ros import topics
from pacman_env.ros.supervisor.game_nodes import (
    COMPOSED,
    GAME,
    NAMESPACE,
    REFEREE,
    SELECTOR,
    SIMULATOR,
    WAIT,
    GameSetup,
)

if TYPE_CHECKING:
    from tests.ros.system import Probe, System

PATIENCE_S = 240.0


def test_composed_game_is_three_processes_and_page() -> None:
    processes = GameSetup("house", sim=True, composed=True, web=8000).first_processes
    assert processes == (SIMULATOR, COMPOSED, WAIT, "operator_page")


def test_composed_nodes_play_round_and_end_together(system: System, probe: Probe, tmp_path: Path) -> None:
    extra: dict[str, dict[str, Any]] = {REFEREE: {"state_file": str(tmp_path / "game_controller.json")}}
    shows = ("show.start_s=1.0", "show.death_s=1.0")
    game = GameSetup("house", "clyde_aware", NAMESPACE, True, 10.0, settings=shows, extra=extra, composed=True)
    probe.record(topics.GAME_STATE, topics.GAME_COMMAND, topics.SCORE, topics.CONFIGURATION)
    processes = {
        name: system.run(name, [sys.executable, "-m", *game.command(name)]) for name in (SIMULATOR, COMPOSED, SELECTOR)
    }
    probe.wait_for(lambda: "menu" in probe.values(topics.GAME_STATE), PATIENCE_S, "the menu")
    probe.wait_for(lambda: set(GAME) <= set(probe.node.get_node_names()), PATIENCE_S, "all nodes by name")
    probe.wait_for(lambda: probe.call(topics.START_GAME).success, PATIENCE_S, "the start")
    probe.wait_for(lambda: "running" in probe.values(topics.GAME_STATE), PATIENCE_S, "the round")
    probe.wait_for(lambda: probe.values(topics.SCORE)[-1:] > [0], PATIENCE_S, "a pellet")
    resident_mb = [psutil.Process(processes[name].popen.pid).memory_info().rss / 1e6 for name in (COMPOSED, SELECTOR)]
    assert sum(resident_mb) < 400.0
    probe.forget()
    processes[COMPOSED].send(signal.SIGINT)
    probe.wait_for(lambda: "disable" in probe.values(topics.GAME_COMMAND), PATIENCE_S, "the referee's last command")
    assert processes[COMPOSED].wait() == 0


def test_lock_step_game_is_not_composed() -> None:
    with pytest.raises(ValueError, match="composed: a lock-step game is one process anyway"):
        GameSetup("house", sim=True, lock_step=True, composed=True)
