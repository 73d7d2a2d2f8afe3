"""What a killed recorder leaves: a real one killed, its bag mended and replayed; and bags cut and damaged anywhere."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import yaml

pytest.importorskip("rclpy")
pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.records import Chunk
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from pacman_env.cli.main import main
from pacman_env.ros import topics
from pacman_env.ros.bags.bag import COMMAND, MAGIC, BagError, open_bag, unfinished_folder
from pacman_env.ros.bags.record import FLUSH_S, NAME, RECORDED, Recorder, record
from pacman_env.ros.bags.recover import Recovered, recover
from pacman_env.ros.messages import markers_of, pose_message
from tests.ros import session
from tests.ros.bags.test_bag_replay import write_round
from tests.ros.bags.test_record import start_recording
from tests.ros.selector_game import house, pellet


def raw_messages(path: Path) -> list[bytes]:
    """The messages of a whole bag, in order."""
    with Reader(path) as reader:
        return [bytes(raw) for _, _, raw in reader.messages()]


def on_the_disk(folder: Path) -> int:
    """How many messages can be read in a bag that is being recorded."""
    count = 0
    with next(folder.glob("*/*.mcap")).open("rb") as file:
        try:
            for one in StreamReader(file, emit_chunks=True).records:
                count += len([m for m in breakup_chunk(one) if hasattr(m, "log_time")]) if isinstance(one, Chunk) else 0
        except Exception:  # its end is not there yet
            pass
    return count


class Recording:
    """A real recorder, and what is said beside it."""

    def __init__(self, system: Any, probe: Any, out: Path) -> None:
        self.probe, self.out = probe, out
        self.folder = unfinished_folder(out)
        self.said = 0
        self.system = system
        self.recorder = start_recording(system, out)
        probe.wait_for(lambda: "recording /robot_15" in self.recorder.output, what="the recorder is up")

    def say(self, *messages: tuple[topics.Topic, Any]) -> None:
        """Publish, and wait until all is on the disk while the recorder goes on: nothing else is said meanwhile."""
        for topic, message in messages:
            self.probe.publish(topic, message)
        self.said += len(messages)
        self.probe.wait_for(lambda: on_the_disk(self.folder) >= self.said, what="messages on the disk")

    def kill(self) -> None:
        self.recorder.popen.kill()
        self.recorder.popen.wait()
        self.system.processes.remove(self.recorder)


@pytest.fixture
def recording(system: Any, probe: Any, tmp_path: Path) -> Recording:
    return Recording(system, probe, tmp_path / "games" / "first")


def test_a_killed_recorders_bag_is_mended_and_replayed_with_all_that_was_on_the_disk(
    recording: Recording, capsys: pytest.CaptureFixture[str]
) -> None:
    probe, out = recording.probe, recording.out
    here = house().grid.home.tolist()
    pose = topics.AMCL_POSE.type()
    pose.header.frame_id = "map"
    pose.pose.pose = pose_message(*here, probe.stamp()).pose
    recording.say(
        (topics.GAME_STATE, "menu"),
        (topics.CLYDE_SPEED, 0.25),
        (topics.CLYDE_POSE, pose_message(50.0, 50.0, 0.0, probe.stamp())),
        (
            topics.PELLET_MARKERS,
            markers_of({int(n): pellet(k) for k, n in enumerate(house().pellet_ids)}, probe.stamp()),
        ),
        (topics.AMCL_POSE, pose),
        (topics.GAME_STATE, "running"),
    )
    recording.say((topics.SCORE, 1), (topics.GAME_STATUS, "pellet_collected:3"))
    with pytest.raises(BagError, match="still being recorded"):
        recover(out)
    with pytest.raises(FileExistsError, match="is being recorded already"):
        record(out, "robot_15")
    with pytest.raises(BagError, match="still being recorded"), open_bag(out):
        pass
    recording.kill()

    replay = ["ros", "replay", str(out), "--map", "house", "--policy", "nearest"]
    assert main(replay) == 2
    error = capsys.readouterr().err
    assert f"{COMMAND} {out}" in error
    assert error.count("\n") == 1
    with pytest.raises(FileExistsError, match=COMMAND):
        record(out, "robot_15")
    left = {path: path.read_bytes() for path in recording.folder.glob("*/*")}
    report = recover(out)
    assert (report.out, report.messages) == (out, recording.said)
    assert str(out) in report.render()
    assert {path: path.read_bytes() for path in recording.folder.glob("*/*")} == left
    assert main(replay) == 0
    assert "rounds 1, 1 pellet_collected" in capsys.readouterr().out
    assert sorted(path.name for path in out.parent.iterdir()) == ["first", "first.unfinished"]


@pytest.fixture(scope="module")
def recorded(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag of three chunks, written by the recorder's node."""
    folder = tmp_path_factory.mktemp("games")
    with session.nodes(folder) as nodes:
        recorder = nodes.start(NAME, lambda: Recorder(folder / "first", sim_time=True))
        chunks: list[list[tuple[topics.Topic, Any]]] = [
            [(topics.GAME_COMMAND, word) for word in ("disable", "reset_round", "enable")],
            [(topics.SCORE, 1), (topics.GAME_STATE, "running")],
            [(topics.SCORE, 2)],
        ]
        for messages in chunks:
            for topic, message in messages:
                nodes.publish(topic, message)
            nodes.advance(FLUSH_S)
        nodes.game.remove(recorder)
    return folder / "first"


