"""The simulated base against what Nav2 subscribes to, publishes and looks up, by Nav2's sources.

The facts are rows of ``golden/nav2_interface.json``; numbers that files in ``config/`` set are read from there.
"""

import json
import math
from collections.abc import Callable, Iterator
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rclpy.action import get_action_server_names_and_types_by_node
from rclpy.qos import DurabilityPolicy, QoSCompatibility, QoSProfile, ReliabilityPolicy, qos_check_compatible

from pacman_env.ros import topics
from pacman_env.ros.game_nodes import MODULES, NAV2_BY_HAND, SIMULATOR, GameSetup
from pacman_env.ros.message_conversion import nanoseconds_of, seconds_of, transform_of, twist_message
from pacman_env.sim import navigate_to_pose
from pacman_env.world.navigation.grid import clearance_m
from pacman_env.world.navigation.localization import compose
from tests.ros import session
from tests.ros.nav2_chain import nav2_yaml
from tests.ros.simulated_robot.driven import EXACT
from tests.sim.robots import rooms

FACTS: dict[str, Any] = json.loads((Path(__file__).parent / "golden/nav2_interface.json").read_text())
RELIABILITY = {"reliable": ReliabilityPolicy.RELIABLE, "best_effort": ReliabilityPolicy.BEST_EFFORT}
DRIVEN_S = 5.0
_FOR_NAV2 = GameSetup("house", sim=True, nav2=NAV2_BY_HAND).parameters(SIMULATOR)
#: Parameters of the simulated robot that leave all to Nav2 but the base, as `ros up --sim --nav2` gives them.
BASE_ONLY = {name: value for name, value in _FOR_NAV2.items() if name not in ("map_yaml", "speed", "use_sim_time")}
VELOCITY = (0.2, 0.5)  # m/s, rad/s


def setting(node: str, name: str) -> Any:
    """A parameter of a node or a costmap in ``config/``."""
    value = nav2_yaml()[node]
    for key in name.split("."):
        value = value[key]
    return value


def rows(kind: str, **wanted: str) -> list[Any]:
    """Those that hold with ``config/nav2.yaml``, as parameters of a test."""
    found = [row for row in FACTS[kind] if all(row[key] == value for key, value in wanted.items())]
    used = [row for row in found if "when" not in row or setting(*row["when"][:2]) == row["when"][2]]
    assert used
    return [pytest.param(row, id=f"{row['node']}: {row['topic']}") for row in used]


def profiles(row: dict[str, Any]) -> list[QoSProfile]:
    """What a row's node asks for or offers; one for each middleware where that decides."""
    words = ["best_effort", "reliable"] if row["reliability"] == "system_default" else [row["reliability"]]
    durability = DurabilityPolicy[row["durability"].upper()]
    return [QoSProfile(depth=row["depth"], durability=durability, reliability=RELIABILITY[word]) for word in words]


