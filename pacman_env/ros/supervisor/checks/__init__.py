"""Checks of ``pacman-env ros doctor`` and the operator's page, one function each."""

import textwrap
from collections.abc import Iterable, Sequence

from pacman_env.ros.text import plain

from . import domain, game, robot
from .check import BAD, UNKNOWN, Finding, Observations

#: Checks in the order in which faults should be remedied.
CHECKS = (*domain.CHECKS, *robot.CHECKS, *game.CHECKS)
_NO_ROBOT = "no other check is possible without a robot"
_LONGEST = 300  # most characters of a summary


def examine(observations: Observations) -> list[Finding]:
    findings = [check.find(observations) for check in CHECKS if observations.own or not check.needs_robot]
    if not observations.own:
        findings.append(Finding("robot", "Is there a robot?", UNKNOWN, _NO_ROBOT, "see above", settled=False))
    return [finding for finding in findings if finding is not None]


def is_ready(findings: Iterable[Finding]) -> bool:
    return all(finding.status != BAD for finding in findings)


def render(findings: Sequence[Finding], title: str, width: int = 80) -> str:
    """Format the findings as lines of at most ``width`` columns; commands stay whole."""
    indent = max(len(finding.check) for finding in findings) + 6
    space, lines = " " * indent, [title]
    for finding in findings:
        texts = {f"{finding.status:<4}{finding.check:<{indent - 4}}": finding.summary}
        if finding.remedy:
            texts[f"{space}-> "] = f"{finding.remedy}{':' if finding.command else ''}"
        for first, text in texts.items():
            words = f"{first}{plain(text, _LONGEST)}"
            lines += textwrap.wrap(words, width, subsequent_indent=space, break_on_hyphens=False)
        if command := plain(finding.command, _LONGEST):
            lines.append(" " * min(indent + 3, max(width - len(command), 4)) + command)
    bad = [finding.check for finding in findings if finding.status == BAD]
    summary = f"{len(bad)} of {len(findings)} BAD: {', '.join(bad)}" if bad else "nothing is BAD"
    return "\n".join([*lines, *textwrap.wrap(summary, width, break_on_hyphens=False)])
