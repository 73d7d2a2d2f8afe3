"""Aligned plain text of a comparison for a terminal."""

import itertools
import textwrap
from collections.abc import Callable, Sequence
from typing import NamedTuple

from pacman_env.evaluation.rounds.summary import Row
from pacman_env.game.ends import CAUGHT, CLEARED, COMPLETE, ENDS, TIMEOUT

WIDTH = 136  # columns of text; fits the table unless names are long
_NAME_WIDTH = 22

_Cell = Callable[[Row], str]


class TextTable(NamedTuple):
    """Texts of a table; ``align`` contains l or r for each column."""

    head: Sequence[str]
    align: str
    rows: Sequence[Sequence[str]]

    def padded(self, least: int = 0) -> list[list[str]]:
        """Return head and rows with cells of the same width in each column, at least ``least`` characters."""
        widths = [max(least, *map(len, column)) for column in zip(self.head, *self.rows, strict=True)]
        aligned = [str.ljust if side == "l" else str.rjust for side in self.align]
        return [
            [align(cell, width) for align, cell, width in zip(aligned, line, widths, strict=True)]
            for line in (self.head, *self.rows)
        ]


def short_name(policy: str) -> str:
    """Return a policy's name; of a long path, only the end, in 22 characters."""
    return policy if len(policy) <= _NAME_WIDTH else "…" + policy[1 - _NAME_WIDTH :]


def groups(rows: Sequence[Row]) -> list[list[Row]]:
    return [list(g) for _, g in itertools.groupby(rows, key=lambda row: (row["map"], row["clyde_speed"]))]


def group_title(row: Row) -> str:
    least, most = row["pellets_least"], row["pellets"]
    pellets = f"{most}" if least == most else f"{least} to {most}"
    levels = f" on {row['levels']} levels" if row["levels"] > 1 else ""
    what = "endless games" if row["kind"] == "endless" else "episodes"
    return f"{row['map']}: {pellets} pellets{levels}, Clyde at {row['clyde_speed']:g} m/s, {row['episodes']} {what}"


def render(rows: Sequence[Row], width: int = WIDTH, *, power: bool = False) -> str:
    """Return the table of all rows.

    Columns that do not fit in ``width`` characters follow below, with the policies repeated. ``power`` (the game has
    power pellets) adds a column with the caught ghosts.
    """
    tables = [table_of(group, power=power) for group in groups(rows)]
    cells = [line for table in tables for line in table.rows]
    header, *texts = tables[0]._replace(rows=cells).padded()
    bands: list[list[int]] = [[]]  # columns printed next to each other, without the column of policies
    for column in range(1, len(header)):
        if bands[-1] and sum(len(header[k]) + 2 for k in (*bands[-1], column)) + len(header[0]) > width:
            bands.append([])
        bands[-1].append(column)

    lines, following = list[str](), iter(texts)
    for group in groups(rows):
        lines.append(group_title(group[0]))
        block = [header, *itertools.islice(following, len(group))]
        for band in bands:
            lines += [*("  ".join([cells[0], *(cells[k] for k in band)]).rstrip() for cells in block), ""]
        if len(group) > 1:
            lines += [*textwrap.wrap(verdict(group), min(width, WIDTH)), ""]
    return "\n".join([*lines, *textwrap.wrap(meaning(rows, power=power), min(width, WIDTH))])


def table_of(group: Sequence[Row], *, power: bool = False) -> TextTable:
    """Return the table of one map and speed; the first column contains the policies."""
    columns = {
        **_POLICY, **(_ENDLESS if group[0]["kind"] == "endless" else _ROUND), **(_GHOSTS if power else {}), **_ENDS
    }  # fmt: skip
    lines = [[*(cell(row) for cell in columns.values()), _difference(row, k == 0)] for k, row in enumerate(group)]
    return TextTable([*columns, "difference"], "l" + "r" * len(columns), lines)


def meaning(rows: Sequence[Row], *, power: bool = False) -> str:
    """Return an explanation of the columns."""
    endless = rows[0]["kind"] == "endless"
    text = f"{_ENDLESS_MEANING if endless else _ROUND_MEANING} {short_name(rows[0]['policy'])}, paired by seed."
    if power:
        text += f" {_CAUGHT}: mean number of ghosts caught per {'game' if endless else 'round'}, with its interval."
    return text