class Base(session.Session):
    """The simulated base, driven for some seconds, as Nav2's subscriptions see it."""

    def drive(self) -> None:
        map_yaml = rooms().save(self.folder / "rooms.yaml")
        self.start(SIMULATOR, map_yaml=map_yaml, settings=EXACT, **BASE_ONLY, set_initial_pose=False)
        #: Rows, and what one subscription for each of their profiles got, with the simulated time of arrival, s.
        self.received: list[tuple[dict[str, Any], list[tuple[float, Any]]]] = []
        for row in (row for param in rows("received", **{"from": "base"}) for row in param.values):
            for profile in profiles(row):
                self.received.append((row, []))
                add = partial(lambda got, message: got.append((self.now_s, message)), self.received[-1][1])
                topic = topics.Topic(row["topic"], row["type"], profile)
                self.subscribe(topic, add)
        self.driven = [self.driven_by(row) for param in rows("sent", to="base") for row in param.values]

    def driven_by(self, row: dict[str, Any]) -> bool:
        """Whether the base turns by commands as the row's node sends them, old stamps among them."""
        heading = self.node(SIMULATOR).robot.pose[2]
        publisher = topics.Topic(row["topic"], row["type"], profiles(row)[0]).publisher(self.observer)
        for _ in range(round(DRIVEN_S * setting("velocity_smoother", "smoothing_frequency"))):
            message = twist_message(*VELOCITY, self.stamp())
            message.header.stamp.sec -= 1  # collision_monitor passes on the stamp of what it received
            self.within(lambda message=message: publisher.publish(message))
            self.advance(1.0 / setting("velocity_smoother", "smoothing_frequency"))
        return bool(self.node(SIMULATOR).robot.pose[2] != heading)

    def timed(self, topic: str) -> list[tuple[float, Any]]:
        return next(got for row, got in self.received if row["topic"] == topic)

    def heard(self, topic: str) -> list[Any]:
        return [message for _, message in self.timed(topic)]

    @property
    def links(self) -> dict[str, str]:
        """Parent frames by child, of all transforms."""
        transforms = [
            one for topic in ("tf", "tf_static") for message in self.heard(topic) for one in message.transforms
        ]
        return {one.child_frame_id: one.header.frame_id for one in transforms}

    def odometry_transforms(self) -> list[Any]:
        transforms = [one for message in self.heard("tf") for one in message.transforms]
        return [one for one in transforms if (one.header.frame_id, one.child_frame_id) == ("odom", "base_link")]

    def stamps(self, of: str) -> list[float]:
        if of == "clock":
            return [seconds_of(message.clock) for message in self.heard("/clock")]
        messages = self.odometry_transforms() if of == "transform" else self.heard(of)
        return [seconds_of(message.header.stamp) for message in messages]


@pytest.fixture(scope="module")
def base(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Base]:
    with session.nodes(tmp_path_factory.mktemp("base"), session=Base) as base:
        base.drive()
        yield base
        assert base.errors() == []


@pytest.mark.parametrize("row", rows("received", **{"from": "base"}))
def test_topics_arrive_with_qos_of_nav2(base: Base, row: dict[str, Any]) -> None:
    arrived = [len(got) for of, got in base.received if of is row]
    assert len(arrived) == len(profiles(row))
    assert min(arrived) > 0, f"reliabilities {row['reliability']}: {arrived} messages"


def test_base_obeys_every_velocity_publisher_of_nav2(base: Base) -> None:
    assert len(base.driven) == 2
    assert all(base.driven)


@pytest.mark.parametrize("row", [*rows("received", **{"from": "game"}), *rows("sent", to="game")])
def test_topics_of_game_suit_nav2(row: dict[str, Any]) -> None:
    ours = next(topic for topic in vars(topics).values() if getattr(topic, "name", "") == row["topic"])
    assert ours.type_name == row["type"]
    for theirs in profiles(row):
        offered, wanted = (ours.qos, theirs) if "from" in row else (theirs, ours.qos)
        assert qos_check_compatible(offered, wanted)[0] != QoSCompatibility.ERROR


def test_base_leaves_services_of_nav2_free(base: Base) -> None:
    node = base.node(SIMULATOR)
    published = {publisher.topic_name for publisher in node.publishers}
    services = {service.srv_name for service in node.services}
    served = get_action_server_names_and_types_by_node(node, node.get_name(), node.get_namespace())
    actions = {name for name, _ in served}
    sent = {row["topic"] for row in FACTS["sent"] if row["to"] == "game"} - {"tf"}
    assert {f"{session.NAMESPACE}/{name}" for name in sent} & published == set()
    for row in FACTS["services"]:
        name = f"{session.NAMESPACE}/{row['name']}"
        assert name not in services
        assert name.removesuffix("/_action/send_goal") not in actions
    assert "map" not in base.links.values()


def test_nodes_have_no_names_of_nav2() -> None:
    assert set(MODULES) & set(FACTS["nodes"]["names"]) == set()


@pytest.mark.parametrize("row", FACTS["transforms"], ids=lambda row: f"{row['node']}: {row['of']} in {row['in']}")
def test_frames_are_connected(base: Base, row: dict[str, Any]) -> None:
    def frame(words: str | list[str]) -> str:
        if words == "the scan's frame":
            return str(base.heard("scan")[0].header.frame_id)
        return words if isinstance(words, str) else str(setting(*words))

    def above(name: str) -> list[str]:
        names = [name]
        while names[-1] in base.links:
            names.append(base.links[names[-1]])
        return names

    assert set(above(frame(row["of"]))) & set(above(frame(row["in"]))), base.links


