"""Goals that Nav2 ends without success one after the other: their number, its error codes, and when to send again."""

from pacman_env.game.execution import ABORTED, REJECTED, SUCCEEDED

MANY = 3  # failures in a row that are reported
_QUICK_S = 2.0  # a goal that fails sooner after it was sent was not tried; without a path Nav2 needs 11 s, stuck 150 s
_SHORTEST_S, _LONGEST_S = 1.0, 5.0  # between two goals while all of them fail quickly
_SERVERS = {  # of Nav2 Jazzy (1.3.13) by their first code, as in nav2_msgs/action; the navigator hands the code on
    "FollowPath": (
        100,
        (
            "UNKNOWN INVALID_CONTROLLER TF_ERROR INVALID_PATH PATIENCE_EXCEEDED FAILED_TO_MAKE_PROGRESS "
            "NO_VALID_CONTROL CONTROLLER_TIMED_OUT"
        ),
    ),
    "ComputePathToPose": (
        200,
        (
            "UNKNOWN INVALID_PLANNER TF_ERROR START_OUTSIDE_MAP GOAL_OUTSIDE_MAP START_OCCUPIED GOAL_OCCUPIED TIMEOUT "
            "NO_VALID_PATH"
        ),
    ),
    "SmoothPath": (
        500,
        "UNKNOWN INVALID_SMOOTHER TIMEOUT SMOOTHED_PATH_IN_COLLISION FAILED_TO_SMOOTH_PATH INVALID_PATH",
    ),
    "Spin": (700, "UNKNOWN TIMEOUT TF_ERROR COLLISION_AHEAD"),
    "BackUp": (710, "UNKNOWN TIMEOUT TF_ERROR INVALID_INPUT COLLISION_AHEAD"),
    "DriveOnHeading": (720, "UNKNOWN TIMEOUT TF_ERROR COLLISION_AHEAD INVALID_INPUT"),
    "NavigateToPose": (9000, "UNKNOWN FAILED_TO_LOAD_BEHAVIOR_TREE TF_ERROR TIMEOUT"),  # since Kilted
}
_NAMES = {
    first + k: f"{server} {name}" for server, (first, names) in _SERVERS.items() for k, name in enumerate(names.split())
}


def error_words(code: int) -> str:
    """``208 ComputePathToPose NO_VALID_PATH``; the number alone if it is unknown, words for 0."""
    return "no error code" if code == 0 else f"{code} {_NAMES.get(code, '')}".rstrip()


class Nav2Failures:
    """Counts goals that were aborted or rejected one after the other.

    While all of them fail at once, which a lost transform or a planner that is not active causes, the next goal waits:
    1 s after the third, twice as long after each further one, 5 s at most.
    """

    def __init__(self) -> None:
        self.in_a_row = 0
        self._quick = 0  # of them, the last ones that failed at once
        self._what, self._code = ABORTED, 0
        self._wait_until_s = 0.0

    def ended(self, status: int, code: int, lasted_s: float, now: float) -> None:
        """The goal that was pursued has ended with a status of action_msgs/GoalStatus, or REJECTED, and Nav2's code."""
        if status == SUCCEEDED:
            self.forget()
        if status not in (ABORTED, REJECTED):
            return
        self.in_a_row += 1
        self._what, self._code = status, code
        self._quick = self._quick + 1 if lasted_s < _QUICK_S else 0
        if self._quick >= MANY:
            self._wait_until_s = now + min(_SHORTEST_S * 2.0 ** min(self._quick - MANY, 10), _LONGEST_S)

    def forget(self) -> None:
        """The robot has got somewhere, or another round begins."""
        self.in_a_row = self._quick = 0
        self._wait_until_s = 0.0

    def waiting(self, now: float) -> bool:
        return now < self._wait_until_s

    @property
    def words(self) -> str:
        """What is to be reported; empty if nothing."""
        if self.in_a_row < MANY:
            return ""
        if self._what == REJECTED:
            return f"Nav2 rejected {self.in_a_row} goals in a row"
        return f"Nav2 aborted {self.in_a_row} goals in a row ({error_words(self._code)})"
