"""What all nodes of the game have in common: parameters, arguments, namespaces and bad messages."""

import json
import math
import subprocess
import sys
from collections.abc import Callable, Iterator, Sequence
from importlib import import_module
from typing import Any

import pytest
from geometry_msgs.msg import Point, PointStamped, PoseWithCovarianceStamped
from rclpy.parameter import Parameter
from std_msgs.msg import Header

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import GAME, LISTENERS, MODULES, SELECTOR, SIMULATOR, WATCHER
from pacman_env.ros.message_conversion import markers_of, twist_message
from pacman_env.ros.simulated_robot.sim_robot import FAULT
from tests.ros import session
from tests.ros.session import NAMESPACE, Session

WAIT = "wait_for_amcl_pose"
NODES = (SIMULATOR, GAME, *LISTENERS, WAIT, SELECTOR, WATCHER)
WITH_MAP = (SIMULATOR, GAME, SELECTOR)
TEST_NODE = "last_messages_node"
LIGHT_NODES = (*LISTENERS, WAIT, WATCHER)
#: Topics that all robots of a ROS domain share.
OF_DOMAIN = {"/clock", "/clock_owner", "/rosout", "/parameter_events", "/diagnostics"}
#: Parameters that rclpy declares.
OF_ROS = ("use_sim_time", "start_type_description_service")
HEAVY = ("numba", "llvmlite", "cv2", "pymunk", "gymnasium", "onnxruntime", "scipy")


def start(nodes: Session, name: str, **parameters: Any) -> Any:
    """Start a node of the game on the house, with power pellets."""
    own: dict[str, Any] = {"map_yaml": "house"} if name in WITH_MAP else {}
    own |= {} if name in (WAIT, WATCHER) else {"settings": ["power.pellets=4"]}
    return nodes.start(name, **own, **parameters)


@pytest.fixture(scope="module")
def playing(
    request: pytest.FixtureRequest, domain: int, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[str, Session]]:
    """A session with one node of the game, and the node's name; tests may start the node again."""
    name = str(request.param)
    with session.nodes(tmp_path_factory.mktemp(name)) as nodes:
        start(nodes, name)
        nodes.advance(0.05)
        yield name, nodes


@pytest.mark.parametrize("playing", NODES, indirect=True)
def test_parameters_are_described_and_numbers_may_be_integers(playing: tuple[str, Session]) -> None:
    name, nodes = playing
    node = nodes.node(name)
    own = {key: one for key, one in node.get_parameters_by_prefix("").items() if key not in OF_ROS}
    described = {key: node.describe_parameter(key) for key in own}
    assert all(one.description for one in described.values())
    floats = [key for key, one in own.items() if one.type_ is Parameter.Type.DOUBLE]
    given: dict[str, Any] = {key: math.ceil(described[key].floating_point_range[0].from_value) for key in floats}
    if name in (GAME, SELECTOR):
        given["home"] = [1, 0, 2]
    nodes.kill(name)
    again = start(nodes, name, **given)
    assert {key: again.get_parameter(key).value for key in given} == given
    assert all(isinstance(again.get_parameter(key).value, float) for key in floats)


@pytest.mark.parametrize("playing", NODES, indirect=True)
def test_topics_and_services_are_in_namespace(playing: tuple[str, Session]) -> None:
    name, nodes = playing
    node = nodes.node(name)
    spoken = {one.topic_name for one in (*node.publishers, *node.subscriptions)}
    spoken |= {one.service_name for one in (*node.services, *node.clients)}
    assert {one for one in spoken if not one.startswith(f"{NAMESPACE}/")} <= OF_DOMAIN


def click(x: float, y: float, frame: str = "map") -> Any:
    return PointStamped(header=Header(frame_id=frame), point=Point(x=x, y=y))


def pose(x: float, y: float = 0.0, frame: str = "map", w: float = 1.0) -> Any:
    message = PoseWithCovarianceStamped(header=Header(frame_id=frame))
    message.pose.pose.position, message.pose.pose.orientation.w = Point(x=x, y=y), w
    return message


STAMP = Header().stamp
BAD_STOPS = ("release", "{}", '{"stopped": 0, "at": 99, "who": "", "by": ""}', "[" * 500, "x" * 2000)
BAD_SPEEDS = (math.nan, -1.0, math.inf)
BAD_POSES = (pose(math.nan), pose(1.0, frame="odom"), pose(1.0, w=0.0), pose(1e9))
OTHER_FRAME = markers_of({5: (1.0, 0.0)}, STAMP)
OTHER_FRAME.markers[1].header.frame_id = "odom"
BAD_MARKERS = (
    topics.PELLET_MARKERS.type(markers=markers_of({5: (0.0, 0.0)}, STAMP).markers * 10_001),
    markers_of({-1: (0.0, 0.0)}, STAMP),
    markers_of({5: (math.nan, 0.0)}, STAMP),
    OTHER_FRAME,
)
BAD: list[tuple[str, topics.Topic, Sequence[Any]]] = [
    ("audio_node", topics.GAME_SOUND, ("beep", "", "x" * 10_000, "beep")),
    ("game_light_node", topics.GAME_LIGHT, ("green", "\x00" * 3, "purple" * 1000)),
    ("game_event_mapper", topics.OPERATOR_STOP, BAD_STOPS),
    (GAME, topics.AMCL_POSE, BAD_POSES),
    (
        GAME,
        topics.CLICKED_POINT,
        (click(math.nan, 0.0), click(0.0, math.inf), click(500.0, 500.0), click(1.0, 0.0, "base_link")),
    ),
    (SELECTOR, topics.PELLET_MARKERS, BAD_MARKERS),
    (GAME, topics.BASE_CLYDE_SPEED, (*BAD_SPEEDS, 1e30)),
    (GAME, topics.OPERATOR_STOP, BAD_STOPS),
    (WAIT, topics.AMCL_POSE, BAD_POSES),
    (SELECTOR, topics.AMCL_POSE, BAD_POSES),
    (SELECTOR, topics.OPERATOR_STOP, BAD_STOPS),
    (SELECTOR, topics.ROUND, (0, -1)),
    (SELECTOR, topics.GAME_COMMAND, ("", "jump", "x" * 5000)),
    (SIMULATOR, topics.CMD_VEL, (twist_message(math.nan, 0.0, STAMP),) * 3),
    (SIMULATOR, topics.INITIAL_POSE, BAD_POSES),
    (SIMULATOR, FAULT, ("explode", "", "abort soon")),
]


