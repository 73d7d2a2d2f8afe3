"""The layout for viewers of recorded bags names topics that there are, and fields that their messages have."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pacman_env.ros import topics
from pacman_env.ros.bags.record import RECORDED
from pacman_env.ros.topics import Topic
from tests.ros.system import NAMESPACE

LAYOUT = json.loads((Path(__file__).resolve().parents[3] / "docs" / "foxglove_layout.json").read_text())
PANELS: dict[str, Any] = LAYOUT["configById"]
KNOWN = {
    topic.name: topic
    for value in vars(topics).values()
    for topic in (value if isinstance(value, tuple) else (value,))
    if isinstance(topic, Topic)
}
#: What a 3D panel draws, and takes a click for.
DRAWN = {
    *("nav_msgs/OccupancyGrid", "nav_msgs/Path", "nav_msgs/Odometry", "sensor_msgs/LaserScan"),
    *("visualization_msgs/Marker", "visualization_msgs/MarkerArray"),
    *("geometry_msgs/PoseStamped", "geometry_msgs/PoseWithCovarianceStamped"),
}
SCRIPTS = {
    re.search(r'output = "(.+)"', one["sourceCode"])[1]: one["sourceCode"]  # type: ignore[index]
    for one in LAYOUT["userNodes"].values()
}


def known(name: str) -> Topic:
    assert name.startswith(f"{NAMESPACE}/"), name
    topic = KNOWN.get(name.removeprefix(f"{NAMESPACE}/"))
    assert topic is not None, f"no topic {name}"
    return topic


def paths() -> Iterator[tuple[str, str]]:
    """Topic and field of each curve."""
    for name, panel in PANELS.items():
        for path in panel.get("paths", ()) if name.startswith(("Plot!", "StateTransitions!")) else ():
            topic, _, field = path["value"].partition(".")
            yield topic, field


def has(kind: Any, field: str) -> bool:
    message = kind()
    for part in field.split("."):
        if not hasattr(message, part):
            return False
        message = getattr(message, part)
    return True


def test_panel_3d_draws_topics_of_known_types() -> None:
    panel = PANELS["3D!game"]
    for name in panel["topics"]:
        assert known(name).type_name in DRAWN, name
    for name in ("map", "pellet_markers", "amcl_pose", "clyde_pose", "plan", "scan"):
        assert f"{NAMESPACE}/{name}" in panel["topics"]
    assert known(panel["publish"]["pointTopic"]).type_name == "geometry_msgs/PointStamped"
    assert known(panel["publish"]["poseEstimateTopic"]).type_name == "geometry_msgs/PoseWithCovarianceStamped"


def test_curves_show_recorded_topics_and_fields() -> None:
    recorded = {topic.name for topic in RECORDED}
    found = list(paths())
    assert len(found) > 5
    for name, field in found:
        if name in SCRIPTS:
            continue
        topic = known(name)
        assert topic.name in recorded
        assert has(topic.type, field), f"{name}.{field}"
    assert known(PANELS["RawMessages!selector"]["topicPath"]).name in recorded


def test_scripts_read_existing_topics() -> None:
    for source in SCRIPTS.values():
        names = re.findall(r'"(/robot_15/[^"]+)"', source)
        assert names
        for name in names:
            known(name)
    assert has(topics.AMCL_POSE.type, "pose.pose.position.x")
    assert has(topics.CLYDE_POSE.type, "pose.position.x")


def test_every_panel_has_its_place() -> None:
    def placed(part: Any) -> list[str]:
        return [part] if isinstance(part, str) else [*placed(part["first"]), *placed(part["second"])]

    assert sorted(placed(LAYOUT["layout"])) == sorted(PANELS)