@pytest.fixture
def in_chunks(recorded: Path, tmp_path: Path) -> Path:
    """The recorded bag, to do with as one likes."""
    return Path(shutil.copytree(recorded, tmp_path / "first"))


def chunks_of(file: Path) -> list[tuple[int, list[bytes]]]:
    """Where each chunk ends, and its messages."""
    chunks = []
    with file.open("rb") as stream:
        for one in StreamReader(stream, emit_chunks=True).records:
            if isinstance(one, Chunk):
                messages = [bytes(m.data) for m in breakup_chunk(one) if hasattr(m, "log_time")]
                chunks.append((stream.tell(), messages))
    return chunks


def places_of(file: Path) -> list[int]:
    """Where a file may be cut: around the first record of each kind, and around all chunks.

    A record is an opcode of one byte, the length of its content in eight bytes, and that content.
    """
    ends = {0: "", len(MAGIC): "magic"}
    with file.open("rb") as stream:
        for one in StreamReader(stream, emit_chunks=True).records:
            ends[stream.tell()] = type(one).__name__
    places: set[int] = set()
    seen: set[str] = set()
    for begin, end in pairwise(ends):
        kind = ends[end]
        if kind == "Chunk":
            places |= {begin, begin + 1, begin + 9, (begin + end) // 2, end - 1, end}
        elif kind not in seen:
            places |= {begin + 5, end}
        seen.add(kind)
    assert {"magic", "Header", "Chunk", "MessageIndex", "DataEnd", "Statistics", "Footer"} <= seen, seen
    return sorted(place for place in places if place < file.stat().st_size)


def recovered(content: bytes, by_ros: bool = True) -> tuple[list[bytes] | str, Recovered | None]:
    """The messages of what becomes of a file, or the one line that says why nothing does.

    ``by_ros``: the bag is read as ROS reads it, with metadata and index; else the MCAP file alone, in half the time.
    """
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "cut.mcap"
        file.write_bytes(content)
        try:
            report = recover(file)
        except BagError as error:
            assert os.listdir(folder) == ["cut.mcap"]
            return str(error).replace(folder, ""), None
        assert file.read_bytes() == content
        assert sorted(os.listdir(folder)) == ["cut.mcap", "cut_recovered"]
        if by_ros:
            messages = raw_messages(report.out)
        else:
            messages = [message for _, chunk in chunks_of(report.out / "cut_recovered.mcap") for message in chunk]
        assert len(messages) == report.messages
        return messages, report


def check_cut(file: Path, length: int, zeros: bool) -> None:
    """All messages of the whole chunks before the cut, or one line; ``zeros``: as a file system may fill up."""
    content, chunks = file.read_bytes(), chunks_of(file)
    by_ros = length in [end for end, _ in chunks]
    said, report = recovered(content[:length] + bytes((len(content) - length) * zeros), by_ros)
    expected = [message for end, messages in chunks if end <= length for message in messages]
    if expected:
        assert said == expected, length
        assert report is not None
        assert report.found.lost_bytes <= len(content) - chunks[0][0]
    else:
        assert isinstance(said, str), length
        assert said.startswith("/cut.mcap: ")
        assert "\n" not in said


@pytest.mark.daily
def test_a_bag_cut_around_records_of_every_kind_gives_all_messages_of_its_whole_chunks_or_one_line(
    recorded: Path,
) -> None:
    file = recorded / "first.mcap"
    assert len(chunks_of(file)) == 3
    for number, place in enumerate(places_of(file)):
        check_cut(file, place, zeros=number % 2 == 1)


@settings(max_examples=10)
@given(st.floats(0, 1, exclude_max=True), st.booleans())
def test_a_bag_cut_anywhere_gives_all_messages_of_its_whole_chunks_or_one_line(
    recorded: Path, share: float, zeros: bool
) -> None:
    file = recorded / "first.mcap"
    check_cut(file, int(share * file.stat().st_size), zeros)


@pytest.mark.daily
def test_a_bag_cut_at_any_of_a_thousand_places_gives_all_messages_of_its_whole_chunks_or_one_line(
    recorded: Path,
) -> None:
    file = recorded / "first.mcap"
    for number in range(1000):
        check_cut(file, number * file.stat().st_size // 1000, zeros=number % 2 == 1)


@settings(max_examples=40)
@given(st.integers(0, 3000), st.binary(min_size=1, max_size=40))
def test_a_bag_damaged_anywhere_gives_a_bag_or_one_line(damaged: Path, at: int, garbage: bytes) -> None:
    content = (damaged / "game.mcap").read_bytes()
    at = at * len(content) // 3000
    said, _ = recovered(content[:at] + garbage + content[at + len(garbage) :][:-50])
    assert isinstance(said, list) or (said.startswith("/cut.mcap: ") and "\n" not in said)


@pytest.fixture(scope="module")
def damaged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("bags") / "game"
    write_round(path, "nearest")
    return path


def information(bag: Path) -> Any:
    return yaml.safe_load((bag / "metadata.yaml").read_text())["rosbag2_bagfile_information"]


def test_a_recovered_bag_describes_itself_as_one_that_was_never_cut(in_chunks: Path, tmp_path: Path) -> None:
    file = tmp_path / "cut.mcap"
    end = chunks_of(in_chunks / "first.mcap")[-1][0]
    file.write_bytes((in_chunks / "first.mcap").read_bytes()[:end])
    out = recover(file, tmp_path / "again" / "first").out
    whole, again = information(in_chunks), information(out)
    assert again["custom_data"].pop("recovered_from") == "cut.mcap"
    assert again == whole  # counts, times, types and their hashes, QoS
    with open_bag(in_chunks) as one, open_bag(out) as other:
        assert list(one.messages(RECORDED)) == list(other.messages(RECORDED))
    assert len(whole["topics_with_message_count"]) == len(RECORDED)


def test_a_recorder_killed_between_bag_and_its_name_is_mended(in_chunks: Path) -> None:
    folder = unfinished_folder(in_chunks)
    folder.mkdir()
    in_chunks.rename(folder / "first")
    for loss in (lambda: None, (folder / "first" / "metadata.yaml").unlink):
        loss()
        messages = recover(folder).messages
        assert messages == 6 == len(raw_messages(in_chunks))
        for path in in_chunks.iterdir():
            path.unlink()
        in_chunks.rmdir()


@pytest.mark.parametrize("compression", list(CompressionType))
@pytest.mark.parametrize("chunked", [True, False])
def test_the_unfinished_bag_of_another_recorder_is_mended(
    tmp_path: Path, chunked: bool, compression: CompressionType
) -> None:
    store = get_typestore(Stores.ROS2_JAZZY)
    text, _ = store.generate_msgdef("std_msgs/msg/String", ros_version=2)
    file = tmp_path / "theirs_0.mcap"
    times = [30, 10, 20]  # several threads record
    with file.open("wb") as stream:
        writer = McapWriter(stream, chunk_size=1, compression=compression, use_chunking=chunked)
        writer.start(profile="ros2", library="libmcap 1.1.0")
        schema = writer.register_schema("std_msgs/msg/String", "ros2msg", text.encode())
        channels = [writer.register_channel("/game_state", "cdr", schema) for _ in range(2)]  # two publishers
        for k, time in enumerate(times):
            data = store.serialize_cdr(store.types["std_msgs/msg/String"](data=str(time)), "std_msgs/msg/String")
            writer.add_message(channels[k % 2], time, bytes(data), time)
        stream.flush()
        report = recover(file)
    assert report.out == tmp_path / "theirs_0_recovered"
    with open_bag(report.out) as bag:
        assert [m.message.data for m in bag.messages([topics.GAME_STATE])] == ["10", "20", "30"]


def test_what_cannot_be_recovered_is_one_line_and_leaves_nothing(tmp_path: Path) -> None:
    write_round(tmp_path / "whole", "nearest")
    whole = (tmp_path / "whole" / "whole.mcap").read_bytes()
    (tmp_path / "no_mcap").mkdir()
    (tmp_path / "two").mkdir()
    for name, content in (
        *(("empty.mcap", b""), ("text.mcap", b"no MCAP at all"), ("magic.mcap", MAGIC), ("header.mcap", whole[:20])),
        *(("first_chunk.mcap", whole[:500]), ("two/a.mcap", whole[:500]), ("two/b.mcap", whole[:500])),
        ("ros1.mcap", whole.replace(b"ros2", b"ros1", 1)[:-50]),
    ):
        (tmp_path / name).write_bytes(content)
    (tmp_path / "there").mkdir()
    before = sorted(tmp_path.rglob("*"))
    for name, words in {
        "absent": "neither a bag nor what a recorder has left",
        "empty.mcap": "is empty",
        "text.mcap": "is no MCAP file",
        "magic.mcap": "not one whole message in it",
        "header.mcap": "not one whole message in it",
        "first_chunk.mcap": "not one whole message in it",
        "ros1.mcap": "not recorded by ROS 2, but with profile 'ros1'",
        "no_mcap": "no .mcap file in it",
        "two": "several .mcap files in it, name one: a.mcap",
        "whole": "nothing to recover",
        "whole/whole.mcap": "nothing to recover",
    }.items():
        with pytest.raises(BagError) as caught:
            recover(tmp_path / name)
        assert str(caught.value).startswith(f"{tmp_path / name}: ")
        assert words in str(caught.value)
        assert "\n" not in str(caught.value)
    (tmp_path / "cut.mcap").write_bytes(whole[:-50])
    with pytest.raises(FileExistsError, match="there: exists already"):
        recover(tmp_path / "cut.mcap", tmp_path / "there")
    (tmp_path / "cut.mcap").unlink()
    assert sorted(tmp_path.rglob("*")) == before


def test_a_bag_that_is_not_whole_is_said_to_be_mendable_with_its_path_quoted(tmp_path: Path) -> None:
    write_round(tmp_path / "my game", "nearest")
    file = tmp_path / "my game" / "my game.mcap"
    file.write_bytes(file.read_bytes()[:-50])
    for path in (file, file.parent):
        with pytest.raises(BagError, match="no bag that can be read") as caught, open_bag(path):
            pass
        assert f"{COMMAND} '{path}' makes a whole bag" in str(caught.value)
        assert recover(path).messages > 0


@pytest.mark.parametrize("unbuffered", ["", "1"], ids=["written at the end", "written at once"])
@pytest.mark.parametrize("options", [[], ["--json"]], ids=["text", "JSON"])
def test_a_replay_whose_reader_has_enough_ends_without_a_traceback(
    damaged: Path, options: list[str], unbuffered: str
) -> None:
    """As ``| head`` does, but certainly before anything is written."""
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-m", "pacman_env.cli.main", "ros", "replay", str(damaged), "--map", "house"]
    with open(writing, "wb") as output:
        ended = subprocess.run(
            [*command, "--policy", "nearest", *options],
            env={**os.environ, "PYTHONUNBUFFERED": unbuffered},
            stdout=output,
            stderr=subprocess.PIPE,
        )
    assert b"Traceback" not in ended.stderr
    assert b"Exception ignored" not in ended.stderr
    assert ended.stderr.count(b"\n") <= 1
