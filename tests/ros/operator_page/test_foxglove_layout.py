"""The layout for viewers of recorded bags names topics that there are, and fields that their messages have."""

import json
import re
from operator import attrgetter
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
    panels = [panel for name, panel in PANELS.items() if name.startswith(("Plot!", "StateTransitions!"))]
    values = [path["value"].partition(".") for panel in panels for path in panel.get("paths", ())]
    assert len(values) > 5
    for name, _, field in values:
        if name not in SCRIPTS:
            topic = known(name)
            assert topic.name in recorded
            attrgetter(field)(topic.type())
    assert known(PANELS["RawMessages!selector"]["topicPath"]).name in recorded


def test_scripts_read_existing_topics() -> None:
    for source in SCRIPTS.values():
        names = re.findall(r'"(/robot_15/[^"]+)"', source)
        assert names
        for name in names:
            known(name)
    attrgetter("pose.pose.position.x")(topics.AMCL_POSE.type())
    attrgetter("pose.position.x")(topics.CLYDE_POSE.type())


def test_every_panel_has_its_place() -> None:
    def placed(part: Any) -> list[str]:
        return [part] if isinstance(part, str) else [*placed(part["first"]), *placed(part["second"])]

    assert sorted(placed(LAYOUT["layout"])) == sorted(PANELS)