@pytest.mark.parametrize(
    ("playing", "topic", "bad"), BAD, indirect=["playing"], ids=[f"{one[0]}-{one[1].name}" for one in BAD]
)
def test_bad_messages_are_dropped_and_reported_once(
    playing: tuple[str, Session], log: Callable[[], str], topic: topics.Topic, bad: Sequence[Any]
) -> None:
    name, nodes = playing
    node = nodes.node(name)
    before = dict(node.once.counts)
    said = log().count("\n")
    for message in bad:
        nodes.publish(topic, message)
    new = {key: count for key, count in node.once.counts.items() if key not in before}
    assert list(new.values()) == [len(bad)], new
    assert len([line for line in log().splitlines()[said:] if "[WARN]" in line]) == 1


def arguments(**parameters: Any) -> list[str]:
    return ["--ros-args", *(word for key, value in parameters.items() for word in ("-p", f"{key}:={value}"))]


HOUSE: dict[str, Any] = {"map_yaml": "house"}
BASE = {**HOUSE, "navigation": "false", "localization": "false"}
REFUSED: list[tuple[str, list[str], str]] = [
    (TEST_NODE, arguments(words=21), "words"),
    (TEST_NODE, arguments(words="many"), "words"),
    (TEST_NODE, arguments(pause_s=".nan"), "pause_s"),
    (TEST_NODE, arguments(offset=".inf"), "parameter offset = inf: must be finite"),
    (TEST_NODE, ["--ros-args", "-p", "words"], "words"),
    (TEST_NODE, ["--fast"], "unknown arguments --fast"),
    ("game_event_mapper", arguments(settings="[clyde.speed_mps=fast]"), "clyde.speed_mps"),
    ("game_event_mapper", arguments(settings="[clyde.sped=1]"), "clyde.sped"),
    ("game_event_mapper", arguments(settings="[clyde.speed_mps]"), "clyde.speed_mps"),
    ("game_event_mapper", arguments(settings="clyde.speed_mps=1"), "settings"),
    (SIMULATOR, arguments(map_yaml="nowhere.yaml"), "nowhere.yaml"),
    (SIMULATOR, arguments(map_yaml="/dev/null"), "/dev/null"),
    (WAIT, arguments(timeout_s=-1.0), "timeout_s"),
    (GAME, arguments(**HOUSE, policy="bold"), "unknown policy 'bold'"),
    (GAME, arguments(**HOUSE, selector="mine"), "selector = 'mine'"),
    (SELECTOR, arguments(map_yaml="nowhere.yaml"), "nowhere.yaml"),
    (SELECTOR, arguments(**HOUSE, home="[1.0, 2.0]"), "home: 2 numbers"),
    (SIMULATOR, arguments(**HOUSE, speed=2.0), "needs use_sim_time"),
    (SIMULATOR, arguments(**HOUSE, preset="lunar"), "lunar"),
    (SIMULATOR, arguments(**HOUSE, home="1,2"), "must be x,y,heading"),
    (SIMULATOR, arguments(**HOUSE, fault="explode"), "explode"),
    (SIMULATOR, arguments(**BASE | {"navigation": "true"}), "needs navigation = false"),
    (SIMULATOR, arguments(**BASE, odometry_hz=30), "must be 0 or one of 20, 40, 50, 100"),
    (SIMULATOR, arguments(**BASE, dock="here"), "must be x,y,heading"),
]


@pytest.mark.parametrize(("name", "words", "reason"), REFUSED, ids=[f"{one[0]}-{one[2]}" for one in REFUSED])
def test_bad_arguments_end_node_with_one_line(
    domain: int, capfd: pytest.CaptureFixture[str], name: str, words: list[str], reason: str
) -> None:
    main = import_module(f"tests.ros.{name}" if name == TEST_NODE else MODULES[name]).main
    assert main(words) == 2
    said = capfd.readouterr().err
    (line,) = [line for line in said.splitlines() if not line.startswith("[")]  # but for those of the log
    assert reason in line
    assert "Traceback" not in said


def test_light_nodes_import_nothing_heavy() -> None:
    code = f"""
import importlib, json, sys
for module in {[MODULES[name] for name in LIGHT_NODES]!r}:
    importlib.import_module(module)
import pacman_env.game.pellets, pacman_env.world.maps.occupancy
pellets = pacman_env.game.pellets.generate_pellets(
    pacman_env.world.maps.occupancy.load_map("house"), pacman_env.config.make_config().pellets
)
print(json.dumps([len(pellets), sorted(set({HEAVY!r}) & set(sys.modules))]))
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert json.loads(done.stdout) == [13, []]