@pytest.mark.parametrize("row", FACTS["rates"], ids=lambda row: f"{row['of']}: {row['why']}")
def test_rates_suffice_for_loops(base: Base, row: dict[str, Any]) -> None:
    longest_s = np.diff(base.stamps(row["of"])).max()
    if "at_least_hz" in row:
        allowed_s = 1.0 / (setting(*row["at_least_hz"]) * (2.0 if row.get("twice") else 1.0))
    else:
        allowed_s = setting(*row["longest_gap_s"]) + (setting(*row["plus"]) if "plus" in row else 0.0)
    assert 0.0 < longest_s <= allowed_s + 1e-6


def _positive_range(base: Base) -> None:
    assert all(scan.range_max > scan.range_min > 0.0 for scan in base.heard("scan"))


def _hits_or_nothing(base: Base) -> None:
    for scan in base.heard("scan"):
        ranges = np.array(scan.ranges)
        hit = (ranges > scan.range_min) & (ranges < scan.range_max)
        assert np.isposinf(ranges[~hit]).all()
        assert hit.sum() >= setting("collision_monitor", "FootprintApproach.min_points")


def _even_bearings(base: Base) -> None:
    for scan in base.heard("scan"):
        last = scan.angle_min + scan.angle_increment * (len(scan.ranges) - 1)
        assert last == pytest.approx(scan.angle_max, abs=1e-4)
        assert scan.angle_increment > 0.0


def _dated_rays(base: Base) -> None:
    period_s = np.diff(base.stamps("scan")).min()
    for scan in base.heard("scan"):
        assert scan.time_increment > 0.0
        assert scan.time_increment * (len(scan.ranges) - 1) <= scan.scan_time + 1e-6
        assert scan.scan_time <= period_s + 1e-6


def _twist_of_the_base(base: Base) -> None:
    last = base.heard("odom")[-1]
    assert (last.header.frame_id, last.child_frame_id) == ("odom", setting("local_costmap", "robot_base_frame"))
    assert last.twist.twist.linear.x == pytest.approx(VELOCITY[0], abs=0.05)
    assert last.twist.twist.angular.z == pytest.approx(VELOCITY[1], abs=0.1)


def _covariances(base: Base) -> None:
    for message in base.heard("odom"):
        for covariance in (message.pose.covariance, message.twist.covariance):
            assert min(covariance[[0, 7, 35]]) > 0.0


def _unit_quaternions(base: Base) -> None:
    for message in (*base.heard("tf"), *base.heard("tf_static")):
        for one in message.transforms:
            q, at = one.transform.rotation, one.transform.translation
            assert math.hypot(q.x, q.y, q.z, q.w) == pytest.approx(1.0, abs=1e-6)
            assert all(map(math.isfinite, (at.x, at.y, at.z)))


def _lidar_height(base: Base) -> None:
    height = 0.0
    frame = base.heard("scan")[0].header.frame_id
    static = {one.child_frame_id: one for message in base.heard("tf_static") for one in message.transforms}
    while frame in static:
        height += static[frame].transform.translation.z
        frame = static[frame].header.frame_id
    defaults = FACTS["defaults"]
    for costmap in ("local_costmap", "global_costmap"):
        for name in ("obstacle_layer", "clyde_layer"):
            layer = setting(costmap, name)
            lowest = layer.get("min_obstacle_height", defaults["obstacle_layer.min_obstacle_height"])
            source = layer["scan"]
            lowest_of_source = source.get("min_obstacle_height", defaults["obstacle_layer.source.min_obstacle_height"])
            assert max(lowest, lowest_of_source) < height < source["max_obstacle_height"]


def _rising_stamps(base: Base) -> None:
    now = {at: nanoseconds_of(message.clock) for at, message in base.timed("/clock")}
    for topic in ("odom", "scan", "tf"):
        stamps = [
            (at, nanoseconds_of(one.header.stamp))
            for at, message in base.timed(topic)
            for one in (message.transforms if topic == "tf" else [message])
            if topic != "tf" or one.child_frame_id == "base_link"
        ]
        assert all(later > earlier for (_, earlier), (_, later) in pairwise(stamps))
        assert all(stamp <= now[at] for at, stamp in stamps)


