"""A lost round with another planner, which the test plays, and with shows of the referee's that are shorter than the
robot's motions. What a whole game publishes is looked at in ``test_whole_game.py``.
"""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from pacman_env.game.events import STAND_S
from pacman_env.ros import topics
from tests.ros import session

SHOW_S = 1.5  # of start and death; longer than a period of the pellet reports, without which no round begins
NODES = ("game_event_mapper", "clyde_ghost_node", "pellet_manager", "game_controller")


def test_another_planner_plays_and_short_shows_break_the_motions_off(domain: int, tmp_path: Path) -> None:
    with session.nodes(tmp_path) as game:

        def turning() -> list[float]:
            return [message.twist.angular.z for message in game.messages(topics.CMD_VEL)]

        game.record(topics.GAME_STATE, topics.SCORE, topics.GAME_RESULT, topics.PELLETS_SPAWNED, topics.CMD_VEL)
        for node in NODES[:3]:
            game.start(node, **({} if node == "game_event_mapper" else {"map_yaml": "loop"}))
        game.start(NODES[3], settings=[f"show.start_s={SHOW_S}", f"show.death_s={STAND_S + SHOW_S}"])
        game.wait_for(lambda: game.last(topics.PELLETS_SPAWNED).data > 0, 5.0, "the pellets")

        game.publish(topics.GAME_STATUS, "home_reached")  # the planner is there; in the menu its word has no effect
        assert game.call(topics.START_GAME).success
        assert game.values(topics.GAME_STATE)[-1] == "returning_home"
        game.publish(topics.GAME_STATUS, "home_reached")
        assert turning()[-1] == 1.5  # the spin begins at once
        began_s = game.now_s
        game.wait_for(lambda: game.values(topics.GAME_STATE)[-1] == "running", 5.0, "the round")
        assert game.now_s - began_s == pytest.approx(SHOW_S, abs=1e-6)
        game.wait_for(lambda: turning()[-1] == 0.0, 0.05, "the end of the spin")

        game.publish(topics.GAME_STATUS, "pellet_collected:0")
        assert game.values(topics.SCORE)[-1] == 1
        game.forget()
        game.publish(topics.GAME_EVENT, "clyde killed")  # the planner names the ghost, then reports
        game.publish(topics.GAME_STATUS, "death_detected")
        game.wait_for(lambda: {-1.5, 1.5} <= set(turning()), STAND_S + SHOW_S, "the shake to both sides")
        game.wait_for(lambda: "returning_home" in game.values(topics.GAME_STATE), SHOW_S, "the way home")
        assert game.values(topics.GAME_RESULT)[-1] == "Death - Score: 1"
        game.wait_for(lambda: turning()[-1] == 0.0, 0.05, "the end of the shake")
        game.publish(topics.GAME_STATUS, "home_reached")
        assert game.values(topics.GAME_STATE)[-1] == "menu"
        assert game.values(topics.SCORE)[-1] == 0
        assert game.errors() == []
