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
from pacman_env.ros.game_nodes import GAME, SELECTOR, SIMULATOR, module_of
from pacman_env.ros.simulated_robot.sim_robot import FAULT
from pacman_env.ros.standstill import LEASE
from tests.map_parts import part_of_map
from tests.ros.system import Probe, Process, System

LIMIT_S = 240.0  # of real time, for anything that happens at all
# No round is lost.
SETTINGS = ["clyde.speed_mps=0.02", "execution.death_radius_m=0.001", "show.start_s=2", "show.death_s=2"]
OWN: dict[str, dict[str, Any]] = {
    SIMULATOR: {"speed": 10.0},
    SELECTOR: {"policy": "lookahead", "home": "[0.0, 0.0, 0.0]"},
}
WITH_MAP = (SIMULATOR, "pellet_manager", "clyde_ghost_node", SELECTOR)
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
        processes: dict[str, Process] = {}

        def start(name: str) -> None:
            own = {**OWN.get(name, {}), **({"map_yaml": ground} if name in WITH_MAP else {})}
            processes[name] = system.start(module_of(name), use_sim_time=True, settings=SETTINGS, **own)

        def kill(name: str) -> None:
            processes[name].popen.kill()
            processes[name].popen.wait()
            system.processes.remove(processes[name])

        probe.record(*RECORDED)
        for name in (SIMULATOR, *GAME, SELECTOR):
            start(name)
        probe.wait_for(lambda: "policy lookahead" in processes[SELECTOR].output, LIMIT_S, "the planner")
        probe.wait_for(lambda: probe.values(STATE)[-1:] == ["menu"], LIMIT_S, "the referee")
        assert probe.call(topics.START_GAME).success
        probe.wait_for(lambda: any(probe.values(COLLECTED)), LIMIT_S, "a pellet")
        probe.publish(FAULT, "reject")  # no round ends while nodes come up
        for name in (*GAME, SELECTOR):
            kill(name)
            start(name)
        for name in (*GAME, SELECTOR):
            probe.answered_by(f"{system.namespace}/{name}", anew=True)
        probe.wait_for(lambda: probe.values(STATE)[-1] == "running", LIMIT_S, "the round")
        probe.publish(FAULT, "end reject")
        probe.wait_for(lambda: any(probe.values(RESULT)), LIMIT_S, "the end of the round")
        (spawned,) = {value for value in probe.values(SPAWNED) if value}
        assert probe.values(RESULT)[-1] == f"Complete - Score: {spawned}"
        probe.wait_for(lambda: probe.values(SCORE)[-1] == spawned, LIMIT_S, "the score")
        assert "Traceback" not in system.outputs()
        for name in list(processes):  # how they end in order is tested elsewhere
            kill(name)
