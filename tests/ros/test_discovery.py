"""Which nodes a node meets: a simulated one none on another machine, and none another that takes its part."""

from __future__ import annotations

import contextlib
import os
import re
import subprocess
import sys
import textwrap
import time
from pathlib import Path
from unittest import mock
from xml.etree import ElementTree

import pytest

from pacman_env import ros
from pacman_env.game.lights import LASTING
from pacman_env.ros import topics
from pacman_env.ros.discovery import (
    PROFILES,
    TRANSPORTS,
    avoid_shared_memory,
    domain_of,
    simulated,
    stay_on_this_machine,
    users_environment,
)
from pacman_env.ros.node import LAST_MESSAGES_S
from tests.ros.network import on_the_network, two_machines, why_not
from tests.ros.system import Probe, System

SIM_ROBOT = "pacman_env.ros.simulated_robot.sim_robot"
LIGHTS = "pacman_env.ros.nodes.game_light_node"
START_S = 240.0  # the first may have to compile


@pytest.mark.parametrize(("text", "number"), [("", 0), ("0", 0), ("15", 15), ("232", 232)])
def test_domain_is_a_number(text: str, number: int) -> None:
    assert domain_of(text) == number


@pytest.mark.parametrize("text", ["abc", "500", "-1", "1.5", "²", " 1"])
def test_invalid_domain_is_refused_by_name(text: str) -> None:
    with pytest.raises(ValueError, match="ROS_DOMAIN_ID"):
        domain_of(text)


def test_local_process_has_no_way_to_others() -> None:
    environment = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "ROS_DISCOVERY_SERVER": "10.0.0.1:11811", "HOME": "/"}
    stay_on_this_machine(environment)
    assert environment == {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "HOME": "/"}


@pytest.mark.parametrize(
    ("words", "asks"),
    [
        ("-p use_sim_time:=true", True),
        ("-p use_sim_time:=false", False),
        ("-p use_sim_time:=Y", True),
        ("--param sim_robot:use_sim_time:=True", True),
        ("-p speed:=4.0 -r __ns:=/use_sim_time", False),
        ("--params-file {file}", True),
        ("--params-file {file} -p use_sim_time:=false", False),
        ("--params-file {file}.none", False),
        ("-p", False),
    ],
)
def test_arguments_tell_simulated_time(words: str, asks: bool, tmp_path: Path) -> None:
    file = tmp_path / "launch_params"
    file.write_text("/robot_15/sim_robot:\n  ros__parameters:\n    use_sim_time: true\n")
    assert simulated(["--ros-args", *words.format(file=file).split()]) is asks


@pytest.mark.parametrize(
    ("value", "asks"), [("\ttrue", True), (" y", True), (" On", True), (" off", False), (" no", False)]
)
def test_file_tells_simulated_time_as_ros_does(value: str, asks: bool, tmp_path: Path) -> None:
    file = tmp_path / "params.yaml"
    file.write_text(f"sim_robot:\n  ros__parameters:\n    use_sim_time:{value}\n")
    assert simulated(["--ros-args", "--params-file", str(file)]) is asks


ROS_PROFILE, OTHER_PROFILE = PROFILES
OWN = "{package}/udp_alone.xml"


