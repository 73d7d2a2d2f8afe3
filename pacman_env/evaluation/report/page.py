"""Self-contained HTML page of a report's numbers; ``numbers`` decides which numbers there are."""

import itertools
import json
import math
from collections.abc import Sequence
from typing import Any, NamedTuple

from markupsafe import Markup

from pacman_env.episodes.rollout import MOST_ROUNDS
from pacman_env.evaluation.compare.table import percent
from pacman_env.evaluation.report.numbers import END_NAMES
from pacman_env.evaluation.report.plan import ENDLESS_GAMES, ROUNDS
from pacman_env.evaluation.rounds.summary import Row
from pacman_env.evaluation.templates import render

#: Field of a row that contains the share of each end.
_SHARES = dict(zip(END_NAMES.values(), ("completion_rate", "death_rate", "timeout_rate", "cleared_rate"), strict=True))
COLOURS = 7  # classes c0, c1, ... of the style sheet
_WIDTH, _HEIGHT = 760, 400
_LEFT, _RIGHT, _TOP, _BOTTOM = 52, 168, 22, 46
_LABEL_PX = 17  # distance between two labels at the end of the lines
_BAR_WIDTH, _BAR_HEIGHT = 104, 12
_ROUNDS_SHOWN = 12  # rounds shown per kind
_IQM_MAPS = 4  # with fewer maps the interquartile mean omits none


def render_page(report: dict[str, Any]) -> str:
    """Return the page of a report, given as the JSON data of ``pacman-env report``; all text in it is escaped."""
    names = [policy["name"] for policy in report["policies"]]
    robot = report["config"]["robot"]["speed_mps"]
    rows = {(row["part"], row["map"], row["policy"], row["clyde_speed"]): row for row in report["rows"]}
    speed, speeds = report["clyde_speed"], report["speeds"]
    curves = [Line(name, [_point(rows[ROUNDS, None, name, one]) for one in speeds]) for name in names]
    endless_maps = list(dict.fromkeys(row["map"] for row in report["rows"] if row["part"] == ENDLESS_GAMES))
    mark = (robot, f"the robot's speed, {robot:g} m/s")
    return render(
        "report.html.j2",
        {"percent": percent, "percents": percents, "number": number, "numbers": numbers},
        r=report,
        names=names,
        baseline=next(policy["name"] for policy in report["policies"] if policy["baseline"]),
        headline=headline(report),
        curve=curve_chart(curves, x_title="Clyde's speed, m/s", y_title="rounds completed, %", marks=[mark]),
        bar=interval_bar,
        colours=COLOURS,
        cell=lambda name, map_name=None, at=speed, part=ROUNDS: rows[part, map_name, name, at],
        endless_maps=endless_maps if len(endless_maps) > 2 else endless_maps[:1],  # None is last: all maps together
        speeds=speeds,
        tasks={row["policy"]: row for row in report["summary"]},
        most_pellets=max((row["pellets_ci"][1] for row in report["rows"] if row["kind"] == "endless"), default=1.0),
        ends=_SHARES,
        rounds_shown=_ROUNDS_SHOWN,
        endless_part=ENDLESS_GAMES,
        most_rounds=MOST_ROUNDS,
        few_maps=len(report["maps"]) < _IQM_MAPS,
        config=json.dumps(report["config"], indent=2),
    )


def headline(report: dict[str, Any]) -> str:
    """Return the result in one sentence: the first policy against the baseline, over all maps."""
    rows = {
        row["policy"]: row
        for row in report["rows"]
        if (row["part"], row["map"], row["clyde_speed"]) == (ROUNDS, None, report["clyde_speed"])
    }
    pair = report["pair"]
    if pair is None:
        row = rows[report["policies"][0]["name"]]
        return f"{row['policy']} completes {percent(row['completion_rate'])} % of its rounds. It was not compared."
    ours, theirs = rows[pair["policy"]], rows[pair["baseline"]]
    low, high = ours["paired_ci"]
    verdict = "more" if low > 0 else "fewer" if high < 0 else ""
    verdict = (
        f"{percent(abs(ours['paired_difference']))} percentage points {verdict} (95 % interval"
        f" {percent(low, '+')} to {percent(high, '+')})"
        if verdict
        else f"a difference that is not significant with so few rounds (95 % interval {percent(low, '+')} to"
        f" {percent(high, '+')} percentage points)"
    )
    return (
        f"{pair['policy']} completes {percent(ours['completion_rate'])} % of the rounds, {pair['baseline']}"
        f" {percent(theirs['completion_rate'])} % of the same rounds: {verdict}."
    )


def _point(row: Row) -> tuple[float, float, float, float]:
    return row["clyde_speed"], row["completion_rate"], *row["completion_ci"]


def percents(interval: Sequence[float], sign: str = "") -> str:
    return f"{percent(interval[0], sign)} to {percent(interval[1], sign)}"


def number(value: float, digits: int = 1, sign: str = "") -> str:
    return "-" if value is None or math.isnan(value) else f"{value + 0.0:{sign}.{digits}f}"


def numbers(interval: Sequence[float], sign: str = "") -> str:
    return f"{number(interval[0], sign=sign)} to {number(interval[1], sign=sign)}"


class Line(NamedTuple):
    """Line of one policy: (x, rate, low, high) from left to right; rates are 0..1."""

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
    """Draw rates over x, with intervals as bands; all lines have the same x. ``marks`` are dashed lines with labels."""
    xs = sorted({x for line in lines for x, *_ in line.points})
    first, last, right, base = xs[0], xs[-1], _WIDTH - _RIGHT, _HEIGHT - _BOTTOM

    def px(x: float, shift: float = 0.0) -> str:
        return f"{_LEFT + (right - _LEFT) * ((x - first) / (last - first) if last > first else 0.5) + shift:.1f}"

    def height(rate: float) -> float:
        return base - (base - _TOP) * rate

    values: dict[str, Any] = {"lines": lines, "xs": xs, "x_title": x_title, "y_title": y_title, "colours": COLOURS}
    values |= {"width": _WIDTH, "height": _HEIGHT, "left": _LEFT, "right": right, "top": _TOP, "base": base}
    values |= {
        "px": px,
        "py": lambda rate, shift=0.0: f"{height(rate) + shift:.1f}",
        "marks": [(x, label) for x, label in marks if first <= x <= last],
        "label_tops": _spread([height(line.points[-1][1]) for line in lines]),
    }
    return Markup(render("chart.svg.j2", **values))


def _spread(tops: Sequence[float]) -> list[float]:
    """Return the heights of labels, moved so that the labels do not overlap."""
    order = sorted(range(len(tops)), key=lambda k: tops[k])
    placed = list(tops)
    for above, below in itertools.pairwise(order):
        placed[below] = max(placed[below], placed[above] + _LABEL_PX)
    limit = float(_HEIGHT - _BOTTOM)
    for k in reversed(order):
        placed[k] = min(placed[k], limit)
        limit = placed[k] - _LABEL_PX
    return placed
