"""The doctor at real nodes: a robot made of probes, and no robot; a simulated game is in ``test_operating.py``."""

import array
import dataclasses
import io
import json
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

import pytest
import rclpy
from lifecycle_msgs.srv import GetState
from rclpy.time import Time
from std_msgs.msg import Header

from pacman_env.ros import topics
from pacman_env.ros.message_conversion import transform_message, uncertain_pose_message
from pacman_env.ros.simulated_robot.sim_sensors import map_message
from pacman_env.ros.supervisor.checks import examine
from pacman_env.ros.supervisor.checks.check import BAD, OK, UNKNOWN, Finding
from pacman_env.ros.supervisor.checks.game import CLOUDS
from pacman_env.ros.supervisor.doctor import Doctor, doctor
from pacman_env.world.maps.occupancy import OccupancyMap, load_map
from tests.ros.system import PATIENCE_S, Probe, System

START_S = 240.0  # the first nodes may have to compile
MAP = "house"
AT_ORIGIN = (0.0, 0.0, 0.0)
NS = "/robot_15"


def diagnose(
    domain: int,
    until: Callable[[dict[str, Finding]], bool],
    meanwhile: Callable[[], None] = lambda: None,
    map: OccupancyMap | None = None,
) -> dict[str, Finding]:
    """What the doctor says as soon as he says what is waited for, by check."""
    said: dict[str, Finding] = {}
    with Doctor(NS, domain, map, "" if map is None else map.name, False, PATIENCE_S) as node:

        def look() -> bool:
            meanwhile()
            said.clear()
            said.update({finding.check: finding for finding in examine(node.observations())})
            return until(said)

        node.observe(look)
        assert until(said) or look(), "\n".join(f"{f.status} {f.check}: {f.summary}" for f in said.values())
    return said


def is_bad(found: dict[str, Finding], check: str, seen: str) -> bool:
    return check in found and found[check].status == BAD and seen in found[check].summary


class FakeRobot:
    """All that a TurtleBot 4 with Nav2 says, from nodes of the test process; ``tick`` says it again."""

    def __init__(self, probe: Probe) -> None:
        self.probe, self.house = probe, load_map(MAP)
        self.behind_s = 0.0  # its clocks
        self.docked, self.charge, self.active = False, 0.9, True
        self._due_s = 0.0
        self.costmaps = []
        for costmap in ("local_costmap", "global_costmap"):
            node = rclpy.create_node(costmap, namespace=f"{NS}/{costmap}", context=probe.context)
            for cloud in CLOUDS:
                dataclasses.replace(topics.CLYDE_OBSTACLE, name=f"{NS}/{cloud}").subscription(
                    node, lambda message: None
                )
            self.costmaps.append(node)
        self._navigator = topics.NAVIGATE_TO_POSE.server(probe.node, lambda goal: None)
        for name in ("amcl", "planner_server"):
            probe.node.create_service(GetState, f"{name}/get_state", self._get_state)
        probe.publisher(topics.MAP).publish(map_message(self.house, probe.stamp()))
        self.say(
            topics.TF_STATIC, transforms=[transform_message("base_link", "rplidar_link", AT_ORIGIN, probe.stamp())]
        )
        self.pose(1.0)

    def _get_state(self, request: Any, response: Any) -> Any:
        response.current_state.label = "active" if self.active else "inactive"
        return response

    def say(self, topic: topics.Topic, **fields: Any) -> None:
        self.probe.publisher(topic).publish(topic.type(**fields))

    def pose(self, x: float) -> None:
        self.probe.publisher(topics.AMCL_POSE).publish(uncertain_pose_message(x, 0.0, 0.0, self.stamp()))

    def stamp(self, ahead_s: float = 0.0) -> Any:
        return Time(seconds=time.time() - self.behind_s + ahead_s).to_msg()

    def tick(self) -> None:
        """Answer and say what is due; ten times a second at most."""
        if time.monotonic() < self._due_s:
            return
        self._due_s = time.monotonic() + 0.1
        for _ in range(5):
            self.probe.executor.spin_once(timeout_sec=0.0)
        header = Header(stamp=self.stamp(), frame_id="rplidar_link")
        self.say(topics.ODOMETRY, header=header, child_frame_id="base_link")
        base = transform_message("odom", "base_link", AT_ORIGIN, self.stamp())
        self.say(topics.TF, transforms=[base, transform_message("map", "odom", AT_ORIGIN, self.stamp(1.0))])
        ranges = array.array("f", [2.0, 3.5, float("inf"), float("nan")] * 90)
        self.say(topics.SCAN, header=header, range_min=0.15, range_max=12.0, scan_time=0.1, ranges=ranges)
        self.say(topics.DOCK_STATUS, is_docked=self.docked)
        self.say(topics.BATTERY_STATE, percentage=self.charge)

    def lose_costmaps(self) -> None:
        while self.costmaps:
            self.costmaps.pop().destroy_node()

    def close(self) -> None:
        self.lose_costmaps()
        self._navigator.destroy()


@pytest.fixture
def robot(probe: Probe) -> Iterator[FakeRobot]:
    robot = FakeRobot(probe)
    yield robot
    robot.close()