RULES: dict[str, Callable[[Base], None]] = {
    "range_max > 0": _positive_range,
    "a hit is within range_min and range_max, what is not is infinite": _hits_or_nothing,
    "bearings rise evenly from angle_min to angle_max": _even_bearings,
    "time_increment > 0, scan_time of all rays at most the scan's period": _dated_rays,
    "the twist is that of the base: forwards and turning": _twist_of_the_base,
    "covariances are not zero": _covariances,
    "unit quaternions, finite numbers": _unit_quaternions,
    "its height is above min_obstacle_height of layer and source, below max_obstacle_height": _lidar_height,
    "never repeated, never back, not ahead of the clock": _rising_stamps,
}


@pytest.mark.parametrize("row", FACTS["fields"], ids=lambda row: f"{row['of']}: {row['rule']}")
def test_messages_hold_what_nav2_reads(base: Base, row: dict[str, Any]) -> None:
    RULES[row["rule"]](base)


def test_odometry_agrees_with_its_transform(base: Base) -> None:
    of_transforms = {nanoseconds_of(one.header.stamp): transform_of(one)[2] for one in base.odometry_transforms()}
    messages = base.heard("odom")
    assert len(messages) > 100
    for message in messages:
        at = message.pose.pose.position
        x, y, _ = of_transforms[nanoseconds_of(message.header.stamp)]
        assert (x, y) == pytest.approx((at.x, at.y), abs=1e-9)


def test_each_scan_has_transform_of_its_time(base: Base) -> None:
    stamps = base.stamps("transform")
    tolerance_s = FACTS["defaults"]["obstacle_layer.tf_filter_tolerance"]
    assert base.stamps("scan")[2] > stamps[0]
    for stamp in base.stamps("scan")[2:]:
        assert min(abs(stamp - one) for one in stamps) <= tolerance_s


def test_scans_show_walls_of_map(base: Base) -> None:
    """Each ray from where the base was at its time, by ``time_increment``."""
    static = {
        one.child_frame_id: transform_of(one)[2] for message in base.heard("tf_static") for one in message.transforms
    }
    lidar = static[base.heard("scan")[0].header.frame_id]
    times, odometry = base.stamps("transform"), [transform_of(one)[2] for one in base.odometry_transforms()]
    occupancy, home = rooms(), base.node(SIMULATOR).robot.grid.home.tolist()
    away = clearance_m(occupancy.occupancy != 100, occupancy.resolution)
    off = []
    for scan in base.heard("scan")[5::5]:
        for ray in np.flatnonzero(np.isfinite(scan.ranges))[::7].tolist():
            at_s = seconds_of(scan.header.stamp) + ray * scan.time_increment
            pose = [float(np.interp(at_s, times, numbers)) for numbers in zip(*odometry, strict=True)]
            x, y, heading = compose(compose(home, pose), lidar)  # type: ignore[arg-type]
            angle = heading + scan.angle_min + ray * scan.angle_increment
            end = x + scan.ranges[ray] * math.cos(angle), y + scan.ranges[ray] * math.sin(angle)
            column, row = (round(number) for number in occupancy.world_to_cell(*end))
            off.append(float(away[row, column]))
    assert len(off) > 1000
    assert np.percentile(off, 95) < 1.5 * occupancy.resolution


def test_error_codes_are_those_of_nav2() -> None:
    known = FACTS["error_codes"]
    ours = {name: value for name, value in vars(navigate_to_pose).items() if name.isupper() and type(value) is int}
    for name in ("FAILED_TO_MAKE_PROGRESS", "NO_VALID_CONTROL"):
        assert ours[name] == known["FollowPath"][name]
    for name in ("TF_ERROR", "GOAL_OUTSIDE_MAP", "GOAL_OCCUPIED", "NO_VALID_PATH"):
        assert ours[name] == known["ComputePathToPose"][name]
