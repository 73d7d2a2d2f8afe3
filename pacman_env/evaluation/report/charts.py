"""Charts of the report's page as inline SVG. Colours come from the page's style sheet, so that they suit its theme."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from html import escape
from typing import NamedTuple

from markupsafe import Markup

COLOURS = 7  # classes c0, c1, ... of the style sheet
_WIDTH, _HEIGHT = 760, 400
_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 168, 22, 46
_LABEL_PX = 17  # between two labels at the end of the lines
_BAR_WIDTH, _BAR_HEIGHT = 104, 12


class Line(NamedTuple):
    """One policy's line: (x, rate, low, high) from left to right; rates are 0..1."""

    label: str
    points: Sequence[tuple[float, float, float, float]]


def interval_bar(value: float, interval: Sequence[float], colour: int, low: float = 0.0, high: float = 1.0) -> Markup:
    inner = _BAR_WIDTH - _BAR_HEIGHT

    def place(number: float) -> float:
        share = (number - low) / (high - low) if high > low else 0.5
        return _BAR_HEIGHT / 2 + inner * min(max(share, 0.0), 1.0)

    left, right, middle = place(interval[0]), place(interval[1]), _BAR_HEIGHT / 2
    zero = f'<path class="zero" d="M{place(0.0):.1f} 0V{_BAR_HEIGHT}"/>' if low < 0 < high else ""
    return Markup(
        f'<svg class="bar c{colour % COLOURS}" viewBox="0 0 {_BAR_WIDTH} {_BAR_HEIGHT}" width="{_BAR_WIDTH}"'
        f' height="{_BAR_HEIGHT}" aria-hidden="true"><path class="track" d="M{middle} {middle}h{inner}"/>{zero}'
        f'<rect class="range" x="{left - 2:.1f}" y="2.5" width="{right - left + 4:.1f}" height="7" rx="3.5"/>'
        f'<circle class="dot" cx="{place(value):.1f}" cy="{middle}" r="4"/></svg>'
    )


def curve_chart(
    lines: Sequence[Line], *, x_title: str, y_title: str, marks: Sequence[tuple[float, str]] = ()
) -> Markup:
    """Rates against x, the same for all lines, with intervals as bands; ``marks`` are dashed lines with labels."""
    xs = [x for line in lines for x, *_ in line.points]
    first, last = min(xs), max(xs)
    spread = last - first or 1.0

    def px(x: float) -> float:
        return _LEFT + (_WIDTH - _LEFT - _RIGHT) * ((x - first) / spread if last > first else 0.5)

    def py(rate: float) -> float:
        return _HEIGHT - _BOTTOM - (_HEIGHT - _BOTTOM - _TOP) * rate

    base = _HEIGHT - _BOTTOM
    parts = [_grid(sorted(set(xs)), px, py, base)]
    for x, label in marks:
        if first <= x <= last:
            parts.append(f'<path class="mark" d="M{px(x):.1f} {_TOP}V{base}"/>')
            parts.append(f'<text class="note" x="{px(x) + 5:.1f}" y="{base - 7}">{escape(label)}</text>')
    for k, line in enumerate(lines):
        upper = [f"{px(x):.1f},{py(high):.1f}" for x, _, _, high in line.points]
        lower = [f"{px(x):.1f},{py(low):.1f}" for x, _, low, _ in reversed(line.points)]
        parts.append(f'<polygon class="band c{k % COLOURS}" points="{" ".join(upper + lower)}"/>')
    for k, line in enumerate(lines):
        places = [(px(x), py(rate), x, rate, low, high) for x, rate, low, high in line.points]
        parts.append(
            f'<polyline class="line c{k % COLOURS}" points="{" ".join(f"{x:.1f},{y:.1f}" for x, y, *_ in places)}"/>'
        )
        for left, top, x, rate, low, high in places:
            title = f"{line.label}, {x:g} m/s: {100 * rate:.1f} % [{100 * low:.1f}, {100 * high:.1f}]"
            parts.append(
                f'<circle class="dot c{k % COLOURS}" cx="{left:.1f}" cy="{top:.1f}" r="4">'
                f"<title>{escape(title)}</title></circle>"
            )
    tops = _apart([py(line.points[-1][1]) for line in lines])
    for k, (line, top) in enumerate(zip(lines, tops, strict=True)):
        name = line.label if len(line.label) <= 20 else line.label[:19] + "…"
        parts.append(
            f'<text class="name c{k % COLOURS}" x="{px(last) + 12:.1f}" y="{top + 4.5:.1f}">{escape(name)}</text>'
        )
    parts.append(f'<text class="axis" x="{_LEFT}" y="{_TOP - 9}">{escape(y_title)}</text>')
    middle = (_LEFT + _WIDTH - _RIGHT) / 2
    parts.append(f'<text class="axis middle" x="{middle}" y="{_HEIGHT - 8}">{escape(x_title)}</text>')
    label = escape(f"{y_title} against {x_title}")
    return Markup(
        f'<svg class="chart" viewBox="0 0 {_WIDTH} {_HEIGHT}" role="img" aria-label="{label}">{"".join(parts)}</svg>'
    )


def _grid(xs: Sequence[float], px, py, base: float) -> str:  # type: ignore[no-untyped-def]
    parts = []
    for percent in range(0, 101, 20):
        y = py(percent / 100)
        parts.append(f'<path class="grid" d="M{_LEFT} {y:.1f}H{_WIDTH - _RIGHT}"/>')
        parts.append(f'<text class="tick end" x="{_LEFT - 8}" y="{y + 4:.1f}">{percent}</text>')
    for x in xs:
        parts.append(f'<text class="tick middle" x="{px(x):.1f}" y="{base + 18}">{x:.2f}</text>')
    return "".join(parts)


def _apart(tops: Sequence[float]) -> list[float]:
    """The heights, moved as far as labels need that must not cover one another."""
    order = sorted(range(len(tops)), key=lambda k: tops[k])
    placed = list(tops)
    for above, below in itertools.pairwise(order):
        placed[below] = max(placed[below], placed[above] + _LABEL_PX)
    limit = float(_HEIGHT - _BOTTOM)
    for k in reversed(order):
        placed[k] = min(placed[k], limit)
        limit = placed[k] - _LABEL_PX
    return placed