@pytest.mark.parametrize(
    ("given", "profile", "transports", "file"),
    [
        ({}, "", "UDPv4", OWN),
        ({TRANSPORTS: "LARGE_DATA"}, "", "LARGE_DATA", None),
        ({"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp"}, "", "UDPv4", OWN),
        ({"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}, "", None, None),
        ({ROS_PROFILE: "{file}"}, "<participant/>", "UDPv4", "{file}"),
        ({ROS_PROFILE: "{file}"}, "<transport_descriptors/>", None, "{file}"),
        ({OTHER_PROFILE: "{file}"}, "<participant/>", "UDPv4", None),
        ({OTHER_PROFILE: "{file}"}, "<useBuiltinTransports/>", None, None),
        ({ROS_PROFILE: "{file}.none"}, "", "UDPv4", "{file}.none"),
    ],
)
def test_chosen_transports_and_profiles_stay(
    given: dict[str, str], profile: str, transports: str | None, file: str | None, tmp_path: Path
) -> None:
    names = {"file": str(tmp_path / "profiles.xml"), "package": str(Path(ros.__file__).parent)}
    Path(names["file"]).write_text(profile)
    environment = {name: value.format(**names) for name, value in given.items()}
    avoid_shared_memory(environment)
    assert environment.get(TRANSPORTS) == transports
    assert environment.get(ROS_PROFILE) == (file and file.format(**names))


def test_last_messages_are_acknowledged_in_time() -> None:
    """A writer asks for acknowledgements once per heartbeat; the end of a node waits for them."""
    root = ElementTree.parse(OWN.format(package=Path(ros.__file__).parent)).getroot()
    name = {"dds": "http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"}
    (period,) = root.findall("dds:data_writer[@is_default_profile='true']/dds:times/dds:heartbeatPeriod", name)
    seconds, nanoseconds = (float(part.text or "nan") for part in period)
    assert 0.0 < seconds + nanoseconds * 1e-9 < LAST_MESSAGES_S / 10.0


def test_doctor_hides_profile_that_user_did_not_set() -> None:
    with mock.patch.dict(os.environ, {"HOME": "/h"}, clear=True):
        avoid_shared_memory()
        assert ROS_PROFILE in os.environ
        assert users_environment() == {"HOME": "/h", TRANSPORTS: "UDPv4"}


@pytest.mark.parametrize("home", [{}, {"HOME": os.devnull}])
def test_ros_logs_without_home(home: dict[str, str], tmp_path: Path) -> None:
    known = {name: value for name, value in os.environ.items() if name not in ("HOME", "ROS_LOG_DIR")}
    code = "from pacman_env.ros.discovery import join; import rclpy; join(0, True); rclpy.init(); rclpy.shutdown()"
    known |= {"XDG_STATE_HOME": str(tmp_path), **home}
    done = subprocess.run([sys.executable, "-c", code], env=known, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert any(path.is_file() for path in tmp_path.rglob("*"))


def ports(process: int) -> set[str]:
    """In shared memory, that a process reads and has locked: not those of others, to which it only writes."""
    found = set()
    for file in Path(f"/proc/{process}/fd").iterdir():
        with contextlib.suppress(OSError):  # closed meanwhile
            found |= set(re.findall(r"/dev/shm/fastrtps_port\d+_el", str(file.readlink())))
    return found


@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
@pytest.mark.parametrize("chosen", ["", "DEFAULT"])
def test_nodes_use_shared_memory_only_on_request(system: System, chosen: str) -> None:
    with mock.patch.dict(os.environ):
        for name in (TRANSPORTS, *PROFILES):
            os.environ.pop(name, None)
        if chosen:
            os.environ[TRANSPORTS] = chosen
        nodes = [system.start(LIGHTS), system.start("pacman_env.ros.nodes.game_event_mapper")]
    with Probe(system) as probe:
        probe.record(topics.LIGHT_RING)
        for node in nodes:
            probe.answered_by(f"{system.namespace}/{node.name}")
        probe.publish(topics.GAME_EVENT, "start")
        probe.wait_for(lambda: any(lit_rings(probe)), what="the ring to be lit")
        assert [bool(ports(node.popen.pid)) for node in nodes] == [bool(chosen)] * 2


def test_second_node_of_same_kind_is_refused(probe: Probe, system: System) -> None:
    first = system.start(LIGHTS)
    probe.record(topics.CONFIGURATION, topics.LIGHT_RING)
    probe.wait_for(lambda: probe.heard(topics.CONFIGURATION), what="the first")
    probe.publish(topics.GAME_LIGHT, LASTING["running"])
    lit = probe.wait_for(lambda: any(lit_rings(probe)) and len(lit_rings(probe)), what="the first to light the ring")
    second = system.start(LIGHTS)
    assert second.wait() == 2
    system.processes.remove(second)
    assert f"another game_light_node plays in /robot_15 already: process {first.popen.pid} on " in second.output
    before = len(lit_rings(probe))
    probe.wait_for(lambda: len(lit_rings(probe)) > before, what="the first to go on")
    assert first.popen.poll() is None
    assert all(lit_rings(probe)[lit:]), "the second has released the ring of the first"


def lit_rings(probe: Probe) -> list[bool]:
    """Of each message to the ring, whether it takes the ring from the base."""
    return [heard.message.override_system for heard in probe.heard(topics.LIGHT_RING)]


def test_simulated_robot_is_refused_beside_real_base(probe: Probe, system: System) -> None:
    probe.publisher(topics.ODOMETRY)
    robot = system.start(SIM_ROBOT, map_yaml="house", use_sim_time=True)
    assert robot.wait(START_S) == 2
    system.processes.clear()
    assert "a robot's base answers in /robot_15: /robot_15/probe (odom)" in robot.output


def test_second_clock_in_domain_is_refused(probe: Probe, system: System) -> None:
    first = system.start(SIM_ROBOT, map_yaml="house", use_sim_time=True)
    probe.record(topics.CLOCK)
    probe.wait_for(lambda: probe.heard(topics.CLOCK), START_S, "the clock")
    system.namespace = "/robot_16"
    second = system.start(SIM_ROBOT, map_yaml="house", use_sim_time=True)
    assert second.wait(START_S) == 2
    system.processes.remove(second)
    assert "another clock runs in this ROS domain: /robot_15/sim_robot" in second.output
    probe.forget()
    probe.wait_for(lambda: len(probe.heard(topics.CLOCK)) > 5, what="the first clock to go on")
    assert first.popen.poll() is None


LISTENER = """
import sys, time
import rclpy
from rclpy.node import Node
rclpy.init()
node = Node("listener", namespace="/robot_15")

def listen(seconds, enough):
    seen, end = set(), time.monotonic() + seconds
    while len(seen) < enough and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
        seen |= {name for name in node.get_node_names() if name != "listener" and not name.startswith("_NODE_")}
    return seen

limit_s, number, longer_s = map(float, sys.argv[1:])
seen = listen(limit_s, number)
seen |= listen(longer_s, 1000)  # what else there is would be seen in that time
print(*sorted(seen))
"""


@pytest.mark.skipif(bool(why_not()) and not os.environ.get("CI"), reason=f"no network namespaces: {why_not()}")
def test_simulated_game_is_not_seen_on_network(domain: int, tmp_path: Path) -> None:
    listen = [sys.executable, "-c", textwrap.dedent(LISTENER)]
    nodes = {
        "sim_robot": (SIM_ROBOT, "map_yaml:=house", "use_sim_time:=true"),
        "game_light_node": (LIGHTS, "use_sim_time:=true"),
        "game_event_mapper": ("pacman_env.ros.nodes.game_event_mapper", "use_sim_time:=false"),
    }
    with two_machines() as (here, there):

        def inside(machine: str, command: list[str]) -> list[str]:
            return ["ip", "netns", "exec", machine, *command]

        started = []
        for name, (module, *parameters) in nodes.items():
            words = [word for parameter in parameters for word in ("-p", parameter)]
            command = [sys.executable, "-m", module, "--ros-args", "-r", "__ns:=/robot_15", *words]
            with (tmp_path / name).open("wb") as log:
                run = subprocess.Popen(inside(here, command), env=on_the_network(), stdout=log, stderr=log)
            started.append(run)
        try:
            local = on_the_network()
            seen = subprocess.check_output(inside(here, [*listen, str(START_S), "3", "0"]), env=local, text=True)
            assert seen.split() == sorted(nodes)  # all are up, and seen on their own machine
            end = time.monotonic() + START_S
            seen = ""
            while "game_event_mapper" not in seen and time.monotonic() < end:  # the one that plays with a real robot
                seen = subprocess.check_output(inside(there, [*listen, "20", "1", "4"]), env=local, text=True)
            assert seen.split() == ["game_event_mapper"]
        finally:
            for run in started:
                run.terminate()
            for run in started:
                run.wait(START_S)
