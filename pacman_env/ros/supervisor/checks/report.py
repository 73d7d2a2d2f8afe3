"""Findings as lines for a terminal."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

from pacman_env.ros.supervisor.checks.check import BAD, Finding

_LONGEST = 300  # characters of a summary


def render(findings: Sequence[Finding], title: str, width: int = 80) -> str:
    """The list as lines of at most ``width`` columns, but for commands, which stay whole."""
    indent = max(len(finding.check) for finding in findings) + 6
    space, lines = " " * indent, [title]

    def wrap(text: str, first: str, rest: str) -> None:
        lines.extend(
            textwrap.wrap(*(text, width), initial_indent=first, subsequent_indent=rest, break_on_hyphens=False)
        )

    for finding in findings:
        wrap(_plain(finding.summary), f"{finding.status:<4}{finding.check:<{indent - 4}}", space)
        command = _plain(finding.command)
        if finding.remedy or command:
            colon = ":" if finding.remedy and command else ""
            wrap(f"-> {_plain(finding.remedy)}{colon}".rstrip(), space, f"{space}   ")
        if command:
            lines.append(" " * min(indent + 3, max(width - len(command), 4)) + command)
    bad = [finding.check for finding in findings if finding.status == BAD]
    wrap(f"{len(bad)} of {len(findings)} BAD: {', '.join(bad)}" if bad else "nothing is BAD", "", "")
    return "\n".join(lines)


def _plain(text: str) -> str:
    """On one line and without control characters: names and words come from other machines."""
    words = " ".join("".join(c if c.isprintable() else " " for c in text).split())
    return words if len(words) <= _LONGEST else f"{words[: _LONGEST - 3]}..."
