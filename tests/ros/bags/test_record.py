"""A bag of what real publishers say, recorded by the real command; what is read back is what was said."""

import sys
from functools import partial
from pathlib import Path

import pytest

pytest.importorskip("rosbags")

from rclpy.duration import Duration
from rosbags.rosbag2 import Reader, StoragePlugin, Writer

from pacman_env.ros import topics
from pacman_env.ros.bags.bag import open_bag
from pacman_env.ros.bags.record import RECORDED, record
from pacman_env.ros.message_conversion import uncertain_pose_message
from tests.ros.bags.recorded import STORE, messages_of, refusal
from tests.ros.system import Probe, Process, System

WORDS = ["disable", "reset_round", "enable"]


def start_recording(system: System, probe: Probe, out: Path) -> Process:
    command = [sys.executable, "-m", "pacman_env.cli.main", "ros", "record", "--namespace", "robot_15"]
    recorder = system.run("record", [*command, "--out", str(out)])
    probe.wait_for(lambda: "recording /robot_15" in recorder.output, what="the recorder is up")
    return recorder


@pytest.fixture(scope="module")
def bag(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Commands in a burst, scores and a pose; recorded, stopped and whole."""
    out = tmp_path_factory.mktemp("games") / "first"
    with System(tmp_path_factory.mktemp("system")) as system, Probe(system) as probe:
        recorder = start_recording(system, probe, out)
        probe.publish(topics.GAME_STATE, "running")
        for word in WORDS:
            probe.publish(topics.GAME_COMMAND, word)
        probe.publish(topics.SCORE, 3)
        unfinished = out.with_name("first.unfinished") / "first" / "first.mcap"
        probe.wait_for(lambda: len(messages_of(unfinished)) == 5, what="everything is on the disk")
        probe.publish(topics.AMCL_POSE, uncertain_pose_message(1.25, 0.0, 0.0, probe.stamp()))
        acked = partial(probe.publisher(topics.AMCL_POSE).wait_for_all_acked, Duration(seconds=0.2))
        probe.wait_for(acked, what="the pose has arrived")  # it may wait in the recorder
        assert not out.exists()  # only when it is whole
        assert recorder.stop() == 0, recorder.output
        assert f"{out}: 6 messages" in recorder.output
    assert sorted(path.name for path in out.parent.iterdir()) == ["first"]
    return out


def test_bag_holds_messages_in_order(bag: Path) -> None:
    with open_bag(bag) as game:
        assert game.namespace == "/robot_15"
        said = list(game.messages(RECORDED))
    assert [m.message.data for m in said if m.topic == "game_command"] == WORDS
    assert [m.message.data for m in said if m.topic == "game/score"] == [3]
    (pose,) = [m.message for m in said if m.topic == "amcl_pose"]
    assert pose.pose.pose.position.x == 1.25
    times = [m.at_s for m in said]
    assert [0.0, *times] == sorted([0.0, *times])
    with open_bag(bag / "first.mcap") as game, pytest.raises(StopIteration):  # the file alone; no such topic in it
        next(game.messages([topics.PLAN]))


def test_tools_of_ros_can_play_bag(bag: Path) -> None:
    """``metadata.yaml`` lists the topics; latched topics are latched when they are played."""
    with Reader(bag) as reader:
        durability = {one.topic: one.ext.offered_qos_profiles[0].durability.name for one in reader.connections}
        assert reader.message_count == 6
    assert durability == {f"/robot_15/{topic.name}": topic.qos.durability.name for topic in RECORDED}


def test_no_map_scan_or_picture_is_recorded() -> None:
    names = {topic.name for topic in RECORDED}
    assert not names & {topics.MAP.name, topics.SCAN.name}
    assert not {topic.type_name for topic in RECORDED} & {"nav_msgs/OccupancyGrid", "sensor_msgs/Image"}


def test_existing_folder_is_not_touched(tmp_path: Path) -> None:
    with pytest.raises(FileExistsError, match="not overwritten"):
        record(tmp_path, "robot_15")


def test_recorder_leaves_nothing_without_messages(system: System, probe: Probe, tmp_path: Path) -> None:
    recorder = start_recording(system, probe, tmp_path / "empty")
    assert recorder.stop() == 2
    assert "no message was received under /robot_15" in recorder.output
    assert not (tmp_path / "empty").exists()
    system.processes.clear()


def test_file_that_is_no_bag_is_refused(tmp_path: Path) -> None:
    refusal(tmp_path / "absent.mcap", "not a readable bag")
    for content in (b"", b"\x89MCAP0\r\n" + bytes(99)):
        (tmp_path / "x.mcap").write_bytes(content)
        refusal(tmp_path / "x.mcap", "not a readable bag")


def test_bag_of_other_topics_is_refused(tmp_path: Path) -> None:
    for name, kind, words in (
        ("chatter", "String", "no topic game_state, but /chatter"),
        ("game_state", "Int32", "/game_state is std_msgs/msg/Int32, expected std_msgs/msg/String"),
    ):
        with Writer(tmp_path / name, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            writer.add_connection(f"/{name}", f"std_msgs/msg/{kind}", typestore=STORE)
        refusal(tmp_path / name, words)
