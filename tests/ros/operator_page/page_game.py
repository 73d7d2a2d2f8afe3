"""A whole game in lock-step, on a clear map and with a Clyde that is no danger, and the page's node as one of them."""

from __future__ import annotations

import os
from collections.abc import Callable
from typing import Any, TypeVar

from pacman_env.ros.node import BaseNode
from pacman_env.ros.operator_page.ros_game import RosGame
from pacman_env.ros.supervisor.game_nodes import SELECTOR
from pacman_env.web import messages
from pacman_env.web.frame import Frame
from pacman_env.web.game import Refused
from tests.ros.session import NAMESPACE, Session

MAP, POLICY = "loop", "nearest"
HOME = 0.0, 0.0, 0.0
STILL_MPS, STILL_RADPS = 0.005, 0.02
SETTINGS = ("clyde.speed_mps=0.02", "show.start_s=1", "show.death_s=1")
EXTRA: dict[str, dict[str, Any]] = {SELECTOR: {"diagnostics_rate": 5.0}}
T = TypeVar("T")


class PageGame:
    """The game, and what the server would ask of it.

    Args:
        session: of a whole game.
    """

    page: RosGame

    def __init__(self, session: Session) -> None:
        self.session = session
        session.start("pacman_page", self._make)
        self.wait(lambda: self.ready, "the game")

    def _make(self) -> BaseNode:
        self.page = RosGame(NAMESPACE, int(os.environ["ROS_DOMAIN_ID"]), True, MAP)
        return self.page.node

    def start(self, name: str) -> None:
        """Start a node that was killed."""
        own: dict[str, Any] = {}
        if name == SELECTOR:
            own = {"map_yaml": MAP, "policy": POLICY, "home": list(HOME), **EXTRA[SELECTOR]}
        self.session.start(name, settings=list(SETTINGS), **own)

    def wait(self, condition: Callable[[], T], what: str, limit_s: float = 120.0) -> T:
        """Simulated s."""
        return self.session.wait_for(condition, limit_s, what)

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

    def handle(self, message: messages.Message, person: str = "guest-1") -> Any:
        """As the server does it."""
        return self.do(lambda: self.page.handle(person, message))

    def stop(self, person: str = "guest-1") -> None:
        """The operator's."""
        self.do(lambda: self.page.stop(person))

    def release(self) -> None:
        """Its end."""
        self.do(lambda: self.page.release("guest-1"))

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

    @property
    def frame(self) -> Frame:
        """The last."""
        frame = self.page.frame()
        assert frame is not None
        return frame

    def words(self, after: int = 0) -> list[str]:
        """Of the news."""
        return [one["words"] for one in self.page.news(after) if "words" in one]

    def news_number(self) -> int:
        """Of the last."""
        return max((one["number"] for one in self.page.news(0)), default=0)

    def menu(self) -> None:
        """Nothing goes on."""
        self.release()
        self.do(lambda: self.page.leave("guest-1"))
        self.handle(messages.Reset())
        self.wait(lambda: self.frame.state == "menu" and not self.frame.stopped, "the menu")
        self.wait(lambda: self.stands, "the robot to stand")

    def round(self) -> None:
        """A round in which the robot drives."""
        if self.frame.state != "running":
            self.menu()
            self.handle(messages.Start())
        self.wait(lambda: self.frame.state == "running", "the round")
        self.wait(lambda: self.drives, "the robot to drive")

    @property
    def drives(self) -> bool:
        """By the frame."""
        return abs(self.frame.velocity[0]) > 0.1

    @property
    def stands(self) -> bool:
        """By the frame."""
        v, omega = self.frame.velocity
        return abs(v) < STILL_MPS and abs(omega) < STILL_RADPS
