"""Checks of ``pacman-env ros doctor`` and the operator's page, one function each, without ROS."""

import textwrap
from collections.abc import Iterable, Sequence

from pacman_env.ros.text import plain

from . import domain, game, robot
from .check import BAD, UNKNOWN, Finding, Observations

#: Checks in the order in which faults should be remedied.
CHECKS = (*domain.CHECKS, *robot.CHECKS, *game.CHECKS)
_NO_ROBOT = Finding(
    *("robot", "Is there a robot?", UNKNOWN, "no other check is possible without a robot", "see above"), settled=False
)
_LONGEST = 300  # most characters of a summary


def examine(observations: Observations) -> list[Finding]:
    findings = [check.find(observations) for check in CHECKS if observations.own or not check.needs_robot]
    return [finding for finding in findings if finding is not None] + ([] if observations.own else [_NO_ROBOT])


def is_ready(findings: Iterable[Finding]) -> bool:
    return all(finding.status != BAD for finding in findings)


def render(findings: Sequence[Finding], title: str, width: int = 80) -> str:
    """Format the findings as lines of at most ``width`` columns; commands stay whole."""
    indent = max(len(finding.check) for finding in findings) + 6
    space, lines = " " * indent, [title]

    def wrap(text: str, first: str, rest: str) -> None:
        lines.extend(
            textwrap.wrap(*(text, width), initial_indent=first, subsequent_indent=rest, break_on_hyphens=False)
        )

    for finding in findings:
        wrap(plain(finding.summary, _LONGEST), f"{finding.status:<4}{finding.check:<{indent - 4}}", space)
        command = plain(finding.command, _LONGEST)
        if finding.remedy or command:
            colon = ":" if finding.remedy and command else ""
            wrap(f"-> {plain(finding.remedy, _LONGEST)}{colon}".rstrip(), space, f"{space}   ")
        if command:
            lines.append(" " * min(indent + 3, max(width - len(command), 4)) + command)
    bad = [finding.check for finding in findings if finding.status == BAD]
    wrap(f"{len(bad)} of {len(findings)} BAD: {', '.join(bad)}" if bad else "nothing is BAD", "", "")
    return "\n".join(lines)
