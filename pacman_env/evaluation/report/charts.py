"""Charts of the report's page as inline SVG. Colours come from the page's style sheet, so that they suit its theme."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import Any, NamedTuple

from markupsafe import Markup

from pacman_env.evaluation.templates import render

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
    xs = sorted({x for line in lines for x, *_ in line.points})
    first, last, right, base = xs[0], xs[-1], _WIDTH - _RIGHT, _HEIGHT - _BOTTOM

    def px(x: float, shift: float = 0.0) -> str:
        return f"{_LEFT + (right - _LEFT) * ((x - first) / (last - first) if last > first else 0.5) + shift:.1f}"

    def height(rate: float) -> float:
        return base - (base - _TOP) * rate

    words: dict[str, Any] = {"lines": lines, "xs": xs, "x_title": x_title, "y_title": y_title, "colours": COLOURS}
    sizes = {"width": _WIDTH, "height": _HEIGHT, "left": _LEFT, "right": right, "top": _TOP, "base": base}
    places: dict[str, Any] = {
        "px": px,
        "py": lambda rate, shift=0.0: f"{height(rate) + shift:.1f}",
        "marks": [(x, label) for x, label in marks if first <= x <= last],
        "label_tops": _apart([height(line.points[-1][1]) for line in lines]),
    }
    return Markup(render("chart.svg.j2", **words, **sizes, **places))


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
