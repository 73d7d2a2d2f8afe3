"""What the referee reports of nodes that are there and do not do what they are asked to."""

import json
import re
from collections.abc import Callable
from typing import Any

import pytest

from pacman_env.game.pending_requests import AGAIN_S, CALLS
from pacman_env.ros import topics
from pacman_env.ros.game_nodes import REFEREE
from pacman_env.ros.message_conversion import markers_of
from tests.ros.session import Session

LIMIT_S = 20.0  # simulated
PELLETS, CLYDE = "pellet_manager", "clyde_ghost_node"


@pytest.fixture
def referee(nodes: Session) -> Session:
    nodes.record(topics.GAME_STATE, topics.UNRESPONSIVE, topics.REMOVE_PELLET, topics.PELLETS_SPAWNED)
    topics.GAME_STATUS.publisher(nodes.observer)  # as a goal selector has it
    nodes.start(REFEREE, state_file="", settings=["show.start_s=0.2"])
    return nodes


def reported(nodes: Session) -> dict[str, Any]:
    message = nodes.latest(topics.UNRESPONSIVE)
    return {} if message is None else dict(json.loads(message.data))


def show(nodes: Session, *pellets: int) -> None:
    nodes.publish(topics.PELLET_MARKERS, markers_of({i: (float(i), 0.0) for i in pellets}, nodes.stamp()))


def begin(nodes: Session) -> None:
    assert nodes.call(topics.START_GAME).success
    nodes.publish(topics.GAME_STATUS, "home_reached")


def test_new_referee_reports_no_unresponsive_node(referee: Session) -> None:
    """So that nobody keeps what a referee before it has reported, and the doctor has an answer."""
    referee.wait_for(lambda: referee.values(topics.GAME_STATE), LIMIT_S, "the state")
    assert [json.loads(text) for text in referee.values(topics.UNRESPONSIVE)] == [{}]


def test_frozen_pellet_manager_is_reported_until_it_answers(referee: Session, log: Callable[[], str]) -> None:
    manager = referee.start(PELLETS, map_yaml="house")
    referee.freeze(manager)
    begin(referee)
    referee.advance(CALLS * AGAIN_S - 0.2)
    assert reported(referee) == {}
    referee.wait_for(lambda: reported(referee), LIMIT_S, "the report")
    assert re.fullmatch(r"reset_pellets: no answer to [34] calls", reported(referee)[PELLETS])
    assert reported(referee)[CLYDE] == "reset_clyde: no server"
    assert referee.values(topics.GAME_STATE)[-1] == "starting"
    assert referee.values(topics.PELLETS_SPAWNED)[-1] == 0
    referee.thaw(manager)
    referee.wait_for(lambda: referee.values(topics.GAME_STATE)[-1] == "running", LIMIT_S, "the round")
    referee.wait_for(lambda: PELLETS not in reported(referee), LIMIT_S, "the end of the report")
    assert referee.values(topics.PELLETS_SPAWNED)[-1] == 13
    assert log().count(f"{PELLETS} does not respond: reset_pellets: no answer to") == 1


@pytest.mark.parametrize(("reports", "words"), [(0, "no pellet_markers"), (1, "it shows no pellet")])
def test_round_without_pellets_is_reported_and_waits(referee: Session, reports: int, words: str) -> None:
    referee.serve(topics.RESET_PELLETS, topics.RESET_CLYDE)
    begin(referee)
    for _ in range(reports):
        show(referee)
    referee.wait_for(lambda: reported(referee), LIMIT_S, "the report")
    assert reported(referee) == {PELLETS: f"{words}, so no round begins"}
    assert referee.values(topics.GAME_STATE)[-1] == "starting"
    show(referee, 4)
    referee.wait_for(lambda: referee.values(topics.GAME_STATE)[-1] == "running", LIMIT_S, "the round")
    referee.advance(0.1)
    assert reported(referee) == {}
