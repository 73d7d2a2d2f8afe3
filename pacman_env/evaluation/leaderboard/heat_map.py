"""Draw the completion of all policies in all cells of a league table as an SVG picture."""

from collections.abc import Iterator
from html import escape

from pacman_env.evaluation.leaderboard.numbers import CellResult, LeagueTable
from pacman_env.evaluation.leaderboard.page import ghosts_of, groups

_LABEL, _WIDTH, _HEIGHT, _GAP = 230, 38, 24, 10  # px: column of the ghosts, a field, and between policies
_STYLE = "text{font:13px system-ui,Arial,sans-serif;fill:#1b1f24}.w{fill:#fff}.b{font-weight:600}.m{text-anchor:middle}"


def draw(table: LeagueTable) -> str:
    """Return an SVG picture: a row for each list of ghosts, a column for each policy and speed."""
    policies = [entry.name for entry in table.policies]
    speeds = sorted({cell.speed_mps for cell in table.cells})
    step = len(speeds) * _WIDTH + _GAP
    width, body, y = _LABEL + len(policies) * step + 20, [], 20
    for group in groups(table):
        cells = [cell for cell in table.cells if cell.group == group]
        body += [_text(15, y + 16, f"{group[0].upper()}{group[1:]}: completed, %", "b")]
        for k, name in enumerate(policies):
            body += [_text(_LABEL + k * step + (step - _GAP) / 2, y + 16, name, "b m")]
            body += [
                _text(_LABEL + k * step + (n + 0.5) * _WIDTH, y + 36, f"{speed:g}", "m")
                for n, speed in enumerate(speeds)
            ]
        body += [_text(15, y + 36, "ghosts, and their speed in m/s")]
        y += 44
        for ghosts in dict.fromkeys(cell.ghosts for cell in cells):
            row = [cell for cell in cells if cell.ghosts == ghosts]
            body += [_text(15, y + 17, ghosts_of(row[0]))]
            for k, name in enumerate(policies):
                body += _fields(row, speeds, name, _LABEL + k * step, y)
            y += _HEIGHT
        y += 24
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {y}" width="{width}" height="{y}">'
    back = f'<rect width="{width}" height="{y}" rx="10" fill="#fff"/>'
    return "\n".join([head, f"<title>League table</title><style>{_STYLE}</style>", back, *body, "</svg>\n"])


def _fields(row: list[CellResult], speeds: list[float], policy: str, x: int, y: int) -> Iterator[str]:
    for cell in row:
        rate = next(one.completion_rate for one in cell.policies if one.policy == policy)
        left = x + speeds.index(cell.speed_mps) * _WIDTH
        colour = "#{:02x}{:02x}{:02x}".format(
            *(round(a + (b - a) * rate) for a, b in ((247, 8), (251, 81), (255, 156)))
        )
        yield f'<rect x="{left}" y="{y}" width="{_WIDTH - 1}" height="{_HEIGHT - 1}" fill="{colour}"/>'
        yield _text(left + _WIDTH / 2, y + 17, f"{100 * rate:.0f}", "m w" if rate > 0.5 else "m")


def _text(x: float, y: float, text: str, style: str = "") -> str:
    return f'<text x="{x:g}" y="{y:g}" class="{style}">{escape(text)}</text>'
