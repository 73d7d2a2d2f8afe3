"""A whole game in lock-step, on a clear map and with a Clyde that is no danger, and the page's node as one of them."""

import os
from collections.abc import Callable
from typing import Any, TypeVar

from pacman_env.ros.game_nodes import SELECTOR
from pacman_env.ros.node import BaseNode
from pacman_env.ros.operator_page.ros_game import RosGame
from pacman_env.web.game_interface import Refused
from tests.ros.session import NAMESPACE, Session
from tests.web.game_contract import Play

MAP, POLICY = "loop", "nearest"
HOME = 0.0, 0.0, 0.0
SETTINGS = ("clyde.speed_mps=0.02", "show.start_s=1", "show.death_s=1")
EXTRA: dict[str, dict[str, Any]] = {SELECTOR: {"diagnostics_rate": 5.0}}
T = TypeVar("T")


def start_page(session: Session, map: str = MAP) -> RosGame:
    """Start the page's node in a session; the caller closes it."""
    pages: list[RosGame] = []

    def make() -> BaseNode:
        pages.append(RosGame(NAMESPACE, int(os.environ["ROS_DOMAIN_ID"]), True, map))
        return pages[0].node

    session.start("pacman_page", make)
    return pages[0]


class PageGame(Play):
    """The page over a session of a whole game."""

    page: RosGame

    def __init__(self, session: Session) -> None:
        self.session = session
        self.page = start_page(session)
        self.wait(lambda: self.ready, "the game")

    def wait(self, condition: Callable[[], Any], what: str) -> Any:
        return self.session.wait_for(condition, what=what)

    def do(self, call: Callable[[], T]) -> T:
        """Have the page do something between two steps of the game, and time go on while it waits for an answer.

        Raises:
            Refused: as the page does.
        """
        outcome: list[T] = []
        refused: list[Refused] = []

        def attempt() -> None:
            try:
                outcome.append(call())
            except Refused as error:
                refused.append(error)

        self.session.game.within(self.page.node, attempt)
        if refused:
            raise refused[0]
        return outcome[0]

    @property
    def ready(self) -> bool:
        frame, facts = self.page.frame(), self.page.scene().facts
        there = frame is not None and frame.believed is not None and len(frame.ghosts) == 1 and frame.alive.any()
        return bool(there and facts["candidates"] and facts["policy"] == POLICY and self.obeyed)

    @property
    def obeyed(self) -> bool:
        """Whether all nodes that move the robot obey the page's stop."""
        return all(
            name in self.page._driving.stop_row()["words"]
            for name in (SELECTOR, "game_event_mapper", "game_controller")
        )