def verdict(group: Sequence[Row]) -> str:
    """Return a sentence on which policies are better or worse than the first one in the same rounds."""
    first, *others = group
    if not others:
        return ""
    number, unit = (_number, "pellets") if first["kind"] == "endless" else (percent, "points")
    found: dict[str, list[str]] = {"more": [], "less": [], "": []}
    for row in others:
        low, high = row["paired_ci"]
        side = "more" if low > 0 else "less" if high < 0 else ""
        value = f" ({number(row['paired_difference'], '+')} {unit})" if side else ""
        found[side].append(f"{short_name(row['policy'])}{value}")
    what = "collects" if first["kind"] == "endless" else "completes"
    than = f"than {short_name(first['policy'])}"
    shown = [f"{what} {side} {than}: {', '.join(found[side])}" for side in ("more", "less") if found[side]]
    shown += [f"no difference shown: {', '.join(found[''])}"] if found[""] else []
    text = "; ".join(shown)
    return f"{text[0].upper()}{text[1:]}."


def percent(rate: float, sign: str = "") -> str:
    """Format a rate 0..1 as percent."""
    return f"{100 * rate + 0.0:{sign}.1f}"


def _number(value: float, sign: str = "") -> str:
    return f"{value + 0.0:{sign}.1f}"


def with_interval(
    value: float, interval: Sequence[float], sign: str = "", text: Callable[[float, str], str] = percent
) -> str:
    low, high = (text(limit, sign) for limit in interval)
    return f"{text(value, sign)} [{low}, {high}]"


def _difference(row: Row, first: bool) -> str:
    text = _number if row["kind"] == "endless" else percent
    return "-" if first else with_interval(row["paired_difference"], row["paired_ci"], "+", text)


_COMPLETE, _CLEARED = ENDS[COMPLETE], ENDS[CLEARED]
_FAILED = ENDS[CAUGHT], _CLEARED, ENDS[TIMEOUT]
_CAUGHT = "ghosts"  # column of the ghosts caught
_POLICY: dict[str, _Cell] = {"policy": lambda row: short_name(row["policy"])}
_GHOSTS: dict[str, _Cell] = {
    _CAUGHT: lambda row: with_interval(row["ghosts_caught_mean"], row["ghosts_caught_ci"], text=_number),
}
_ENDS: dict[str, _Cell] = {
    **{end.name: lambda row, end=end: percent(row[f"{end.field}_rate"]) for end in _FAILED},  # type: ignore[misc]
    "time s": lambda row: f"{row['time_mean_s']:.1f}",
    "p50 ms": lambda row: f"{row['decision_ms_p50']:.3f}",
    "p99 ms": lambda row: f"{row['decision_ms_p99']:.3f}",
}
_ROUND: dict[str, _Cell] = {
    _COMPLETE.name: lambda row: with_interval(row["completion_rate"], row["completion_ci"]),
    "all but one": lambda row: with_interval(row["all_but_one_rate"], row["all_but_one_ci"]),
    "pellets": lambda row: f"{row['pellets_mean']:.2f}",
}
_ENDLESS: dict[str, _Cell] = {
    "pellets per game": lambda row: with_interval(row["pellets_mean"], row["pellets_ci"], text=_number),
    "median": lambda row: f"{row['pellets_median']:g}",
    "rounds": lambda row: f"{row['rounds_mean']:.2f}",
    "most": lambda row: f"{row['rounds_most']}",
}
_ROUND_MEANING = (
    f"Rates in %, with 95 % intervals. {_COMPLETE.name}: {_COMPLETE.meaning}; all but one: at most one not collected;"
    f" pellets: mean collected; {_CLEARED.name}: {_CLEARED.meaning}; time: mean of all episodes;"
    " p50, p99: one decision, policy only; difference: completion minus that of"
)
_ENDLESS_MEANING = (
    "Endless games: round after round, Clyde faster each time, until the robot is caught. Means with 95 % bootstrap"
    f" intervals. pellets per game: over all rounds; rounds: mean completed; most: in one game; {_CLEARED.name}:"
    f" {_CLEARED.meaning}; {', '.join(end.name for end in _FAILED)} (of a round): how games ended, in %; time:"
    " mean of a whole game; p50, p99: one decision, policy only; difference: pellets per game minus those of"
)
