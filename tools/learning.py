"""Draw what MaskablePPO learns, from docs/figures.json: completed rounds before and after, for each map and seed."""

import re
from collections.abc import Mapping
from typing import Any

_HEAD, _ROW = 50, 22  # heights of a map's heading and of a seed's row
_SHARES = re.compile(r"(\S+): ([\d.]+)(?: \[([\d.]+), ([\d.]+)\])? % of \d+ rounds completed|  (\w+) ([\d.]+) %")
_STYLE = """text { font: 14px system-ui, "Helvetica Neue", Arial, sans-serif; fill: #1b1f24; }
.quiet { fill: #57606a; } .bold { font-weight: 600; } .end { text-anchor: end; }"""


def draw(record: Mapping[str, Any]) -> str:
    """Return the picture as SVG; ``record`` is the measurement ``maskable_ppo``."""
    seeds = {seed: [m.groups() for m in map(_SHARES.match, lines) if m] for seed, lines in record["values"].items()}
    first, shapes, y = next(iter(seeds.values())), [_text(14, 24, "MaskablePPO: completed rounds, %", "bold")], 34
    for at, name in ((k, line[0]) for k, line in enumerate(first) if line[2]):
        shapes.append(_text(14, y + 24, name, "bold"))
        for (*_, policy, share), side in zip(first[at + 1 : at + 3], ("", " end"), strict=True):  # on the same rounds
            bottom = y + _HEAD + _ROW * len(seeds) - 8
            shapes.append(_line(share, y + _HEAD - 8, share, bottom, '#57606a" stroke-dasharray="4 3'))
            shapes.append(_text(_x(share), y + _HEAD - 12, f"{policy} {share}", f"quiet{side}"))
        y += _HEAD
        for seed, lines in seeds.items():
            (_, before, *_), (_, after, low, high, *_) = (line for line in lines if line[0] == name)
            shapes += [
                _text(64, y + 11, seed.removeprefix("--"), "quiet end"),
                _line(before, y + 6, after, y + 6, "#d0d7de"),
            ]
            shapes += [_line(low, y + 6, high, y + 6, '#2f6fd0" stroke-width="5'), _dot(before, y + 6, "#ffffff")]
            shapes += [_dot(after, y + 6, "#2f6fd0"), _text(_x(high) + 8, y + 11, after, "bold")]
            y += _ROW
    shapes += [_dot(-15, y + 20, "#ffffff"), _text(35, y + 25, "untrained"), _dot(13, y + 20, "#2f6fd0")]
    shapes += [_text(133, y + 25, "after 200,000 decisions, 95 % interval")]
    shapes += [_text(14, y + 52, f"Version {record['version']}, {record['date']}, {record['machine']}", "quiet")]
    card = f'<rect x="1" y="1" width="458" height="{y + 64}" rx="12" fill="#ffffff" stroke="#d0d7de"/>'
    size = f'viewBox="0 0 460 {y + 66}" width="460" height="{y + 66}" role="img"'
    inner = "\n".join([f"<style>\n{_STYLE}\n</style>", card, *shapes])
    return f'<svg xmlns="http://www.w3.org/2000/svg" {size}>\n{inner}\n</svg>\n'


def _x(percent: float | str) -> float:
    return round(76 + 3.5 * float(percent), 1)


def _text(x: float, y: float, words: str, kind: str = "") -> str:
    return f'<text x="{x}" y="{y}" class="{kind}">{words}</text>'


def _line(x1: float | str, y1: float, x2: float | str, y2: float, stroke: str) -> str:
    return f'<path d="M{_x(x1)} {y1} L{_x(x2)} {y2}" stroke="{stroke}"/>'


def _dot(x: float | str, y: float, fill: str) -> str:
    return f'<circle cx="{_x(x)}" cy="{y}" r="5.5" fill="{fill}" stroke="#2f6fd0" stroke-width="1.5"/>'
