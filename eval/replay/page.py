"""A round's film and the policies' decisions as one HTML page that needs nothing beside it."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape

from eval.replay.recording import Watched

_STYLE = """
:root { color-scheme: light dark; font: 16px/1.5 system-ui, sans-serif }
body { margin: 2rem auto; max-width: 80rem; padding: 0 1rem }
video { width: 100%; background: #1b1f2b }
h1 { font-size: 1.3rem } h2 { font-size: 1.1rem; margin-top: 2rem }
.scroll { overflow-x: auto }
table { border-collapse: collapse; font-size: .9rem }
th, td { border-bottom: 1px solid #8886; padding: .2rem .8rem .2rem 0; text-align: left; vertical-align: top }
td:first-child { white-space: nowrap; text-align: right; font-variant-numeric: tabular-nums }
td:nth-child(2) { white-space: nowrap }
"""
_EXPLANATION = (
    "Each line below is a decision to go somewhere else, with the policy's own explanation: a higher score is better;"
    " what follows it are the terms that it is made of. Pellets and refuges are counted from 0."
)


def page(title: str, film: bytes, games: Sequence[Watched]) -> str:
    """The page.

    Args:
        title: its heading.
        film: an MP4.
        games: those in the film, played to their end.
    """
    data = base64.b64encode(film).decode()
    parts = [
        '<!doctype html>\n<html lang="en">\n<meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n<h1>{escape(title)}</h1>",
        f'<video controls autoplay muted loop src="data:video/mp4;base64,{data}"></video>',
        f"<p>{_EXPLANATION}</p>",
    ]
    for game in games:
        rows = "\n".join(
            f"<tr><td>{change.when}<td>{escape(change.goal)}<td>{escape(change.why)}" for change in game.changes
        )
        parts.append(
            f"<h2>{escape(game.name)}: {escape(game.outcome())}</h2>\n"
            f'<div class="scroll"><table>\n<tr><th>time<th>goal<th>why\n{rows}\n</table></div>'
        )
    return "\n".join(parts) + "\n</html>\n"
