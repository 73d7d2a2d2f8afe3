"""Bags for tests: rounds of the nodes, recorded in lock-step, and words alone."""

import json
from pathlib import Path
from typing import Any

import pytest
from rosbags.rosbag2 import Reader
from rosbags.typesys import Stores, get_typestore

from pacman_env.ros import topics
from pacman_env.ros.bags.bag import BagError, new_bag, open_bag
from pacman_env.ros.bags.bag_replay import ReplayReport, replay_bag
from pacman_env.ros.bags.record import NAME, RECORDED, Recorder
from tests.map_parts import part_of_map
from tests.ros import session

STORE = get_typestore(Stores.ROS2_JAZZY)
OFTEN = ("execution.tick_s=0.1", "execution.check_period_s=0.1")  # many decisions in a short round


def record_round(folder: Path, policy: str, *settings: str, breaks_off: bool = False) -> Path:
    """Play a round of three pellets, or of one before a reset, and record it.

    Returns the bag, whose map is ``ground.yaml`` beside it.
    """
    ground = part_of_map("loop", 3.0).save(folder / "ground.yaml")
    settings = ("show.start_s=1.0", "clyde.speed_mps=0.02", *OFTEN, *settings)
    with session.game(folder, ground, policy, seed=1, settings=settings) as game:
        recorder = game.start(NAME, lambda: Recorder(folder / "game", sim_time=True))
        game.record(topics.SCORE, topics.GAME_RESULT)
        assert game.call(topics.START_GAME).success
        if breaks_off:
            game.wait_for(lambda: game.last(topics.SCORE).data, 600, "a pellet")
            game.advance(2.0)
            assert game.call(topics.RESET_GAME).success
        else:
            game.wait_for(lambda: game.last(topics.GAME_RESULT).data, 600, "the end of the round")
            score = 7 if "power.pellets=1" in settings else 3
            assert game.last(topics.GAME_RESULT).data == f"Complete - Score: {score}"
        game.game.remove(recorder)
    return folder / "game"


def replay(bag: Path, policy: str = "nearest") -> ReplayReport:
    return replay_bag(bag, str(bag.parent / "ground.yaml"), policy)


def refusal(path: Path, words: str, *read: topics.Topic) -> str:
    """Return the line with which a bag is refused when it is opened, or when topics are read."""
    with pytest.raises(BagError, match=words) as caught, open_bag(path) as game:
        list(game.messages(read or RECORDED))
    assert "\n" not in str(caught.value)
    return str(caught.value)


def words_bag(path: Path, **words: list[str]) -> Path:
    """Write a bag of words on topics, by the names that ``topics`` has for them."""
    with new_bag(path) as writer:
        for name, values in words.items():
            topic = getattr(topics, name)
            kind = topic.type_name.replace("/", "/msg/")
            connection = writer.add_connection(f"/robot_15/{topic.name}", kind, typestore=STORE)
            for at_ns, value in enumerate(values):
                writer.write(connection, at_ns, STORE.serialize_cdr(STORE.types[kind](data=value), kind))
    return path


def said(node: str, configuration: Any) -> str:
    """Return what a node says on ``game/configuration``."""
    return json.dumps({"node": node, "hash": "", "map": None, "configuration": configuration})


def without(bag: Path, copy: Path, *left_out: topics.Topic) -> Path:
    """Copy a bag but for some topics."""
    names = {f"/robot_15/{topic.name}" for topic in left_out}
    with Reader(bag) as reader, new_bag(copy) as writer:
        kept = {one.id: one for one in reader.connections if one.topic not in names}
        new = {key: writer.add_connection(one.topic, one.msgtype, typestore=STORE) for key, one in kept.items()}
        for connection, at_ns, raw in reader.messages(kept.values()):
            writer.write(new[connection.id], at_ns, raw)
    return copy
