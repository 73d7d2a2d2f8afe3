"""Plot of a comparison: completion with intervals and how the rounds ended, or pellets of endless games."""

import textwrap
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from pacman_env.evaluation.compare.text_table import group_title, groups, short_name
from pacman_env.evaluation.rounds.summary import Row
from pacman_env.files import replaced
from pacman_env.game.ends import CAUGHT, CLEARED, COMPLETE, ENDS, TIMEOUT

_COMPLETE, _ALL_BUT_ONE = ENDS[COMPLETE].chart, "#56B4E9"
_DARK = ENDS[COMPLETE].chart, ENDS[CAUGHT].chart  # text on them is white
_TITLE_WIDTH = 115  # characters
_ROOM_FOR_TEXT = 0.08  # narrower parts of a bar have no number


def save_plot(rows: Sequence[Row], path: Path, title: str) -> None:
    bands = groups(rows)
    endless = rows[0]["kind"] == "endless"
    heights = [0.75 + 0.55 * len(band) for band in bands]
    figure = Figure(figsize=(12.5, sum(heights) + 1.7), dpi=110, layout="constrained")
    grid = figure.subplots(len(bands), 2, squeeze=False, height_ratios=heights, sharex="col" if endless else False)
    figure.suptitle("\n".join(textwrap.fill(line, _TITLE_WIDTH) for line in title.splitlines()), fontsize=13)
    for (left, right), band in zip(grid, bands, strict=True):
        for axes, draw in ((left, _means if endless else _rates), (right, _games if endless else _ends)):
            draw(axes, band, np.arange(len(band)))
            axes.set_yticks(range(len(band)), [short_name(row["policy"]) for row in band])
            axes.set_ylim(len(band) - 0.45, -0.55)  # the first policy on top
            axes.grid(axis="x", color="0.88")
            axes.set_axisbelow(True)
            axes.spines[["top", "right"]].set_visible(False)
        left.set_title(group_title(band[0]), loc="left", fontsize=11, fontweight="bold")
        right.set_yticklabels([])
        right.set_title("every game" if endless else "how the rounds ended", loc="right", fontsize=11)
    labels = ("pellets per game, mean", "pellets per game") if endless else ("share of episodes, %",) * 2
    grid[-1, 0].set_xlabel(f"{labels[0]}  (whiskers: 95 % interval)")
    grid[-1, 1].set_xlabel(labels[1])
    for column, side in enumerate(("left", "right")):
        handles, names = grid[0, column].get_legend_handles_labels()
        if handles:
            figure.legend(handles, names, loc=f"outside lower {side}", ncols=len(names), frameon=False)
    with replaced(path) as temporary:
        figure.savefig(temporary, format="png")


def _means(axes: Any, band: Sequence[Row], y: NDArray[np.int64]) -> None:
    mean = np.array([row["pellets_mean"] for row in band])
    whiskers = np.abs(np.array([row["pellets_ci"] for row in band]).T - mean)
    axes.barh(y, mean, 0.6, color=_COMPLETE)
    axes.errorbar(mean, y, xerr=whiskers, fmt="none", ecolor="0.2", capsize=3, lw=1.2)
    for position, row in zip(y, band, strict=True):
        text = f"  {row['pellets_mean']:.1f}, {row['rounds_mean']:.1f} rounds"
        axes.text(row["pellets_ci"][1], position, text, va="center", fontsize=9)
    axes.margins(x=0.35)  # room for the text behind the longest bar
    axes.set_xlim(left=0)


def _games(axes: Any, band: Sequence[Row], y: NDArray[np.int64]) -> None:
    axes.boxplot(
        [row["outcomes"]["collected"] for row in band],
        orientation="horizontal",
        positions=y,
        widths=0.5,
        medianprops={"color": _COMPLETE, "lw": 2.0},
        flierprops={"marker": ".", "markersize": 4, "markerfacecolor": "0.4", "markeredgecolor": "none"},
    )
    axes.set_xlim(left=0)


def _rates(axes: Any, band: Sequence[Row], y: NDArray[np.int64]) -> None:
    for offset, key, label, colour in (
        (-0.2, "completion", ENDS[COMPLETE].meaning, _COMPLETE),
        (0.2, "all_but_one", "all, or all but one", _ALL_BUT_ONE),
    ):
        rate = np.array([row[f"{key}_rate"] for row in band])
        interval = np.array([row[f"{key}_ci"] for row in band])
        whiskers = 100 * np.abs(interval.T - rate)
        axes.barh(y + offset, 100 * rate, 0.36, color=colour, label=label)
        axes.errorbar(100 * rate, y + offset, xerr=whiskers, fmt="none", ecolor="0.2", capsize=3, lw=1.2)
        for position, value, high in zip(y + offset, rate, interval[:, 1], strict=True):
            axes.text(100 * high + 1.5, position, f"{100 * value:.1f} %", va="center", fontsize=9)
    axes.set_xlim(0, 114)  # room for the number behind a full bar
    axes.set_xticks(range(0, 101, 20))


def _ends(axes: Any, band: Sequence[Row], y: NDArray[np.int64]) -> None:
    start = np.zeros(len(band))
    for end in (ENDS[code] for code in (COMPLETE, CLEARED, TIMEOUT, CAUGHT)):
        share = np.array([row[f"{end.field}_rate"] for row in band])
        axes.barh(y, 100 * share, 0.6, left=100 * start, color=end.chart, label=end.name, edgecolor="white", lw=0.8)
        text_colour = "white" if end.chart in _DARK else "black"
        for position, value, left in zip(y, share, start, strict=True):
            if value >= _ROOM_FOR_TEXT:
                centre = 100 * (left + value / 2)
                axes.text(centre, position, f"{100 * value:.1f}", va="center", ha="center", color=text_colour)
        start += share
    axes.set_xlim(0, 100)
