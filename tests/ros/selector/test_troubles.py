"""The goal selector's troubles: each is in the list while it lasts, and not for the rest of a game."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from pacman_env.ros import topics
from pacman_env.ros.configured_node import ConfiguredNode
from pacman_env.ros.game_nodes import SELECTOR
from pacman_env.ros.message_conversion import markers_of, transform_message
from pacman_env.ros.selector.reasons import GHOST_LOST
from tests.ros.selector_game import FAR_AWAY, Game, pellet
from tests.ros.session import Session

LONGEST_S = 7.0  # simulated, from a trouble's end until it is no longer listed


def bad_transform(game: Game, topic: topics.Topic) -> None:
    broken = transform_message("odom", "base_link", (math.nan, 0.0, 0.0), game.session.stamp())
    game.say(topic, topic.type(transforms=[broken]))


def off_the_map(game: Game) -> None:
    game.stand(400.0, 400.0)
    game.session.advance(1.0)
    game.stand(*game.pose)


def other_pellets(game: Game) -> None:
    foreign = {99_999: pellet(0)}
    game.say(topics.PELLET_MARKERS, markers_of(foreign, game.session.stamp()))


#: What goes wrong and is over again, by the name of the trouble.
OVER: dict[str, Callable[[Game], None]] = {
    "bad clyde_pose": lambda game: game.clyde(math.nan, 0.0),
    "bad game_state": lambda game: game.say(topics.GAME_STATE, "jump"),
    "bad clyde/speed": lambda game: game.say(topics.CLYDE_SPEED, -1.0),
    "bad tf": lambda game: bad_transform(game, topics.TF),
    "bad tf_static": lambda game: bad_transform(game, topics.TF_STATIC),
    "off the map": off_the_map,
    "unknown pellets": other_pellets,
    "no Nav2": lambda game: game.end_nav2(),
}


def test_trouble_leaves_list_when_it_is_over(game: Game) -> None:
    game.start()
    game.begin()
    game.running_goal(1)
    for trouble, happen in OVER.items():
        assert trouble not in game.condition()["troubles"]
        happen(game)
        game.condition(lambda c, trouble=trouble: trouble in c["troubles"], trouble)
        game.pellets()
        game.clyde(*FAR_AWAY)
    game.start_nav2()
    game.session.advance(LONGEST_S)
    assert not OVER.keys() & game.condition()["troubles"].keys()


def test_missing_clyde_is_trouble_until_it_comes(game: Game) -> None:
    game.start()
    game.stand(*game.pose)
    game.pellets()
    game.say(topics.GAME_STATE, "running")
    game.say(topics.GAME_COMMAND, "enable")
    game.condition(lambda c: "no clyde" in c["troubles"], "no clyde")
    game.session.advance(3 * LONGEST_S)
    assert "no clyde" in game.condition()["troubles"], "it lasts"
    game.clyde(*FAR_AWAY)
    game.session.advance(LONGEST_S)
    assert game.condition()["troubles"].keys() == {"ghosts unheard"}


def test_robot_holds_until_lost_ghost_returns(game: Game) -> None:
    game.start()
    game.begin()
    first = game.running_goal(1)
    game.seen_at = None
    game.condition(lambda c: GHOST_LOST in c["troubles"], GHOST_LOST)
    assert first.cancelled
    game.session.advance(2 * LONGEST_S)
    assert len(game.nav2.goals) == 1
    game.clyde(*FAR_AWAY)
    game.running_goal(2)
    assert GHOST_LOST not in game.condition()["troubles"]
    game.seen_at = None
    game.condition(lambda c: GHOST_LOST in c["troubles"], GHOST_LOST)
    game.clyde(*game.pose[:2])
    game.status("death_detected")


class Peer(ConfiguredNode):
    """Another node of the game."""

    def __init__(self, **options: Any) -> None:
        super().__init__("peer", **options)


def test_other_configuration_is_trouble_until_node_agrees(game: Game) -> None:
    session: Session = game.session
    game.start()
    trouble = "configuration of peer"
    for _ in range(2):
        session.start("peer", Peer, settings=["clyde.speed_mps=0.4"])
        game.condition(lambda c: trouble in c["troubles"], trouble)
        session.advance(3 * LONGEST_S)
        assert trouble in game.condition()["troubles"], "it lasts"
        session.kill("peer")
        session.advance(LONGEST_S)
        assert trouble not in game.condition()["troubles"]
    assert session.node(SELECTOR).once.counts == {}
