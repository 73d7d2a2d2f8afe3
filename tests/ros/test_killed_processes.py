"""Nodes in processes of their own that are killed with SIGKILL find one another again.

Real processes, ten times real time, on a part of a map; the middleware takes a process for gone after 5 s. What each
node does after its return is in ``test_killed_nodes.py``, that a process ends after a long standstill in
``test_node.py``.
"""

import dataclasses
from pathlib import Path
from typing import Any

import pytest

from pacman_env.ros import topics
from pacman_env.ros.simulated_robot.sim_robot import FAULT
from pacman_env.ros.standstill import LEASE
from pacman_env.ros.supervisor.game_nodes import GAME, SELECTOR, SIMULATOR
from tests.map_parts import part_of_map
from tests.ros.game_processes import GameProcesses
from tests.ros.system import Probe, System

LIMIT_S = 240.0  # of real time, for anything that happens at all
# No round is lost.
SETTINGS = ["clyde.speed_mps=0.02", "execution.death_radius_m=0.001", "show.start_s=2", "show.death_s=2"]
OWN: dict[str, dict[str, Any]] = {
    SIMULATOR: {"speed": 10.0},
    SELECTOR: {"policy": "lookahead", "home": "[0.0, 0.0, 0.0]"},
}
#: Latched topics of which every value is recorded.
RECORDED = STATE, RESULT, SCORE, SPAWNED, COLLECTED = [
    dataclasses.replace(topic, qos=topics.COMMANDS)
    for topic in (
        *(topics.GAME_STATE, topics.GAME_RESULT, topics.SCORE),
        *(topics.PELLETS_SPAWNED, topics.PELLETS_COLLECTED),
    )
]


def test_round_with_killed_nodes_has_right_score(domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv(LEASE, "3600")
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(Path(__file__).with_name("short_lease.xml")))
    # Not through shared memory: a killed process leaves its port there, which its successor may take over.
    monkeypatch.setenv("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    ground = str(part_of_map("loop", 3.0).save(tmp_path / "ground.yaml"))
    with System(tmp_path) as system, Probe(system) as probe:
        game = GameProcesses(probe, system, ground, SETTINGS, OWN)
        probe.record(*RECORDED)
        game.start_all()
        game.wait(lambda: "policy lookahead" in game.processes[SELECTOR].output, "the planner", LIMIT_S)
        game.wait(lambda: probe.values(STATE)[-1:] == ["menu"], "the referee", LIMIT_S)
        assert probe.call(topics.START_GAME).success
        game.wait(lambda: any(probe.values(COLLECTED)), "a pellet", LIMIT_S)
        probe.publish(FAULT, "reject")  # no round ends while nodes come up
        for name in (*GAME, SELECTOR):
            game.kill(name)
            game.start(name)
        for name in (*GAME, SELECTOR):
            probe.answered_by(f"{system.namespace}/{name}", anew=True)
        game.wait(lambda: probe.values(STATE)[-1] == "running", "the round", LIMIT_S)
        probe.publish(FAULT, "end reject")
        game.wait(lambda: any(probe.values(RESULT)), "the end of the round", LIMIT_S)
        (spawned,) = {value for value in probe.values(SPAWNED) if value}
        assert probe.values(RESULT)[-1] == f"Complete - Score: {spawned}"
        game.wait(lambda: probe.values(SCORE)[-1] == spawned, "the score", LIMIT_S)
        assert "Traceback" not in system.outputs()
        game.kill_all()  # how they end in order is tested elsewhere
