"""Random messages on every topic end no node of a running game."""

import importlib
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from action_msgs.srv import CancelGoal
from std_srvs.srv import Trigger
from unique_identifier_msgs.msg import UUID

from pacman_env.ros import topics
from pacman_env.ros.message_conversion import markers_of, pose_message
from pacman_env.ros.simulated_robot.sim_robot import FAULT
from tests.map_parts import part_of_map
from tests.ros import session

NUMBERS = (math.nan, math.inf, -math.inf, -1.0, 0.0, 1e9)
WORDS = ("", "make me a sandwich", "9" * 10_000, "{}", "pellet_collected:", "pellet_collected:47110", "home_reached:0")
#: Whoever publishes these is a robot of its own, which a simulated robot refuses to drive, or the clock.
OF_ROBOTS = (topics.CLOCK, topics.CLOCK_OWNER, topics.ODOMETRY, topics.RELIABLE_ODOMETRY, topics.SCAN)
KNOWN = (*vars(topics).values(), *topics.GHOST_POSES, FAULT, topics.NAVIGATE_TO_POSE.statuses)
TOPICS = sorted(
    {one.name: one for one in KNOWN if isinstance(one, topics.Topic) and one not in OF_ROBOTS}.values(),
    key=lambda topic: topic.name,
)


def fill(message: Any, rng: np.random.Generator) -> Any:
    """Fill a message with random words, numbers that are out of range or not finite, and parts of these."""
    for name, kind in message.get_fields_and_field_types().items():
        before = getattr(message, name)
        if hasattr(before, "get_fields_and_field_types"):
            fill(before, rng)
        elif kind.startswith("sequence<") and "/" in kind:
            package, _, element = kind.removeprefix("sequence<").rstrip(">").partition("/")
            element_type = getattr(importlib.import_module(f"{package}.msg"), element.partition(",")[0])
            setattr(message, name, [fill(element_type(), rng) for _ in range(3)])
        elif isinstance(before, bool):
            setattr(message, name, bool(rng.integers(2)))
        elif isinstance(before, str):
            setattr(message, name, str(rng.choice(WORDS)))
        elif isinstance(before, float):
            setattr(message, name, float(rng.choice(NUMBERS)))
        elif isinstance(before, int) and kind.startswith(("int", "uint")):
            bits = int(kind.removeprefix("u").removeprefix("int")) - (not kind.startswith("u"))
            setattr(message, name, int(rng.choice([0, 2 ** min(bits, 62) - 1])))
    return message


def ask_and_leave(played: session.Session) -> None:
    """Call the services of the game and of Nav2, and be gone before they answer."""
    node = played.observer
    goals = topics.NAVIGATE_TO_POSE.goal_client(node)
    goal = topics.NAVIGATE_TO_POSE.type.Goal(pose=pose_message(math.nan, 0.0, 0.0, played.stamp()))
    for client, request in (
        (topics.START_GAME.client(node), Trigger.Request()),
        (topics.cancel_client(node, topics.NAVIGATE_TO_POSE.name), CancelGoal.Request()),  # all goals
        (goals, goals.srv_type.Request(goal_id=UUID(uuid=[7] * 16), goal=goal)),
    ):
        client.call_async(request)
        node.destroy_client(client)


@pytest.mark.filterwarnings("ignore:failed to send response")  # as every process of nodes does
def test_nodes_survive_random_messages_on_every_topic(domain: int, tmp_path: Path) -> None:
    rng, ground = np.random.default_rng(0), part_of_map("loop", 3.0).save(tmp_path / "ground.yaml")
    with session.game(tmp_path, ground, "nearest") as played:
        played.record(topics.GAME_STATE)
        names = set(played.nodes)
        assert played.call(topics.START_GAME).success
        played.wait_for(lambda: "running" in played.values(topics.GAME_STATE), 60.0)
        for _ in range(3):
            for topic in TOPICS:
                played.publish(topic, fill(topic.type(), rng))
            ask_and_leave(played)
            played.advance(1.0)
        for count in (0, 9_999, 10_000):
            pellets = {number: (0.001 * number, math.nan) for number in range(count)}
            played.publish(topics.PELLET_MARKERS, markers_of(pellets, played.stamp()))
        played.advance(1.0)
        assert played.call(topics.RESET_GAME).success
        played.wait_for(lambda: played.values(topics.GAME_STATE)[-1:] == ["menu"], 10.0)
        assert set(played.nodes) == names
        assert played.errors() == []
