"""What a killed recorder leaves: all whole chunks, and one line with the commands that make a bag of them."""

from __future__ import annotations

import contextlib
import shutil
import struct
import subprocess
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.exceptions import McapError
from mcap.records import Channel, Chunk, Header, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.writer import Writer
from rosbags.rosbag2 import Reader

from pacman_env.ros import topics
from pacman_env.ros.bags.bag import open_bag, unfinished_folder
from pacman_env.ros.bags.record import FLUSH_S, NAME, RECORDED, Recorder, record
from tests.ros import session
from tests.ros.bags.recorded import refusal

CUT_OFF = McapError, struct.error  # what MCAP's library raises where a file is cut off


def raw_messages(path: Path) -> list[bytes]:
    """Read the messages of a whole bag, in order."""
    with Reader(path) as reader:
        return [bytes(raw) for _, _, raw in reader.messages()]


def chunks_of(file: Path) -> list[tuple[int, list[bytes]]]:
    """Read where each whole chunk ends, and its messages."""
    chunks = []
    with file.open("rb") as stream, contextlib.suppress(*CUT_OFF):  # a file may be cut off
        for one in StreamReader(stream, emit_chunks=True).records:
            if isinstance(one, Chunk):
                messages = [bytes(m.data) for m in breakup_chunk(one) if isinstance(m, Message)]
                chunks.append((stream.tell(), messages))
    return chunks


def recover(source: Path, out: Path) -> None:
    """Do what ``mcap recover`` does: with the tool if it is installed, else with MCAP's library."""
    if tool := shutil.which("mcap"):
        assert subprocess.run([tool, "recover", source, "-o", out]).returncode in (0, 3)  # 3: the end is lost
        return
    with source.open("rb") as read, out.open("wb") as written, contextlib.suppress(*CUT_OFF):
        writer, schemas, channels = Writer(written), {0: 0}, dict[int, int]()
        try:
            for one in StreamReader(read).records:
                if isinstance(one, Header):
                    writer.start(one.profile)
                elif isinstance(one, Schema):
                    schemas[one.id] = writer.register_schema(one.name, one.encoding, one.data)
                elif isinstance(one, Channel):
                    kept = one.topic, one.message_encoding, schemas[one.schema_id], one.metadata
                    channels[one.id] = writer.register_channel(*kept)
                elif isinstance(one, Message):
                    times = one.log_time, one.data, one.publish_time, one.sequence
                    writer.add_message(channels[one.channel_id], *times)
        finally:
            writer.finish()


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
        for number, messages in enumerate(chunks, 1):
            for topic, message in messages:
                nodes.publish(topic, message)
            nodes.advance(FLUSH_S)
            assert len(chunks_of(folder / "first" / "first.mcap")) == number, "on the disk before the end"
        nodes.game.remove(recorder)
    assert [len(messages) for _, messages in chunks_of(folder / "first" / "first.mcap")] == [3, 2, 1]
    return folder / "first"


@pytest.mark.parametrize("chunks", [1, 2, 3])
@pytest.mark.parametrize("more", [0, 40])
def test_cut_recording_has_its_whole_chunks_when_recovered(
    recorded: Path, tmp_path: Path, chunks: int, more: int
) -> None:
    whole, cut = recorded / "first.mcap", tmp_path / "cut.mcap"
    end, _ = chunks_of(whole)[chunks - 1]
    cut.write_bytes(whole.read_bytes()[: end + more])
    recover(cut, tmp_path / "cut_recovered_0.mcap")
    expected = [message for _, messages in chunks_of(whole)[:chunks] for message in messages]
    assert raw_messages(tmp_path / "cut_recovered_0.mcap") == expected
    if chunks > 1:
        with open_bag(tmp_path / "cut_recovered_0.mcap") as bag:
            assert len(list(bag.messages(RECORDED))) == len(expected)


@settings(max_examples=20)
@given(st.floats(0, 1, exclude_max=True), st.booleans())
def test_recording_cut_anywhere_is_refused_in_one_line(recorded: Path, share: float, zeros: bool) -> None:
    content, file = (recorded / "first.mcap").read_bytes(), recorded.parent / "cut.mcap"
    length = int(share * len(content))
    file.write_bytes(content[:length] + bytes((len(content) - length) * zeros))  # as a file system may fill up
    line = refusal(file, "not a readable bag")
    assert ("; mcap recover " in line) == (length >= 8)  # with MCAP's first bytes


def test_bag_of_running_recorder_is_refused_and_not_replaced(recorded: Path, tmp_path: Path) -> None:
    out = tmp_path / "first"
    file = unfinished_folder(out) / "first" / "first.mcap"
    file.parent.mkdir(parents=True)
    file.write_bytes((recorded / "first.mcap").read_bytes()[:-50])
    remedy = f"mkdir {out}; mcap recover {file} -o {out / 'first_0.mcap'}; ros2 bag reindex {out}"
    assert refusal(out, "not finished: Ctrl-C ends its recorder").endswith(f"if it was killed: {remedy}")
    with pytest.raises(FileExistsError, match=r"first\.unfinished: already exists; delete it, or .*; mcap recover "):
        record(out, "robot_15")


def test_remedy_of_unfinished_bag_quotes_its_path(recorded: Path, tmp_path: Path) -> None:
    file = tmp_path / "my game" / "my game.mcap"
    file.parent.mkdir()
    file.write_bytes((recorded / "first.mcap").read_bytes()[:-50])
    for path in (file, file.parent):
        line = refusal(path, "not a readable bag")
        new = tmp_path / "my game" / "my game_recovered" if path == file else tmp_path / "my game_recovered"
        out = new / "my game_recovered_0.mcap"
        assert f"mkdir '{new}'; mcap recover '{file}' -o '{out}'; ros2 bag reindex '{new}'" in line
