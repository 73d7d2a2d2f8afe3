"""Count goals in a row that Nav2 does not reach, describe Nav2's error codes, and delay the next goal."""

from typing import Any

from pacman_env.game.execution import ABORTED, REJECTED, SUCCEEDED
from pacman_env.ros.selector.reasons import NAV2_FAILS

MANY = 3  # this many failures in a row are reported
_QUICK_S = 2.0  # a goal that fails sooner was not tried: Nav2 needs 11 s if there is no path, 150 s if stuck
_SHORTEST_S, _LONGEST_S = 1.0, 5.0  # between two goals while all goals fail quickly
_SERVERS = {  # Nav2 Jazzy (1.3.13): first error code and names as in nav2_msgs/action; the navigator forwards the code
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
    """Describe an error code, such as ``208 ComputePathToPose NO_VALID_PATH``; an unknown one by its number."""
    return "no error code" if code == 0 else f"{code} {_NAMES.get(code, '')}".rstrip()


class Nav2Failures:
    """Count of goals in a row that were aborted or rejected.

    If all goals fail immediately, because of a lost transform or an inactive planner, the next goal is delayed: by 1 s
    after the third failure in a row, by twice as long after each further failure, and by 5 s at most.
    """

    def __init__(self, once: Any) -> None:
        self._once = once  # receives the trouble
        self.aborted = self.rejected = 0  # in all
        self.in_a_row = 0
        self._quick = 0  # failures in a row within ``_QUICK_S`` of the start
        self._collected = 0
        self._what, self._code = ABORTED, 0
        self._wait_until_s = 0.0

    def ended(self, status: int, code: int, lasted_s: float, now: float) -> None:
        """Count the end of the current goal at the time ``now``, s, after ``lasted_s``.

        ``status`` is from action_msgs/GoalStatus or REJECTED, ``code`` is Nav2's error code.
        """
        if status == SUCCEEDED:
            self.reset()
        if status not in (ABORTED, REJECTED):
            return
        self.aborted += status == ABORTED
        self.rejected += status == REJECTED
        self.in_a_row += 1
        self._what, self._code = status, code
        self._quick = self._quick + 1 if lasted_s < _QUICK_S else 0
        if self._quick >= MANY:
            self._wait_until_s = now + min(_SHORTEST_S * 2.0 ** min(self._quick - MANY, 10), _LONGEST_S)
        if self.words:
            self._once.begin(NAV2_FAILS, self.words)

    def progress(self, collected: int) -> None:
        """Restart the count if more pellets are ``collected`` than before."""
        if collected > self._collected:
            self.reset()
        self._collected = collected

    def reset(self) -> None:
        """Restart the count, after progress of the robot or at the start of a round."""
        self.in_a_row = self._quick = 0
        self._wait_until_s = 0.0
        self._once.over(NAV2_FAILS)

    def waiting(self, now: float) -> bool:
        return now < self._wait_until_s

    @property
    def words(self) -> str:
        """Describe the goals that Nav2 rejected or aborted in a row; return "" if there are too few to report."""
        if self.in_a_row < MANY:
            return ""
        if self._what == REJECTED:
            return f"Nav2 rejected {self.in_a_row} goals in a row"
        return f"Nav2 aborted {self.in_a_row} goals in a row ({error_words(self._code)})"
