"""A lost round with another planner, which the probe plays, and with shows of the referee's that are shorter than the
robot's motions. What a whole game says is looked at in ``test_whole_game.py``.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from pacman_env.ros import topics
from pacman_env.ros.supervisor.game_nodes import module_of
from tests.ros.clock import SimulatedClock

if TYPE_CHECKING:
    from tests.ros.system import Probe, System

SHOW_S = 0.5  # of start and death; the motions are of 8 s and 5 s
NODES = ("game_event_mapper", "clyde_ghost_node", "pellet_manager", "game_controller")


def test_another_planner_plays_and_short_shows_break_the_motions_off(probe: Probe, system: System) -> None:
    def turning() -> list[float]:
        return [message.twist.angular.z for message in probe.messages(topics.CMD_VEL)]

    def wait(what: str, topic: topics.Topic, value: object) -> None:
        probe.wait_for(passing(lambda: probe.values(topic)[-1:] == [value]), what=what)

    def passing(condition: Callable[[], bool]) -> Callable[[], bool]:
        """Looks at a condition and lets time pass as long as it does not hold."""

        def holds() -> bool:
            if condition():
                return True
            clock.advance(0.05)
            return condition()

        return holds

    probe.record(topics.GAME_STATE, topics.SCORE, topics.GAME_RESULT, topics.PELLETS_SPAWNED, topics.CMD_VEL)
    for node in NODES[:3]:
        maps = {} if node == "game_event_mapper" else {"map_yaml": "loop"}
        system.start(module_of(node), use_sim_time=True, **maps)
    shows = [f"show.start_s={SHOW_S}", f"show.death_s={SHOW_S}"]
    system.start(module_of(NODES[3]), use_sim_time=True, settings=shows)
    clock = SimulatedClock(probe, *NODES)
    probe.wait_for(passing(lambda: bool(probe.values(topics.GAME_STATE))), what="the referee")
    probe.publisher(topics.GAME_EVENT)
    probe.wait_for(
        lambda: probe.node.count_subscribers(f"{system.namespace}/{topics.GAME_EVENT.name}") == 1, what="the mapper"
    )
    probe.wait_for(passing(lambda: probe.values(topics.PELLETS_SPAWNED)[-1:] != [0]), what="the pellets")

    assert probe.call(topics.START_GAME).success
    wait("the way home", topics.GAME_STATE, "returning_home")
    probe.publish(topics.GAME_STATUS, "home_reached")
    probe.wait_for(lambda: 1.5 in turning(), what="the spin")
    began_s = clock.now_s
    wait("the round", topics.GAME_STATE, "running")
    probe.wait_for(lambda: turning()[-1] == 0.0, what="the end of the spin")
    assert SHOW_S - 0.1 < clock.now_s - began_s < SHOW_S + 0.2

    probe.publish(topics.GAME_STATUS, "pellet_collected:0")
    wait("the pellet's score", topics.SCORE, 1)
    probe.forget()
    probe.publish(topics.GAME_EVENT, "clyde killed")  # the planner names the ghost, then reports
    probe.publish(topics.GAME_STATUS, "death_detected")
    probe.wait_for(passing(lambda: {-1.5, 1.5} <= set(turning())), what="the shake to both sides")
    wait("the way home", topics.GAME_STATE, "returning_home")
    wait("the result", topics.GAME_RESULT, "Death - Score: 1")
    probe.wait_for(lambda: turning()[-1] == 0.0, what="the end of the shake")  # and no time passes any more
    probe.publish(topics.GAME_STATUS, "home_reached")
    wait("the menu", topics.GAME_STATE, "menu")
    wait("the score at naught", topics.SCORE, 0)
