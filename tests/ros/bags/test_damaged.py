"""Recordings that end in the middle or are altered: whole chunks stay readable, and no altered message is read."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("rosbags")
pytest.importorskip("mcap")

from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.records import Chunk
from mcap.stream_reader import StreamReader
from rosbags.rosbag2 import StoragePlugin, Writer

from pacman_env.ros.bags.bag import open_bag
from pacman_env.ros.bags.record import record
from tests.ros.bags.recorded import messages_of, refusal, words_bag

WORDS = {name: [f"{name} {k}" for k in range(20)] for name in ("GAME_STATE", "GAME_COMMAND", "GAME_STATUS")}


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The file of a bag of three chunks."""
    return words_bag(tmp_path_factory.mktemp("games") / "first", **WORDS) / "first.mcap"


def chunks_of(file: Path) -> list[tuple[int, int]]:
    """Where the compressed data of each chunk begins and ends."""
    with file.open("rb") as stream:
        records = StreamReader(stream, emit_chunks=True).records
        return [(stream.tell() - len(one.data), stream.tell()) for one in records if isinstance(one, Chunk)]


@pytest.mark.parametrize("more", [0, 40])
def test_cut_recording_keeps_its_whole_chunks(whole: Path, tmp_path: Path, more: int) -> None:
    for number, (_, end) in enumerate(chunks_of(whole), 1):
        (tmp_path / "cut.mcap").write_bytes(whole.read_bytes()[: end + more])
        assert messages_of(tmp_path / "cut.mcap") == messages_of(whole)[: 20 * number]
    assert len(messages_of(whole)) == 60


@settings(max_examples=20)
@given(st.floats(0, 1, exclude_max=True), st.booleans())
def test_recording_cut_anywhere_is_refused_in_one_line(whole: Path, share: float, zeros: bool) -> None:
    content, file = whole.read_bytes(), whole.parent.with_name("cut.mcap")
    length = int(share * len(content))
    file.write_bytes(content[:length] + bytes((len(content) - length) * zeros))  # as a file system may fill up
    assert "; mcap recover " in refusal(file, "not a readable bag")


def test_bag_of_running_recorder_is_refused_and_not_replaced(whole: Path, tmp_path: Path) -> None:
    out = tmp_path / "my game"
    file = out.with_name("my game.unfinished") / "my game" / "my game.mcap"
    file.parent.mkdir(parents=True)
    file.write_bytes(whole.read_bytes()[:-50])
    remedy = f"mkdir '{out}'; mcap recover '{file}' -o '{out / 'my game_0.mcap'}'; ros2 bag reindex '{out}'"
    for path in (out, file, file.parent, file.parent.parent):
        assert refusal(path, "not finished: Ctrl-C ends its recorder").endswith(f"if it was killed: {remedy}")
    with pytest.raises(FileExistsError, match=r"already exists; delete it, or .*; mcap recover "):
        record(out, "robot_15")


@settings(max_examples=50)
@given(st.floats(0, 1, exclude_max=True), st.integers(1, 64), st.integers(1, 255))
def test_damage_is_reported_with_its_chunk(whole: Path, share: float, size: int, bits: int) -> None:
    content, file = bytearray(whole.read_bytes()), whole.parent.with_name("damaged.mcap")
    begin = int(share * len(content))
    end = min(begin + size, len(content))
    content[begin:end] = bytes(byte ^ bits for byte in content[begin:end])
    file.write_bytes(content)
    inside = [number for number, (first, last) in enumerate(chunks_of(whole), 1) if first <= begin and end <= last]
    refusal(file, f"damaged chunks: {inside[0]}$" if inside else r"damaged\.mcap: ")


def test_recording_without_checksums_stays_unchecked(whole: Path, tmp_path: Path) -> None:
    writer = Writer(tmp_path / "game", version=9, storage_plugin=StoragePlugin.MCAP)
    with open_bag(words_bag(tmp_path / "game", writer, **WORDS)) as old, open_bag(whole) as new:
        assert (bool(old.unchecked), new.unchecked) == (True, "")
