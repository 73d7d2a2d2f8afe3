"""Bags for tests: rounds of the nodes, recorded in lock-step, and words alone."""

import contextlib
import json
import struct
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from mcap.exceptions import McapError
from mcap.records import Message
from mcap.stream_reader import StreamReader
from rosbags.rosbag2 import Writer
from rosbags.typesys import Stores, get_typestore

from pacman_env.ros import topics
from pacman_env.ros.bags.bag import BagError, open_bag
from pacman_env.ros.bags.bag_replay import ReplayReport, replay_bag
from pacman_env.ros.bags.record import NAME, RECORDED, Recorder, new_bag
from tests.map_parts import part_of_map
from tests.ros import session

STORE = get_typestore(Stores.ROS2_JAZZY)
SHORT = ("show.start_s=1.0", "clyde.speed_mps=0.02")
OFTEN = ("execution.tick_s=0.1", "execution.check_period_s=0.1")  # many decisions in a short round


def record_round(folder: Path, policy: str, *settings: str) -> Path:
    """Play a round of three pellets and record it; return the bag, whose map is ``ground.yaml`` beside it."""
    ground = part_of_map("loop", 3.0).save(folder / "ground.yaml")
    with session.game(folder, ground, policy, seed=1, settings=(*SHORT, *OFTEN, *settings)) as game:
        game.start(NAME, partial(Recorder, new_bag(folder / "game")))
        game.record(topics.GAME_RESULT)
        assert game.call(topics.START_GAME).success
        game.wait_for(lambda: game.last(topics.GAME_RESULT).data, 600, "the end of the round")
        assert game.last(topics.GAME_RESULT).data == "Complete - Score: 3"
        game.stop(NAME)
    return folder / "game"


def replay(bag: Path, policy: str = "nearest") -> ReplayReport:
    return replay_bag(bag, str(bag.parent / "ground.yaml"), policy)


def refusal(path: Path, words: str) -> str:
    """Return the line with which a bag is refused when it is opened or read."""
    with pytest.raises(BagError, match=words) as caught, open_bag(path) as game:
        list(game.messages(RECORDED))
    assert "\n" not in str(caught.value)
    return str(caught.value)


def messages_of(file: Path) -> list[bytes]:
    """All messages up to where the file is cut off, as ``mcap recover`` keeps them."""
    messages = []
    with file.open("rb") as stream, contextlib.suppress(McapError, struct.error):
        for one in StreamReader(stream, validate_crcs=True).records:
            if isinstance(one, Message):
                messages.append(one.data)
    return messages


def words_bag(path: Path, writer: Writer | None = None, **words: list[str]) -> Path:
    """Write a bag of words on topics, by the names that ``topics`` has for them; ours has a chunk for each topic."""
    with writer or new_bag(path) as bag:
        for name, values in words.items():
            topic = getattr(topics, name)
            kind = topic.type_name.replace("/", "/msg/")
            connection = bag.add_connection(f"/robot_15/{topic.name}", kind, typestore=STORE)
            for value in values:
                data = STORE.serialize_cdr(STORE.types[kind](data=value), kind)
                bag.write(connection, sum(bag.counts.values()), data)
            if writer is None:
                bag.storage.flush()
    return path


def said(node: str, configuration: Any) -> str:
    """Return what a node says on ``game/configuration``."""
    return json.dumps({"node": node, "hash": "", "map": None, "configuration": configuration})
