"""What ``pacman-env ros doctor`` and the operator's page check of a robot before it plays; imports nothing of ROS.

One class a check, in a file for each topic; ``doctor.py`` observes what they need.
"""

from __future__ import annotations

from collections.abc import Iterable

from pacman_env.ros.supervisor.checks import base, clocks, game, localization, nav2, network
from pacman_env.ros.supervisor.checks.check import BAD, UNKNOWN, Check, Finding, Observations

#: In the order in which what is wrong is to be remedied.
CHECKS: tuple[Check, ...] = (
    *(*network.CHECKS, *clocks.CHECKS, *base.CHECKS),
    *(*localization.CHECKS, *nav2.CHECKS, *game.CHECKS),
)
_NO_ROBOT = Finding(
    *("robot", "Is there a robot?", UNKNOWN, "nothing else can be examined without one", "see above"), settled=False
)


def examine(robot: Observations) -> list[Finding]:
    """The findings of all checks, in their order."""
    asked = [check.answer(robot) for check in CHECKS if robot.own or not check.needs_robot]
    return [finding for finding in asked if finding is not None] + ([] if robot.own else [_NO_ROBOT])


def is_ready(findings: Iterable[Finding]) -> bool:
    """Whether nothing is BAD."""
    return all(finding.status != BAD for finding in findings)
