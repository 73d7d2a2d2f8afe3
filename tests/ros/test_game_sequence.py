"""A lost round with another planner, which the probe plays, on the wall's clock, and with shows of the referee's that
are shorter than the robot's motions. What a whole game says is looked at in ``test_whole_game.py``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from pacman_env.ros import topics
from pacman_env.ros.supervisor.game_nodes import module_of

if TYPE_CHECKING:
    from tests.ros.system import Probe, System

SHOW_S = 0.5  # of start and death; the motions are of 8 s and 5 s
UP_S = 60.0


def test_another_planner_plays_and_short_shows_break_the_motions_off(probe: Probe, system: System) -> None:
    def turning() -> list[float]:
        return [message.twist.angular.z for message in probe.messages(topics.CMD_VEL)]

    def wait(what: str, topic: topics.Topic, value: object) -> None:
        probe.wait_for(lambda: probe.values(topic)[-1:] == [value], 30.0, what)

    probe.record(topics.GAME_STATE, topics.SCORE, topics.GAME_RESULT, topics.PELLETS_SPAWNED, topics.CMD_VEL)
    for node in ("game_event_mapper", "clyde_ghost_node", "pellet_manager"):
        maps = {} if node == "game_event_mapper" else {"map_yaml": "loop"}
        system.start(module_of(node), **maps)
    system.start("pacman_env.ros.nodes.game_controller", settings=[f"show.start_s={SHOW_S}", f"show.death_s={SHOW_S}"])
    probe.wait_for(lambda: probe.values(topics.GAME_STATE), UP_S, "the referee")
    probe.publisher(topics.GAME_EVENT)
    probe.wait_for(
        lambda: probe.node.count_subscribers(f"{system.namespace}/{topics.GAME_EVENT.name}") == 1, UP_S, "the mapper"
    )
    probe.wait_for(lambda: probe.values(topics.PELLETS_SPAWNED)[-1:] != [0], UP_S, "the pellets")

    assert probe.call(topics.START_GAME).success
    wait("the way home", topics.GAME_STATE, "returning_home")
    probe.publish(topics.GAME_STATUS, "home_reached")
    probe.wait_for(lambda: 1.5 in turning(), what="the spin")
    wait("the round", topics.GAME_STATE, "running")
    probe.wait_for(lambda: turning()[-1] == 0.0, 4.0, "the end of the spin")

    probe.publish(topics.GAME_STATUS, "pellet_collected:0")
    wait("the pellet's score", topics.SCORE, 1)
    probe.forget()
    probe.publish(topics.GAME_EVENT, "clyde killed")  # the planner names the ghost, then reports
    probe.publish(topics.GAME_STATUS, "death_detected")
    probe.wait_for(lambda: {-1.5, 1.5} <= set(turning()), what="the shake to both sides")
    wait("the way home", topics.GAME_STATE, "returning_home")
    wait("the result", topics.GAME_RESULT, "Death - Score: 1")
    probe.wait_for(lambda: turning()[-1] == 0.0, 3.0, "the end of the shake")
    probe.publish(topics.GAME_STATUS, "home_reached")
    wait("the menu", topics.GAME_STATE, "menu")
    wait("the score at naught", topics.SCORE, 0)
