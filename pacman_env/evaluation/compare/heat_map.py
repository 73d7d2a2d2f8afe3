"""Draw the completion rates of all policies in all cells of a suite as an SVG picture."""

import itertools
from collections.abc import Iterator, Sequence
from html import escape

from pacman_env.evaluation.compare.league_table import ghosts_of, groups_of
from pacman_env.evaluation.rounds.summary import Row

_LABEL, _WIDTH, _HEIGHT, _GAP = 230, 38, 24, 10  # px: column of the ghosts, a field, and between policies
_STYLE = "text{font:13px system-ui,Arial,sans-serif;fill:#1b1f24}.w{fill:#fff}.b{font-weight:600}.m{text-anchor:middle}"


def draw(rows: Sequence[Row]) -> str:
    """Return an SVG picture: a row for each list of ghosts, a column for each policy and speed."""
    policies = list(dict.fromkeys(row["policy"] for row in rows))
    speeds = sorted({row["clyde_speed"] for row in rows})
    step = len(speeds) * _WIDTH + _GAP
    width, body, y = _LABEL + len(policies) * step + 20, [], 20
    for group, cells in groups_of(rows).items():
        body += [_text(15, y + 16, f"{group[0].upper()}{group[1:]}: completed, %", "b")]
        for k, name in enumerate(policies):
            body += [_text(_LABEL + k * step + (step - _GAP) / 2, y + 16, name, "b m")]
            body += [
                _text(_LABEL + k * step + (n + 0.5) * _WIDTH, y + 36, f"{speed:g}", "m")
                for n, speed in enumerate(speeds)
            ]
        body += [_text(15, y + 36, "ghosts, and their speed in m/s")]
        y += 44
        for ghosts, line in itertools.groupby(itertools.chain.from_iterable(cells), key=ghosts_of):
            body += [_text(15, y + 17, ghosts)]
            for row in line:
                x = _LABEL + policies.index(row["policy"]) * step + speeds.index(row["clyde_speed"]) * _WIDTH
                body += _field(row["completion_rate"], x, y)
            y += _HEIGHT
        y += 24
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {y}" width="{width}" height="{y}">'
    back = f'<rect width="{width}" height="{y}" rx="10" fill="#fff"/>'
    return "\n".join([head, f"<title>League table</title><style>{_STYLE}</style>", back, *body, "</svg>\n"])


def _field(rate: float, x: float, y: float) -> Iterator[str]:
    colour = "#{:02x}{:02x}{:02x}".format(*(round(a + (b - a) * rate) for a, b in ((247, 8), (251, 81), (255, 156))))
    yield f'<rect x="{x}" y="{y}" width="{_WIDTH - 1}" height="{_HEIGHT - 1}" fill="{colour}"/>'
    yield _text(x + _WIDTH / 2, y + 17, f"{100 * rate:.0f}", "m w" if rate > 0.5 else "m")


def _text(x: float, y: float, text: str, style: str = "") -> str:
    return f'<text x="{x:g}" y="{y:g}" class="{style}">{escape(text)}</text>'
