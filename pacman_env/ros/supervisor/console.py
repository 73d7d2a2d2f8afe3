"""The person at the terminal of ``ros up``: pressed keys, troubles that need a person, and requests to the referee."""

import time
from collections.abc import Callable
from typing import Any

from pacman_env.ros.game_nodes import OURS
from pacman_env.ros.process import StopSignals
from pacman_env.ros.selector.reasons import POLICY_FAILS, POSE_JUMPED, REMEDIES, troubles_of
from pacman_env.ros.supervisor.checks.check import count
from pacman_env.ros.supervisor.status_line import ANSWER_S, StatusLine
from pacman_env.ros.supervisor.terminal import LineWriter
from pacman_env.ros.topics import CONTINUE, RESET_GAME, START_GAME, Service

NEXT_ROUND_S = 2.0  # time in the menu between automatic rounds
#: Troubles that do not fit in the status line, with remedies; texts of other troubles change every second.
REPORTED = {
    POSE_JUMPED: "set the robot's pose, or c to continue as it is",
    POLICY_FAILS: REMEDIES[POLICY_FAILS],
}
WHO = "ros up"  # who stops and releases the robot with these keys
KEYS = {"s": START_GAME, "r": RESET_GAME, "c": CONTINUE}


class RoundRequests:
    """Automatic rounds, and calls of the referee's services, which are repeated until they are answered.

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
        # A game that has just been restarted refuses a start until it knows the robot's pose. A foreign goal selector
        # may be absent for long: the robot must not move when it comes.
        ours = self.status_line.game.condition.get("selector", OURS) == OURS
        ready = ours and self.status_line.state == "menu" and self.status_line.ready
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


class Console:
    """Terminal of a game; ``pressed`` returns the keys since its last call (None if keys cannot be read)."""

    def __init__(
        self,
        status_line: StatusLine,
        rounds: RoundRequests,
        writer: LineWriter,
        stop: StopSignals,
        pressed: Callable[[], str] | None,
    ) -> None:
        self._status_line, self._rounds, self._writer, self._stop = status_line, rounds, writer, stop
        self._pressed = pressed
        self._stops_until_reset = False
        self._reported: dict[str, str] = {}  # troubles, by kind

    def print_keys(self) -> None:
        if self._pressed:
            self._writer.print("keys: s start, r reset, c continue, space stop, g release, q quit")

    def handle_keys(self) -> None:
        """Execute the keys pressed since the last call."""
        operator = self._status_line.operator
        for key in self._pressed() if self._pressed else "":
            if key == "q":
                self._stop.asked = True
            elif key in KEYS:
                self._rounds.wanted.append(KEYS[key])
                if key == "r" and not operator.stopped:  # the referee or the goal selector may be frozen
                    self._stops_until_reset = True
                    self._stop_robot()
            elif key == " ":
                self._stops_until_reset = False
                self._stop_robot()
                self._writer.print("stopped: the robot stands until g")
            elif key == "g" and operator.stopped:
                self._stops_until_reset = False
                operator.request(False, WHO)
                self._writer.print("released")
        if self._stops_until_reset and RESET_GAME not in self._rounds.requested:
            self._stops_until_reset = False
            if operator.who == WHO:  # otherwise another person has stopped the robot in the meantime
                operator.request(False, WHO)

    def _stop_robot(self) -> None:
        self._status_line.operator.request(True, WHO)
        self._status_line.halt()

    def report_troubles(self) -> None:
        """Print each trouble that needs a person once, with the text that page and doctor show."""
        troubles = troubles_of(self._status_line.game.condition)
        previous, self._reported = self._reported, {kind: troubles[kind] for kind in REPORTED if kind in troubles}
        for kind, words in self._reported.items():
            if words != previous.get(kind):
                self._writer.print(f"{words}: {REPORTED[kind]}")
