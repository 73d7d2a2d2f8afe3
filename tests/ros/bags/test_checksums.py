"""Recordings that are damaged in any of their chunks: nothing altered is read, and what is lost is reported."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from hypothesis import assume, given, settings
from hypothesis import strategies as st
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from rosbags.rosbag2 import StoragePlugin, Writer

from pacman_env.ros.bags.bag import new_bag, open_bag
from pacman_env.ros.bags.checksums import McapScan
from tests.ros.bags.recorded import STORE, refusal
from tests.ros.bags.test_unfinished import chunks_of, raw_messages

STRING = "std_msgs/msg/String"


def write(writer: Writer) -> Path:
    """Write a bag of three chunks."""
    with writer:
        names = ("/game_state", "/game_command")
        one, other = (writer.add_connection(name, STRING, typestore=STORE) for name in names)
        for number in range(3):
            for k in range(20):
                data = STORE.serialize_cdr(STORE.types[STRING](data=f"word {number} {k}"), STRING)
                writer.write((one, other)[k % 2], 100 * number + k, data)
            writer.storage.close_chunk()
    return Path(writer.path)


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write(new_bag(tmp_path_factory.mktemp("games") / "first"))


def data_of(file: Path) -> list[tuple[int, int]]:
    """Where the compressed data of each chunk begins and ends."""
    with file.open("rb") as stream:
        records = StreamReader(stream, emit_chunks=True).records
        return [(stream.tell() - len(one.data), stream.tell()) for one in records if isinstance(one, Chunk)]


@settings(max_examples=25)
@given(st.integers(0, 2), st.floats(0, 1, exclude_max=True), st.lists(st.integers(0, 511), max_size=3))
def test_damage_in_a_chunk_is_reported(recorded: Path, number: int, share: float, bits: list[int]) -> None:
    """Flip up to three bits, or zero 64 bytes."""
    whole, chunks = recorded / "first.mcap", chunks_of(recorded / "first.mcap")
    content, (begin, end) = bytearray(whole.read_bytes()), data_of(whole)[number]
    at = begin + int(share * (end - begin))
    for bit in bits:
        content[min(at + bit // 8, end - 1)] ^= 1 << bit % 8
    if not bits:
        stop = min(at + 64, end)
        content[at:stop] = bytes(stop - at)
    assume(content != whole.read_bytes())
    file = recorded.parent / "damaged.mcap"
    file.write_bytes(content)
    refusal(file, "damaged: ")
    with file.open("rb") as stream:
        damaged = McapScan(stream).damaged
    assert [(one.chunk, one.messages) for one in damaged] in ([], [(number + 1, len(chunks[number][1]))])


def test_recording_without_checksums_stays_unchecked(recorded: Path, tmp_path: Path) -> None:
    old = write(Writer(tmp_path / "game", version=9, storage_plugin=StoragePlugin.MCAP))
    count = len(raw_messages(old))
    with open_bag(old) as before, open_bag(recorded) as new:
        assert (str(count) in before.unchecked, new.unchecked) == (True, "")


def test_change_outside_of_messages_is_refused(recorded: Path, tmp_path: Path) -> None:
    whole, file = (recorded / "first.mcap").read_bytes(), tmp_path / "broken.mcap"
    file.write_bytes(whole[:100] + bytes(40) + whole[140:])
    refusal(file, r"broken\.mcap: ")
