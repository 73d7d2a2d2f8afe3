"""Requests of ``ros up`` to the referee: automatic rounds, and service calls that are repeated until answered."""

import time
from typing import Any

from pacman_env.ros.supervisor.checks.check import count
from pacman_env.ros.supervisor.status_line import ANSWER_S, StatusLine
from pacman_env.ros.supervisor.terminal import LineWriter
from pacman_env.ros.topics import RESET_GAME, START_GAME, Service

NEXT_ROUND_S = 2.0  # time in the menu between automatic rounds


class RoundRequests:
    """Requests for rounds and other services of the referee.

    ``starts``: start the next round automatically; ``play_on``: start every round; ``most``: number of rounds to play.
    """

    def __init__(
        self,
        status_line: StatusLine,
        writer: LineWriter,
        starts: bool = False,
        play_on: bool = False,
        most: int | None = None,
    ) -> None:
        self.status_line, self.writer = status_line, writer
        self.starts, self.play_on, self.most = starts, play_on, most
        self.wanted: list[Service] = []  # services to call once they are available
        self.answers: list[tuple[Service, Any, float]] = []  # service, future and time of the call
        self._menu_s: float | None = None  # wall time (s) when the game came into the menu
        self._played, self._running = 0, False

    def are_over(self, can_begin: bool) -> bool:
        """Request the next round if it is due and can begin; return True once all requested rounds were played."""
        self._running = self._running or self.status_line.state == "running"
        if not (self.starts and can_begin and self._in_menu()):
            return False
        self._played, self._running = self._played + self._running, False
        if self._played == self.most:
            self.writer.print(f"{count(self._played, 'round')} played: {self.status_line.game.result}")
            return True
        self.wanted.append(START_GAME)
        return False

    def _in_menu(self) -> bool:
        """Return True if the game is ready for a round, and after a round has been in the menu for ``NEXT_ROUND_S``."""
        if self.status_line.state != "menu" or not self.status_line.ready or self.wanted or self.answers:
            self._menu_s = None
            return False
        now = time.monotonic()
        self._menu_s = now if self._menu_s is None else self._menu_s
        return now - self._menu_s >= (NEXT_ROUND_S if self.status_line.game.result else 0.0)

    def call_services(self) -> None:
        """Call the wanted services and read their answers; repeat calls without an answer or refused too early."""
        for service in list(self.wanted):
            answer = self.status_line.call(service)
            if answer is not None:
                self.wanted.remove(service)
                self.answers.append((service, answer, time.monotonic()))
        for call in list(self.answers):
            service, answer, start_s = call
            if answer.done():
                self.answers.remove(call)
                self._read(service, answer.result())
            elif time.monotonic() - start_s > ANSWER_S:
                self.answers.remove(call)
                self.wanted.append(service)

    def _read(self, service: Service, result: Any) -> None:
        # A game that has just been restarted refuses a start until it knows the robot's pose.
        ready = self.status_line.state == "menu" and self.status_line.ready
        if result.success:
            self.starts = self.play_on or (self.starts and service is not START_GAME)
        elif service is START_GAME and self.starts:  # repeated, unless it has begun and its answer was lost
            self.starts = self.play_on or self.status_line.state == "menu"
        elif service is START_GAME and ready and RESET_GAME not in self.requested:  # a later reset has priority
            self.wanted.append(service)
        else:
            self.writer.print(f"{service.name}: {result.message}")

    @property
    def requested(self) -> list[Service]:
        """Services without an answer."""
        return [*self.wanted, *(service for service, *_ in self.answers)]
