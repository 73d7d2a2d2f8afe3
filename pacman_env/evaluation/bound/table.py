"""Aligned plain text of the bounds, 80 columns wide."""

import itertools
import textwrap
from collections.abc import Sequence

from .rows import Row

_WIDTH = 80
_HEADER = ("ghosts", "m/s", "safe pairs", "survive <=", "win <=", "win about", "in s")
_MEANING = (
    "% of the starts, safe pairs: % of all pairs of blocks. survive <=, win <=: upper bounds, by a relaxed pursuit that"
    " favours the robot. win about: an estimate, the share that a search with perfect information wins on the coarse"
    " model [95 %], and its mean time. *: trivial, nothing is known to be lost to ghosts that draw their ways. -: none."
)


def render(rows: Sequence[Row]) -> str:
    lines: list[str] = []
    for name, group in itertools.groupby(rows, key=lambda row: row["map"]):
        band = list(group)
        first = band[0]
        blocks = f"blocks of {first['block_m']:.2f} m"
        head = (
            f"{name}: {first['pellets']} pellets, {first['starts']} starts, {blocks}, at least {first['least_s']:.0f} s"
        )
        cells = [_HEADER, *map(_cells, band)]
        widths = [max(map(len, column)) for column in zip(*cells, strict=True)]
        lines.append(head)
        for row in cells:
            texts = (t.ljust(w) if k == 0 else t.rjust(w) for k, (t, w) in enumerate(zip(row, widths, strict=True)))
            lines.append("  ".join(texts).rstrip())
        lines.append("")
    return "\n".join([*lines, *textwrap.wrap(_MEANING, _WIDTH)])


def _cells(row: Row) -> tuple[str, ...]:
    mark = "" if row["bounded"] else "*"
    pairs = f"{100 * min(row['safe_pairs']):.1f}" if row["bounded"] else "-"
    about, seconds = "-", "-"
    if row["estimate"] is not None:
        low, high = row["estimate_ci"]
        about = f"{100 * row['estimate']:.0f} [{100 * low:.0f}, {100 * high:.0f}]"
        seconds = "-" if row["estimate_s"] is None else f"{row['estimate_s']:.0f}"
    bounds = (f"{100 * row[name]:.1f}{mark}" for name in ("survival_bound", "bound"))
    return row["ghosts"], f"{row['clyde_speed']:g}", pairs, *bounds, about, seconds
