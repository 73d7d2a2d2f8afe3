"""The comparison as aligned plain text for a terminal."""

from __future__ import annotations

import itertools
import textwrap
from collections.abc import Sequence

from eval.rows import Row

_WIDTH = 136
_NAME_WIDTH = 22
_HEADER = (
    "policy",
    "complete",
    "all but one",
    "pellets",
    "death",
    "lossy",
    "time-out",
    "time s",
    "p50 ms",
    "p99 ms",
    "difference",
)


def short_name(policy: str, width: int = _NAME_WIDTH) -> str:
    """A policy's name; of a long path, its end."""
    return policy if len(policy) <= width else "…" + policy[1 - width :]


def groups(rows: Sequence[Row]) -> list[list[Row]]:
    """The rows of one map and one speed together, as they come."""
    return [list(g) for _, g in itertools.groupby(rows, key=lambda row: (row["map"], row["clyde_speed"]))]


def group_title(row: Row) -> str:
    """Map, pellets, Clyde's speed and rounds of a row's group."""
    clyde = f"Clyde at {row['clyde_speed']:g} m/s"
    return f"{row['map']}: {row['pellets']} pellets, {clyde}, {row['episodes']} episodes"


def render(rows: Sequence[Row]) -> str:
    """The table, one block per map and speed, and what the columns mean."""
    cells = [[_cells(row, first=k == 0) for k, row in enumerate(group)] for group in groups(rows)]
    columns = zip(_HEADER, *itertools.chain.from_iterable(cells), strict=True)
    widths = [max(map(len, column)) for column in columns]

    def line(texts: Sequence[str]) -> str:
        parts = (t.ljust(w) if k == 0 else t.rjust(w) for k, (t, w) in enumerate(zip(texts, widths, strict=True)))
        return "  ".join(parts).rstrip()

    lines: list[str] = []
    for group, block in zip(groups(rows), cells, strict=True):
        lines += [group_title(group[0]), line(_HEADER), *map(line, block), ""]
    meaning = (
        "Rates in %, with 95 % intervals. complete: every pellet collected; all but one: at most one not collected;"
        " pellets: mean collected; lossy: no pellet left, but some lost to aborted goals; time: mean of all"
        " episodes; p50, p99: one decision, policy only; difference: completion minus that of"
        f" {short_name(rows[0]['policy'])}, paired by seed."
    )
    return "\n".join([*lines, *textwrap.wrap(meaning, _WIDTH)])


def _cells(row: Row, first: bool) -> list[str]:
    return [
        short_name(row["policy"]),
        _with_interval(row["completion_rate"], row["completion_ci"]),
        _with_interval(row["all_but_one_rate"], row["all_but_one_ci"]),
        f"{row['pellets_mean']:.2f}",
        _percent(row["death_rate"]),
        _percent(row["cleared_rate"]),
        _percent(row["timeout_rate"]),
        f"{row['time_mean_s']:.1f}",
        f"{row['decision_ms_p50']:.3f}",
        f"{row['decision_ms_p99']:.3f}",
        "-" if first else _with_interval(row["paired_difference"], row["paired_ci"], sign="+"),
    ]


def _percent(rate: float, sign: str = "") -> str:
    return f"{100 * rate + 0.0:{sign}.1f}"


def _with_interval(rate: float, interval: Sequence[float], sign: str = "") -> str:
    low, high = (_percent(limit, sign) for limit in interval)
    return f"{_percent(rate, sign)} [{low}, {high}]"
