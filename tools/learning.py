"""Draw what MaskablePPO learns, from docs/figures.json: completed rounds before and after, for each map and seed."""

import re
from collections.abc import Mapping
from typing import Any

_SHARES = re.compile(r"(\S+): ([\d.]+)(?: \[([\d.]+), ([\d.]+)\])? % of \d+ rounds completed|  (\w+) ([\d.]+) %")
_STYLE = """<style>
text { font: 14px system-ui, "Helvetica Neue", Arial, sans-serif; fill: #1b1f24; } .end { text-anchor: end; }
.quiet { fill: #57606a; } .bold { font-weight: 600; } path { stroke: #d0d7de; } .other { stroke: #57606a; }
circle { fill: #ffffff; stroke: #2f6fd0; } .after { fill: #2f6fd0; stroke: #2f6fd0; } path.after { stroke-width: 5; }
</style>"""


def draw(record: Mapping[str, Any]) -> str:
    """Return the picture as SVG; ``record`` is the measurement ``maskable_ppo``."""
    seeds = {seed: [m.groups() for m in map(_SHARES.match, lines) if m] for seed, lines in record["values"].items()}
    first, shapes, y = next(iter(seeds.values())), [_text(14, 24, "MaskablePPO: completed rounds, %", "bold")], 84
    for at, name in ((k, line[0]) for k, line in enumerate(first) if line[2]):
        shapes.append(_text(14, y - 26, name, "bold"))
        for (*_, policy, share), side in zip(first[at + 1 : at + 3], ("", " end"), strict=True):  # on the same rounds
            shapes.append(f'<path class="other" d="M{_x(share)} {y - 8}v{22 * len(seeds)}" stroke-dasharray="4 3"/>')
            shapes.append(_text(_x(share), y - 12, f"{policy} {share}", f"quiet{side}"))
        for seed, lines in seeds.items():
            (_, before, *_), (_, after, low, high, *_) = (line for line in lines if line[0] == name)
            rise = f'<path d="M{_x(before)} {y + 6}H{_x(after)}"/>'
            shapes.append(f'{rise}<circle cx="{_x(before)}" cy="{y + 6}" r="5"/>')
            shapes.append(f'<path class="after" d="M{_x(low)} {y + 6}H{_x(high)}"/>')
            shapes.append(f'<circle class="after" cx="{_x(after)}" cy="{y + 6}" r="5"/>')
            shapes.append(_text(64, y + 11, seed.strip("-"), "quiet end") + _text(_x(high) + 8, y + 11, after, "bold"))
            y += 22
        y += 50
    shapes.append(f'<circle cx="22" cy="{y - 30}" r="5"/><circle class="after" cx="120" cy="{y - 30}" r="5"/>')
    shapes.append(_text(34, y - 25, "untrained", "") + _text(132, y - 25, "after 200,000 decisions, 95 % interval", ""))
    shapes.append(_text(14, y + 2, f"Version {record['version']}, {record['date']}, {record['machine']}", "quiet"))
    card = f'<rect x="1" y="1" width="458" height="{y + 14}" rx="12" fill="#ffffff" stroke="#d0d7de"/>'
    size = f'viewBox="0 0 460 {y + 16}" width="460" height="{y + 16}" role="img"'
    return "\n".join([f'<svg xmlns="http://www.w3.org/2000/svg" {size}>', _STYLE, card, *shapes, "</svg>\n"])


def _x(percent: str) -> float:
    return round(76 + 3.5 * float(percent), 1)


def _text(x: float, y: float, words: str, kind: str) -> str:
    return f'<text x="{x}" y="{y}" class="{kind}">{words}</text>'
