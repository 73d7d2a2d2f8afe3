"""The person at the terminal of ``ros up``: pressed keys, and troubles that need a person."""

from collections.abc import Callable

from pacman_env.ros.process import StopSignals
from pacman_env.ros.selector.reasons import POLICY_FAILS, POSE_JUMPED, REMEDIES, troubles_of
from pacman_env.ros.supervisor.rounds import RoundRequests
from pacman_env.ros.supervisor.status_line import StatusLine
from pacman_env.ros.supervisor.terminal import LineWriter
from pacman_env.ros.topics import CONTINUE, RESET_GAME, START_GAME

#: Troubles that do not fit in the status line, with remedies; texts of other troubles change every second.
REPORTED = {
    POSE_JUMPED: "set the robot's pose, or c to continue as it is",
    POLICY_FAILS: REMEDIES[POLICY_FAILS],
}
KEYS = {"s": START_GAME, "r": RESET_GAME, "c": CONTINUE}


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
                operator.request(False, "ros up")
                self._writer.print("released")
        if self._stops_until_reset and RESET_GAME not in self._rounds.requested:
            self._stops_until_reset = False
            operator.request(False, "ros up")

    def _stop_robot(self) -> None:
        self._status_line.operator.request(True, "ros up")
        self._status_line.halt()

    def report_troubles(self) -> None:
        """Print each trouble that needs a person once, with the text that page and doctor show."""
        troubles = troubles_of(self._status_line.condition)
        previous, self._reported = self._reported, {kind: troubles[kind] for kind in REPORTED if kind in troubles}
        for kind, words in self._reported.items():
            if words != previous.get(kind):
                self._writer.print(f"{words}: {REPORTED[kind]}")
