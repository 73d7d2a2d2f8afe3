"""The life of a node: bad starts, signals, last messages."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rclpy.clock_type import ClockType
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.time import Time

from pacman_env.config import make_config, parse_settings
from pacman_env.ros import topics
from pacman_env.ros.game_nodes import GAME, SELECTOR
from pacman_env.ros.node import BaseNode, Once
from pacman_env.ros.process import CRASHED, LEASE, STOOD_STILL, event_executor
from tests.ros.session import Session
from tests.ros.system import Probe, Process, System

NODE = "tests.ros.last_messages_node"
LEASE_S = 4.0


def up(probe: Probe, system: System, *arguments: str, **parameters: Any) -> Process:
    process = system.start(NODE, *arguments, **parameters)
    probe.record(topics.GAME_STATE, topics.GAME_COMMAND)
    probe.wait_for(lambda: "here" in probe.values(topics.GAME_STATE), what="the node")
    probe.wait_for(lambda: probe.values(topics.GAME_COMMAND) == ["first"], what="its first command")
    probe.clear()
    return process


def test_older_rclpy_has_another_executor(probe: Probe, monkeypatch: pytest.MonkeyPatch) -> None:
    assert not isinstance(event_executor(probe.context), SingleThreadedExecutor)
    monkeypatch.setitem(sys.modules, "rclpy.experimental.events_executor", None)
    assert isinstance(event_executor(probe.context), SingleThreadedExecutor)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM], ids=lambda n: n.name)
def test_last_messages_arrive_after_signal(probe: Probe, system: System, number: int) -> None:
    process = up(probe, system, words=20)
    process.send(number)
    process.send(number)  # a terminal and a launcher may both send one
    probe.wait_for(lambda: len(probe.values(topics.GAME_COMMAND)) == 20, what="the last messages")
    assert probe.values(topics.GAME_COMMAND) == [f"last {i}" for i in range(20)]
    assert process.wait() == 0
    assert "Traceback" not in process.output


def test_end_waits_for_answer(probe: Probe, system: System) -> None:
    asked = []

    def answer(request: Any, response: Any) -> Any:
        asked.append(request)
        response.success = True
        return response

    topics.RESET_GAME.server(probe.node, answer)
    process = up(probe, system, call=True)
    process.send(signal.SIGTERM)
    probe.wait_for(lambda: asked, what="the last call")
    probe.wait_for(lambda: process.popen.poll() is not None, what="the end")
    assert process.wait() == 0


def test_end_does_not_wait_for_ever(probe: Probe, system: System) -> None:
    topics.RESET_GAME.server(probe.node, lambda request, response: response)  # answers only while the probe spins
    process = up(probe, system, call=True)
    assert process.stop(signal.SIGTERM) == 0  # the probe does not spin meanwhile


def test_failing_callback_ends_node_after_last_messages(probe: Probe, system: System) -> None:
    process = up(probe, system)
    probe.publish(topics.GAME_EVENT, "fail")
    with pytest.raises(AssertionError, match="ZeroDivisionError: a callback that fails"):
        probe.wait_for(lambda: False, what="the failure")
    assert process.wait() == 1
    system.processes.clear()
    probe.wait_for(lambda: probe.values(topics.GAME_COMMAND) == ["last 0"], what="the last messages")
    assert probe.value(topics.GAME_STATE) == f"status {CRASHED}"


def test_signal_interrupts_making_of_node(probe: Probe, system: System) -> None:
    process = system.start(NODE, pause_s=30.0)
    probe.record(topics.GAME_STATE)
    probe.wait_for(lambda: probe.values(topics.GAME_STATE) == ["making"], what="the half-made node")
    assert process.stop() == 0
    assert process.output == ""


class Log(list[str]):
    def warning(self, text: str) -> None:
        self.append(f"warning {text}")

    def info(self, text: str) -> None:
        self.append(f"info {text}")


def test_trouble_is_logged_once_and_counted() -> None:
    log = Log()
    once = Once(log, lambda: 0.0)
    for i in range(3):
        once.warning("pose", f"bad pose {i}")
    once.begin("map", "no map")
    assert log == ["warning bad pose 0", "warning no map"]
    assert once.counts == {"pose": 3, "map": 1}
    once.summary()
    assert log[2:] == ["warning pose: 3 times"]
    once.over("pose")
    once.over("pose")
    once.warning("pose", "bad again")
    assert log[3:] == ["info pose: over, after 3 times", "warning bad again"]


def test_trouble_ends_unless_it_lasts() -> None:
    log, now_s = Log(), 0.0
    once = Once(log, lambda: now_s)
    once.warning("pose", "bad pose")
    once.begin("stopped", "stopped by a person")
    now_s = 4.0
    assert once.counts == {"pose": 1, "stopped": 1}
    now_s = 1e6
    assert once.counts == {"stopped": 1}
    once.warning("pose", "bad pose")
    assert log == [
        "warning bad pose",
        "warning stopped by a person",
        "info pose: over, after 1 time",
        "warning bad pose",
    ]
    once.over("stopped")
    assert once.counts == {"pose": 1}


def plays(nodes: Session, name: str, map: str | None = None, **changes: Any) -> None:
    """Have another node say its configuration."""
    config = make_config("robot", **changes)
    said = {"node": name, "started": [0, "", 0], "hash": config.hash, "map": map, "configuration": config.as_dict()}
    nodes.publish(topics.CONFIGURATION, json.dumps(said))


def test_other_configuration_is_reported_by_field(nodes: Session, log: Callable[[], str]) -> None:
    settings = ["clyde.speed_mps=0.25", "clyde.ghosts=wander,chase"]
    nodes.record(topics.CONFIGURATION)
    nodes.start("game_event_mapper", settings=settings)
    (said,) = map(json.loads, nodes.values(topics.CONFIGURATION))
    own = make_config("robot", **parse_settings(settings))
    assert said.pop("acts")
    assert said.pop("started")[2] == os.getpid()
    assert said.pop("rules") == ["robot", "robust", settings]
    assert said == {"node": "game_event_mapper", "hash": own.hash, "map": None, "configuration": own.as_dict()}

    two_ghosts = {"clyde.ghosts": ("wander", "chase")}
    other, third = GAME, SELECTOR
    plays(nodes, "audio_node", map="01234567", **two_ghosts)
    for _ in range(3):
        plays(nodes, other, **{"clyde.speed_mps": 0.35, **two_ghosts})
    plays(nodes, third)
    for bad in ("", "no json", "[]", "{}", '{"node": 1, "map": 2, "configuration": 3}', "[" * 200_000):
        nodes.publish(topics.CONFIGURATION, bad)
    plays(nodes, third, **two_ghosts)
    lines = [line for line in log().splitlines() if "configuration" in line]
    assert len(lines) == 4
    assert lines[0].endswith("pacman_game plays by another configuration: clyde.speed_mps 0.35, here 0.25")
    assert lines[1].endswith(
        "goal_selector plays by another configuration: clyde.ghosts ['wander'], here ['wander', 'chase']"
    )
    assert "game/configuration: " in lines[2]
    assert "configuration of goal_selector: over" in lines[3]

    plays(nodes, other, **two_ghosts)  # started again, with the same settings
    plays(nodes, other, **{"clyde.speed_mps": 0.45, **two_ghosts})
    assert "clyde.speed_mps 0.45, here 0.25" in log()
    assert log().count("pacman_game plays by another") == 2


def test_both_nodes_report_other_configuration(nodes: Session, log: Callable[[], str]) -> None:
    nodes.start(GAME, map_yaml="house", policy="nearest")
    nodes.start(SELECTOR, map_yaml="loop", policy="nearest", settings=["clyde.ghosts=chase"])
    for here, there in ((GAME, SELECTOR), (SELECTOR, GAME)):
        text = f"[robot_15.{here}]: {there} plays by another configuration: "
        (line,) = [line for line in log().splitlines() if text in line]
        assert "clyde.ghosts" in line
        assert "; map " in line


def test_destroyed_node_leaves_graph(probe: Probe) -> None:
    node = BaseNode("navigator", context=probe.context, namespace=probe.system.namespace)
    server = topics.NAVIGATE_TO_POSE.server(node, lambda handle: None)
    client = topics.NAVIGATE_TO_POSE.goal_client(probe.node)
    probe.wait_for(client.service_is_ready, what="the server")
    node.destroy_node()
    probe.wait_for(lambda: not client.service_is_ready(), what="the end of the server")
    probe.wait_for(lambda: "navigator" not in probe.node.get_node_names(), what="the end of the node")
    assert server is not None
    probe.node.destroy_client(client)


def test_node_time_continues_when_clock_jumps_back(probe: Probe) -> None:
    node = BaseNode("clockwork", context=probe.context)
    clock = node.get_clock()
    clock._set_ros_time_is_active(True)
    seen = []
    for seconds in (10, 11, 1011, 1012, 12, 13, 3, 4):
        clock.set_ros_time_override(Time(seconds=seconds, clock_type=ClockType.ROS_TIME))
        seen.append(node.now_s())
    node.destroy_node()
    assert seen == pytest.approx([10.0, 11.0, 1011.0, 1012.0, 1012.0, 1013.0, 1013.0, 1014.0])


@pytest.mark.parametrize(("simulated", "clock"), [(False, ClockType.STEADY_TIME), (True, ClockType.ROS_TIME)])
def test_timer_ignores_wall_clock(probe: Probe, simulated: bool, clock: ClockType) -> None:
    """A timer of the wall clock would wait until a clock that was set back shows its time again."""
    parameters = [Parameter("use_sim_time", value=simulated)]
    node = BaseNode("clockwork", context=probe.context, parameter_overrides=parameters)
    assert node.create_timer(1.0, node.now_s).clock.clock_type == clock
    node.destroy_node()


def test_node_ends_after_long_standstill(probe: Probe, system: System, monkeypatch: pytest.MonkeyPatch) -> None:
    """The node is stopped for longer than the lease that it is started with; a busy machine makes that longer still."""
    monkeypatch.setenv(LEASE, str(LEASE_S))
    process = up(probe, system, words=1)
    stand_still(probe, process, LEASE_S * 1.25)
    probe.wait_for(lambda: process.popen.poll() is not None, what="its end")
    assert process.wait() == STOOD_STILL
    probe.wait_for(lambda: probe.values(topics.GAME_COMMAND) == ["last 0"], what="its last message")
    assert "stood still for " in process.output
    system.processes.remove(process)


def test_node_continues_after_short_standstill(probe: Probe, system: System) -> None:
    process = up(probe, system, words=1)  # with the lease of 20 s
    stand_still(probe, process, 0.5)
    for word in ("event", "over"):
        probe.publish(topics.GAME_EVENT, word)
    probe.taken_in(topics.GAME_EVENT, "last_messages_node")
    assert process.popen.poll() is None
    assert probe.values(topics.GAME_COMMAND) == []


def stand_still(probe: Probe, process: Process, seconds: float) -> None:
    """At least so long, s."""
    process.send(signal.SIGSTOP)
    state = Path(f"/proc/{process.popen.pid}/stat")
    probe.wait_for(lambda: state.read_text().rpartition(")")[2].split()[0] == "T", what="the standstill")
    end_s = time.monotonic() + seconds
    probe.wait_for(lambda: time.monotonic() > end_s, what="the end of the standstill")
    process.send(signal.SIGCONT)


def test_invalid_lease_is_refused_by_name(system: System, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv(LEASE, "soon")
    process = system.start(NODE)
    assert process.wait() == 2
    assert f"{LEASE}='soon': must be a number of seconds above 0" in process.output
    system.processes.remove(process)


#: Shows what a process keeps of its start, which cannot be taken back in this one.
PROGRAM = """
import gc, re
from pathlib import Path
import numba
from pacman_env.ros.memory import release_memory

def resident_mb():
    return int(re.search(r"VmRSS:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]) / 1024

@numba.njit
def double(x):
    return 2 * x

@numba.njit
def triple(x):
    return 3 * x

assert double(21) == 42
before, mappings = resident_mb(), release_memory()
print(mappings, before - resident_mb(), gc.get_freeze_count())
assert double(21) == 42 and triple(14) == 42  # what was compiled runs on, and more can be compiled
"""


@pytest.mark.skipif(sys.platform != "linux", reason="looks at /proc, and gives pages back on Linux alone")
def test_settled_process_is_smaller_and_continues() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    mappings, smaller_by_mb, frozen = done.stdout.split()
    assert int(mappings) > 20
    assert float(smaller_by_mb) > 30.0
    assert int(frozen) > 10_000
