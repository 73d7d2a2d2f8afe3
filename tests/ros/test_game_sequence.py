"""A complete and a lost round through all nodes but the planner and the base, whose parts the probe plays."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from geometry_msgs.msg import PoseWithCovarianceStamped
from std_msgs.msg import Header

from pacman_env.game.sounds import MELODIES
from pacman_env.ros import topics
from pacman_env.ros.messages import pellets_of, pose_of
from tests.ros.loudspeaker import Loudspeaker

if TYPE_CHECKING:
    from tests.ros.system import Probe, System

SHOW_S = 0.5  # of start and death; the recorded ones are longer


def unabridged(topic: topics.Topic) -> topics.Topic:
    """A latched topic of which every value is heard: two can follow at once, and its own depth keeps the latest."""
    return dataclasses.replace(topic, qos=topics.COMMANDS)


STATE, RESULT, SCORE, ROUND, SPAWNED, COLLECTED, SPEED = LATCHED = [
    unabridged(topic)
    for topic in (
        *(topics.GAME_STATE, topics.GAME_RESULT, topics.SCORE, topics.ROUND),
        *(topics.PELLETS_SPAWNED, topics.PELLETS_COLLECTED, topics.CLYDE_SPEED),
    )
]
HEARD = (
    *LATCHED,
    *(topics.GAME_COMMAND, topics.GAME_EVENT, topics.GAME_LIGHT, topics.GAME_SOUND),
    *(topics.PELLET_MARKERS, topics.CLYDE_POSE, topics.CMD_VEL, topics.LIGHT_RING),
)


class Robot:
    """Planner and base: drives nowhere, but reports what a test says it has done."""

    def __init__(self, probe: Probe, speaker: Loudspeaker) -> None:
        self.probe = probe
        self.speaker = speaker

    def status(self, word: str) -> None:
        self.probe.publish(topics.GAME_STATUS, word)

    def wait(self, what: str, topic: topics.Topic, value: object) -> None:
        self.probe.wait_for(lambda: self.probe.values(topic)[-1:] == [value], 30.0, what)

    def hear(self, topic: topics.Topic, values: list[object]) -> None:
        """All that a topic says until then, in order; topics do not wait for one another."""
        heard = self.probe.values
        self.probe.wait_for(lambda: len(heard(topic)) >= len(values), 30.0, f"{topic.name} to say {values}")
        assert heard(topic) == values

    def collect(self, pellet: int) -> None:
        """As the planner does it: the status, then the pellet is taken away."""
        before = [len(self.probe.values(topic)) for topic in (SCORE, COLLECTED)]
        self.status(f"pellet_collected:{pellet}")
        self.probe.publish(topics.REMOVE_PELLET, pellet)
        self.probe.wait_for(
            lambda: [len(self.probe.values(topic)) - 1 for topic in (SCORE, COLLECTED)] == before,
            what=f"the score of pellet {pellet}",
        )

    def play(self) -> dict[int, tuple[float, float]]:
        """From the menu into a running round; the pellets on the map."""
        assert self.probe.call(topics.START_GAME).success
        self.wait("the way home", STATE, "returning_home")
        self.wait("the pellets", SPAWNED, len(self.pellets()))
        self.status("home_reached")
        self.wait("the round", STATE, "running")
        return self.pellets()

    def turns(self) -> set[float]:
        return {message.twist.angular.z for message in self.probe.messages(topics.CMD_VEL)}

    def pellets(self) -> dict[int, tuple[float, float]]:
        return pellets_of(self.latest(topics.PELLET_MARKERS))

    def clyde(self) -> tuple[float, float]:
        return pose_of(self.latest(topics.CLYDE_POSE))[:2]

    def latest(self, topic: topics.Topic) -> Any:
        """What a topic last said, or will say next."""
        return self.probe.wait_for(lambda: self.probe.messages(topic)[-1:], what=topic.name)[0]


@pytest.fixture
def robot(probe: Probe, system: System) -> Iterator[Robot]:
    with Loudspeaker(probe.node, at_once=True) as speaker:
        probe.record(*HEARD)
        home = PoseWithCovarianceStamped(header=Header(frame_id="map"))
        home.pose.pose.orientation.w = 1.0
        probe.publisher(topics.AMCL_POSE).publish(home)
        for node in ("game_event_mapper", "game_light_node", "audio_node"):
            system.start(f"pacman_env.ros.{node}")
        system.start("pacman_env.ros.pellet_manager", map_yaml="loop", spacing_m=4.0)
        system.start("pacman_env.ros.clyde_ghost_node", map_yaml="loop", seed=1)
        system.start("pacman_env.ros.game_controller", start_show_s=SHOW_S, death_show_s=SHOW_S)
        probe.wait_for(lambda: STATE.name in dict(probe.all), 60.0, "the referee")
        probe.wait_for(lambda: probe.heard(topics.PELLET_MARKERS), 60.0, "the pellets")
        probe.wait_for(lambda: probe.heard(topics.CLYDE_POSE), 60.0, "Clyde")
        for topic in (topics.GAME_EVENT, topics.GAME_LIGHT, topics.GAME_SOUND, topics.GAME_STATUS, SPEED):
            name = f"{system.namespace}/{topic.name}"
            listeners = 2 if topic in HEARD else 1  # the node and the probe
            probe.wait_for(
                lambda name=name, n=listeners: probe.node.count_subscribers(name) >= n, 60.0, f"a listener on {name}"
            )
        probe.forget()
        yield Robot(probe, speaker)


def test_a_complete_round_comes_out_in_the_recorded_order(robot: Robot, probe: Probe) -> None:
    pellets = robot.play()
    assert len(pellets) >= 3
    robot.hear(topics.GAME_COMMAND, ["disable", "reset_round", "return_home", "enable"])
    robot.hear(STATE, ["menu", "returning_home", "starting", "running"])
    robot.hear(topics.GAME_EVENT, ["reset", "start theatrical"])
    probe.wait_for(lambda: robot.speaker.played == ["pacman_theme"], what="the theme")
    assert len(robot.speaker.goals[-1].note_sequence.notes) == len(MELODIES["pacman_theme"]) == 29
    probe.wait_for(lambda: robot.turns() == {0.0, 1.5}, what="the spin, after a stop")

    probe.forget()
    for pellet in pellets:
        robot.collect(pellet)
    robot.wait("the way home", STATE, "returning_home")
    robot.wait("the result", RESULT, f"Complete - Score: {len(pellets)}")
    robot.hear(SCORE, list(range(1, len(pellets) + 1)))
    robot.hear(COLLECTED, list(range(1, len(pellets) + 1)))
    robot.hear(topics.GAME_COMMAND, ["disable", "return_home"])
    robot.hear(STATE, ["complete", "returning_home"])
    for topic in (topics.GAME_EVENT, topics.GAME_LIGHT, topics.GAME_SOUND):
        robot.hear(topic, [*["pellet"] * len(pellets), "win"])
    probe.wait_for(lambda: robot.speaker.played[-1] == "win", what="the win melody")  # fault 2

    probe.forget()
    robot.status("home_reached")
    robot.wait("the menu", STATE, "menu")
    robot.wait("the next round", ROUND, 2)
    robot.wait("a faster Clyde", SPEED, pytest.approx(0.30))
    robot.wait("the score, kept", SCORE, len(pellets))
    robot.wait("the lights to go off", topics.GAME_LIGHT, "off")
    probe.wait_for(lambda: len(robot.pellets()) == len(pellets), what="the pellets to be back")
    robot.hear(topics.GAME_COMMAND, ["disable", "reset_round"])
    robot.hear(topics.GAME_EVENT, ["reset"])


def test_a_lost_round_comes_out_in_the_recorded_order(robot: Robot, probe: Probe) -> None:
    pellets = robot.play()
    robot.collect(next(iter(pellets)))
    robot.wait("the pellet's sound", topics.GAME_SOUND, "pellet")
    here = robot.clyde()
    probe.wait_for(lambda: robot.clyde() != here, what="Clyde to walk")

    probe.forget()
    probe.publish(topics.GAME_EVENT, "clyde killed", listeners=2)  # the planner names the ghost, then reports
    robot.status("death_detected")
    robot.wait("the death", topics.GAME_LIGHT, "clyde killed")
    robot.wait("the death's sound", topics.GAME_SOUND, "death")
    robot.wait("the way home", STATE, "returning_home")
    robot.wait("the result", RESULT, "Death - Score: 1")
    robot.hear(STATE, ["dying", "returning_home"])
    robot.hear(topics.GAME_COMMAND, ["disable", "return_home"])
    robot.hear(topics.GAME_EVENT, ["clyde killed"])
    probe.wait_for(lambda: {-1.5, 1.5} <= robot.turns(), what="the shake to both sides")

    probe.forget()
    robot.status("home_reached")
    robot.wait("the menu", STATE, "menu")
    robot.wait("the score at naught", SCORE, 0)
    robot.wait("the first round", ROUND, 1)
    robot.wait("the lights to go off", topics.GAME_LIGHT, "off")
    probe.wait_for(lambda: 0.0 in robot.turns(), what="the shake to be broken off")
    released = [False]
    probe.wait_for(
        lambda: [m.override_system for m in probe.messages(topics.LIGHT_RING)[-1:]] == released, what="the ring"
    )
    probe.wait_for(
        lambda: len(poses := probe.messages(topics.CLYDE_POSE)[-4:]) == 4 and len({pose_of(p) for p in poses}) == 1,
        what="Clyde to stand",
    )
