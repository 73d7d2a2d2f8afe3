"""Which nodes a node meets: a simulated one none on another machine, and none another that takes its part."""

import contextlib
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from unittest import mock
from xml.etree import ElementTree

import pytest

from pacman_env import ros
from pacman_env.game.lights import LASTING
from pacman_env.ros import discovery, topics
from pacman_env.ros.discovery import PROFILES, TRANSPORTS
from pacman_env.ros.process import LAST_MESSAGES_S
from tests.ros.system import Probe, System
from tests.waiting import wait_for

SIM_ROBOT = "pacman_env.ros.simulated_robot.sim_robot"
LIGHTS = "pacman_env.ros.nodes.game_light_node"
START_S = 240.0  # the first may have to compile


@pytest.mark.parametrize(("text", "number"), [("", 0), ("0", 0), ("15", 15), ("232", 232)])
def test_domain_is_a_number(text: str, number: int) -> None:
    assert discovery.domain_of(text) == number


@pytest.mark.parametrize("text", ["abc", "500", "-1", "1.5", "²", " 1"])
def test_invalid_domain_is_refused_by_name(text: str) -> None:
    with pytest.raises(ValueError, match="ROS_DOMAIN_ID"):
        discovery.domain_of(text)


def test_local_process_has_no_way_to_others() -> None:
    environment = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "ROS_DISCOVERY_SERVER": "10.0.0.1:11811", "HOME": "/"}
    discovery.stay_on_this_machine(environment)
    assert environment == {"ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST", "HOME": "/"}


@pytest.mark.parametrize(
    ("words", "value", "asks"),
    [
        ("-p use_sim_time:=true", "", True),
        ("-p use_sim_time:=false", "", False),
        ("-p use_sim_time:=Y", "", True),
        ("--param sim_robot:use_sim_time:=True", "", True),
        ("-p speed:=4.0 -r __ns:=/use_sim_time", "", False),
        ("--params-file {file}", " true", True),
        ("--params-file {file} -p use_sim_time:=false", " true", False),
        ("--params-file {file}.none", "", False),
        ("-p", "", False),
        *(("--params-file {file}", value, True) for value in ("\ttrue", " y", " On")),
        *(("--params-file {file}", value, False) for value in (" off", " no", " false  # use_sim_time: true")),
    ],
)
def test_arguments_tell_simulated_time_as_ros_does(words: str, value: str, asks: bool, tmp_path: Path) -> None:
    file = tmp_path / "launch_params"
    file.write_text(f"/robot_15/sim_robot:\n  ros__parameters:\n    use_sim_time:{value}\n")
    assert discovery.simulated(["--ros-args", *words.format(file=file).split()]) is asks


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
    discovery.avoid_shared_memory(environment)
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
        discovery.avoid_shared_memory()
        assert ROS_PROFILE in os.environ
        assert discovery.users_environment() == {"HOME": "/h", TRANSPORTS: "UDPv4"}


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
    probe.wait_for(lambda: probe.on(topics.CONFIGURATION), what="the first")
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
    return [message.override_system for message in probe.messages(topics.LIGHT_RING)]


def test_simulated_robot_is_refused_beside_real_base(probe: Probe, system: System) -> None:
    probe.publisher(topics.ODOMETRY)
    robot = system.start(SIM_ROBOT, map_yaml="house", use_sim_time=True)
    assert robot.wait(START_S) == 2
    system.processes.clear()
    assert "a robot's base answers in /robot_15: /robot_15/probe (odom)" in robot.output


def test_second_clock_in_domain_is_refused(probe: Probe, system: System) -> None:
    first = system.start(SIM_ROBOT, map_yaml="house", use_sim_time=True)
    probe.record(topics.CLOCK)
    probe.wait_for(lambda: probe.on(topics.CLOCK), START_S, "the clock")
    system.namespace = "/robot_16"
    second = system.start(SIM_ROBOT, map_yaml="house", use_sim_time=True)
    assert second.wait(START_S) == 2
    system.processes.remove(second)
    assert "another clock runs in this ROS domain: /robot_15/sim_robot" in second.output
    probe.clear()
    probe.wait_for(lambda: len(probe.on(topics.CLOCK)) > 5, what="the first clock to go on")
    assert first.popen.poll() is None


# Two machines on one cable, as far as the network goes: namespaces of this machine's own kernel

#: Prints the nodes seen until there are so many, and those that come in some seconds more.
LISTENER = """
import sys
from pacman_env.ros.observer import ObserverNode
limit_s, number, longer_s = map(float, sys.argv[1:])
with ObserverNode("listener", "/robot_15") as node:
    def seen():
        return {name for name in node.get_node_names() if name != "listener" and not name.startswith("_NODE_")}
    node.spin_until(lambda: len(seen()) >= number, limit_s)
    node.spin_until(lambda: False, longer_s)
    print(*sorted(seen()))
"""
HAS_NETWORKS = shutil.which("ip") and not subprocess.run(["unshare", "-n", "true"], check=False).returncode


@pytest.fixture
def machines(domain: int) -> Iterator[tuple[list[str], list[str]]]:
    """How commands begin that run on one machine or the other."""

    def ip(words: str, check: bool = True) -> None:
        subprocess.run(["ip", *words.split()], check=check, capture_output=True)

    here, there = f"pacman{domain}a", f"pacman{domain}b"
    try:
        ip(f"netns add {here}")
        ip(f"netns add {there}")
        ip(f"link add cable netns {here} type veth peer name cable netns {there}")
        for last, name in enumerate((here, there), 1):
            ip(f"-n {name} addr add 10.77.0.{last}/24 dev cable")
            ip(f"-n {name} link set lo up")
            ip(f"-n {name} link set cable up")
            ip(f"-n {name} route add 224.0.0.0/4 dev cable")
        yield ["ip", "netns", "exec", here], ["ip", "netns", "exec", there]
    finally:
        for name in (here, there):
            ip(f"netns delete {name}", check=False)


@pytest.mark.skipif(not (HAS_NETWORKS or os.environ.get("CI")), reason="needs iproute2 and network namespaces")
def test_simulated_game_is_not_seen_on_network(
    machines: tuple[list[str], list[str]], system: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("FASTRTPS_DEFAULT_PROFILES_FILE")
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    monkeypatch.setenv(TRANSPORTS, "UDPv4")  # shared memory is this machine's, and would go around the cable
    here, there = machines
    nodes = {SIM_ROBOT: ["-p", "map_yaml:=house", "-p", "use_sim_time:=true"], LIGHTS: ["-p", "use_sim_time:=true"]}
    nodes["pacman_env.ros.nodes.game_event_mapper"] = []  # plays with a real robot
    names = sorted(module.rpartition(".")[2] for module in nodes)
    for module, words in nodes.items():
        command = [sys.executable, "-m", module, "--ros-args", "-r", "__ns:=/robot_15", *words]
        system.run(module.rpartition(".")[2], [*here, *command])

    def seen(machine: list[str], *numbers: float) -> list[str]:
        command = [*machine, sys.executable, "-c", LISTENER, *map(str, numbers)]
        return subprocess.check_output(command, text=True).split()

    assert seen(here, START_S, 3, 0) == names  # all are up, and seen on their own machine
    assert wait_for(lambda: seen(there, 20, 1, 4), "the node that plays with a real robot") == ["game_event_mapper"]
