"""The report's numbers as one HTML page that needs nothing else. Which numbers there are is decided by ``numbers``."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from typing import Any

from pacman_env.episodes.rollout import MOST_ROUNDS
from pacman_env.evaluation.compare.table import percent
from pacman_env.evaluation.report.charts import COLOURS, Line, curve_chart, interval_bar
from pacman_env.evaluation.report.numbers import END_NAMES, Numbers
from pacman_env.evaluation.templates import render

_ROUNDS_SHOWN = 12  # of either kind
_IQM_MAPS = 4  # with fewer maps than these nothing is left out of the mean


def render_page(report: Numbers) -> str:
    """The page of a report as ``pacman-env report`` writes it to JSON; every text in it is escaped."""
    names = [policy["name"] for policy in report["policies"]]
    return render(
        "report.html.j2",
        {"percent": percent, "percents": percents, "number": number, "numbers": numbers},
        r=report,
        names=names,
        baseline=next(policy["name"] for policy in report["policies"] if policy["baseline"]),
        headline=headline(report),
        curve=_curve(report, names),
        bar=interval_bar,
        colours=COLOURS,
        rows=_by(report["summary"]),
        variants=list(dict.fromkeys(row["variant"] for row in report["variants"])),
        most_pellets=max((row["pellets_ci"][1] for row in report["endless"]), default=1.0),
        ends=list(END_NAMES.values()),
        rounds_shown=_ROUNDS_SHOWN,
        most_rounds=MOST_ROUNDS,
        few_maps=len(report["maps"]) < _IQM_MAPS,
        config=json.dumps(report["config"], indent=2),
    )


def headline(report: Numbers) -> str:
    pair = report["pair"]
    if pair is None:
        row = report["summary"][0]
        return f"{row['policy']} completes {percent(row['all']['rate'])} % of its rounds. It was not compared."
    rows = _by(report["summary"])
    ours, theirs = rows[pair["policy"]], rows[pair["baseline"]]
    low, high = ours["difference_ci"]
    verdict = "more" if low > 0 else "fewer" if high < 0 else ""
    verdict = (
        f"{percent(abs(ours['difference']))} percentage points {verdict} (95 % interval"
        f" {percent(low, '+')} to {percent(high, '+')})"
        if verdict
        else f"a difference that so few rounds cannot tell from none (95 % interval {percent(low, '+')} to"
        f" {percent(high, '+')} percentage points)"
    )
    return (
        f"{pair['policy']} completes {percent(ours['all']['rate'])} % of the rounds, {pair['baseline']}"
        f" {percent(theirs['all']['rate'])} % of the same rounds: {verdict}."
    )


def _by(rows: Sequence[Numbers]) -> dict[str, Numbers]:
    return {row["policy"]: row for row in rows}


def _curve(report: Numbers, names: Sequence[str]) -> Any:
    lines = [
        Line(name, [(row["speed"], row["rate"], *row["ci"]) for row in report["curve"] if row["policy"] == name])
        for name in names
    ]
    robot = report["config"]["robot"]["speed_mps"]
    return curve_chart(
        lines,
        x_title="Clyde's speed, m/s",
        y_title="rounds completed, %",
        marks=[(robot, f"the robot's speed, {robot:g} m/s")],
    )


def percents(interval: Sequence[float], sign: str = "") -> str:
    return f"{percent(interval[0], sign)} to {percent(interval[1], sign)}"


def number(value: float, digits: int = 1, sign: str = "") -> str:
    return "-" if value is None or math.isnan(value) else f"{value + 0.0:{sign}.{digits}f}"


def numbers(interval: Sequence[float], sign: str = "") -> str:
    return f"{number(interval[0], sign=sign)} to {number(interval[1], sign=sign)}"