def test_doctor_finds_ready_robot_and_each_fault(domain: int, probe: Probe, robot: FakeRobot) -> None:
    def ready(found: dict[str, Finding]) -> bool:
        return {check for check, finding in found.items() if finding.status != OK} == {
            *("game's nodes", "configuration", "game")
        }

    said = diagnose(domain, ready, robot.tick, map=robot.house)
    assert said["time of odom"].summary.startswith("0.")
    assert "50 % of rays return, 2.00 to 3.50 m" in said["lidar"].summary
    assert said["Nav2"].summary == f"navigate_to_pose is served by {NS}/probe"
    assert said["battery"].summary == "90 %"
    assert said["game's nodes"].command.startswith("pacman-env ros up --map house --namespace robot_15")

    robot.lose_costmaps()
    robot.behind_s, robot.docked, robot.charge, robot.active = 3.0, True, 0.1, False
    other = load_map("loop")
    probe.publisher(topics.MAP).publish(map_message(other, probe.stamp()))
    robot.pose(90.0)
    started_never = '{"node": "x", "started": [NaN, 1, 2], "hash": 1, "map": 2}'
    for text in ("no JSON", "[1]", '{"node": 1}', started_never, "9" * 9):
        robot.say(topics.CONFIGURATION, data=text)
    robot.say(topics.DIAGNOSTICS, data='{"policy": NaN, "troubles": "many"}')
    robot.say(topics.GAME_STATE, data="\x1b[2J")
    lost = transform_message("odom", "wheel", (float("nan"), 0.0, 0.0), probe.stamp())
    summaries = {
        "time of odom": "3.",
        "time of tf": "3.",
        "dock": "docked",
        "battery": "10 %",
        "map": "not house: size",
        "pose": "off the map",
        "Nav2's nodes": "planner_server is inactive",
        **dict.fromkeys(("clyde_obstacle", "clyde_trail"), "no subscription of local_costmap and global_costmap"),
    }

    def broken() -> None:
        robot.tick()
        robot.say(topics.TF, transforms=[lost])

    def named(found: dict[str, Finding]) -> bool:
        known = "tf to base" in found and found["tf to base"].status == OK  # not where this process was held up
        return known and all(is_bad(found, check, seen) for check, seen in summaries.items())

    said = diagnose(domain, named, broken, map=robot.house)
    assert said["configuration"].status == UNKNOWN
    assert said["tf to base"].status == OK, said["tf to base"]


def test_dock_is_unknown_without_message_types(domain: int, probe: Probe, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "irobot_create_msgs.msg", None)  # as if it were not there
    said = diagnose(domain, lambda found: "dock" in found)
    assert said["dock"].status == UNKNOWN
    assert "irobot_create_msgs/DockStatus is not installed here" in said["dock"].summary
    assert said["dock"].command == "python -m tools.ros_interfaces.build"


def test_missing_robot_is_bad_in_json(domain: int) -> None:
    out = io.StringIO()
    assert doctor("/nobody", domain, MAP, wait_s=0.1, as_json=True, out=out) == 1
    said = json.loads(out.getvalue())
    assert (said["namespace"], said["domain"], said["ready"]) == ("/nobody", domain, False)
    assert said["map"] == {"name": MAP, "hash": load_map(MAP).hash}
    assert said["version"]
    statuses = {finding["check"]: finding["status"] for finding in said["findings"]}
    assert BAD in (statuses["domain"], statuses["namespace"])  # who has just left may still be discovered in the domain
    assert "no node discovered in /nobody within 0.1 s" in out.getvalue()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"namespace": "15"}, "namespace '15'"),
        ({"domain": 233}, "ROS_DOMAIN_ID '233'"),
        ({"map": "nowhere"}, "nowhere"),
        ({"wait_s": float("nan")}, "wait nan s"),
        ({"wait_s": 0.0}, "wait 0 s"),
        ({"wait_s": 601.0}, "at most 600"),
    ],
)
def test_invalid_arguments_are_refused_first(arguments: dict[str, Any], words: str) -> None:
    before = dict(os.environ)
    with pytest.raises(ValueError, match=words):
        doctor(**{"namespace": "robot_15", "domain": 1, **arguments})
    assert dict(os.environ) == before


def test_simulated_robot_is_sought_on_this_machine(domain: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    monkeypatch.setenv("ROS_STATIC_PEERS", "10.0.0.2")
    out = io.StringIO()
    doctor("nobody", domain, sim=True, wait_s=0.1, out=out)
    assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert "ROS_STATIC_PEERS" not in os.environ
    assert "sees this machine only" in out.getvalue()


def test_interrupt_ends_doctor_in_one_line(probe: Probe, system: System) -> None:
    code = "import sys; from pacman_env.ros.supervisor.doctor import doctor; sys.exit(doctor('nobody', wait_s=300))"
    process = system.run("doctor", [sys.executable, "-c", code])
    probe.wait_for(lambda: "pacman_doctor" in probe.node.get_node_names(), START_S, "the doctor")
    assert process.stop(signal.SIGINT) == 1
    assert process.output == "doctor: stopped before the end\n"
    system.processes.clear()


def test_doctor_publishes_nothing(domain: int) -> None:
    with Doctor(NS, domain, None, "", False, 1.0) as node:
        spoken = {publisher.topic_name for publisher in node.publishers}
    assert spoken <= {"/rosout", "/parameter_events"}
