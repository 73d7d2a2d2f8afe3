"""Page of a league table: Markdown from its JSON alone, the same text for the same numbers."""

import itertools
from collections.abc import Iterator, Sequence

from pacman_env.evaluation.compare.table import percent, with_interval
from pacman_env.evaluation.leaderboard.numbers import LEAST_ROUNDS, CellResult, LeagueTable, PolicyInCell
from pacman_env.evaluation.leaderboard.suites import TEST_LEVELS

_MEANING = f"""\
All policies play the same rounds of a cell: the same maps, seeds and ghosts. Rates are the completed rounds in %,
brackets are 95 % intervals.

- **difference**: completion of the planner minus completion of the best other policy, in the same rounds, with
  Newcombe's interval for pairs. The verdict is *better* or *WORSE* if the interval excludes 0. The best other policy is
  chosen in each cell by these rounds, which favours it. Against one equal policy, one cell in 40 would be called WORSE
  by chance alone, and more against several.
- **worst tenth** of the levels (of given maps: of the maps, at least one): mean completion of the planner there, over
  levels with at least {LEAST_ROUNDS} rounds. There are two estimates. The lower one chooses the levels by the rounds
  that also measure them and is too low on average. The higher one chooses them by every second round, measures them by
  the others, and is too high on average. One number is shown if both agree.

The JSON has more for every policy: intervals, how rounds ended, pellets, and the length of completed rounds."""


def render(table: LeagueTable, picture: str) -> str:
    """Return the page, which ends with a line break; ``picture`` is the name of the heat map next to it."""
    blocks = [
        *_head(table),
        "## Summary",
        *_summary(table),
        f"![Completion of every policy, by ghosts and speed]({picture})",
        "## What the numbers are",
        _MEANING,
        *itertools.chain.from_iterable(_group(table, group) for group in groups(table)),
        "## How it was made",
        *_how(table),
    ]
    return "\n\n".join(blocks) + "\n"


def groups(table: LeagueTable) -> list[str]:
    """Return the groups of maps, in the order of the table."""
    return list(dict.fromkeys(cell.group for cell in table.cells))


def _head(table: LeagueTable) -> list[str]:
    dirty = "+" if table.commit.endswith("+") else ""
    made = (
        f"Suite `{table.suite}`, {_count(len(table.cells), 'cell')}, seed {table.seed}, preset {table.preset},"
        f" execution {table.execution}, version {table.version}, commit"
        f" `{table.commit.rstrip('+')[:12]}{dirty}`. Do not edit this page: it was written by"
    )
    return ["# League table", made, f"```bash\n{table.command}\n```"]


def _summary(table: LeagueTable) -> Iterator[str]:
    if table.cells[0].against is not None:
        apart = [f"`{entry.name}`" for entry in table.policies if entry.apart]
        beside = f" ({', '.join(apart)} {'is' if len(apart) == 1 else 'are'} reported apart)" if apart else ""
        counts = ", ".join(f"{verdict} in {number}" for verdict, number in table.verdicts.items())
        cells = _count(len(table.cells), "cell")
        yield f"`{table.planner}` against the best other policy{beside} in {cells}: {counts}."
    yield "Completion over all cells of a group, each cell counting the same, and the cell in which it is least:"
    rows = [
        (row.group, f"`{row.policy}`", percent(row.mean), percent(row.least), _place(table.cells[row.least_cell]))
        for row in table.means
    ]
    yield _markdown(("maps", "policy", "mean", "least", "in"), "llrrl", rows)


def _place(cell: CellResult) -> str:
    return f"{ghosts_of(cell)}, {cell.speed_mps:g} m/s"


def ghosts_of(cell: CellResult) -> str:
    """Format the ghosts of a cell: ``2 chase`` or ``arcade, chase, wander``."""
    kinds = set(cell.ghosts)
    return f"{len(cell.ghosts)} {cell.ghosts[0]}" if len(kinds) == 1 else ", ".join(cell.ghosts)


def _group(table: LeagueTable, group: str) -> Iterator[str]:
    cells = [cell for cell in table.cells if cell.group == group]
    yield f"## {group[0].upper()}{group[1:]}"
    yield _about_group(table, cells)
    yield _cells(table, cells)


def _about_group(table: LeagueTable, cells: Sequence[CellResult]) -> str:
    names = [f"`{place.name}`" for place in table.maps if place.num_levels is None]
    rounds = f"{_count(cells[0].rounds, 'round')} a cell and policy"
    if cells[0].group == TEST_LEVELS:
        first, number = next((p.start_level, p.num_levels) for p in table.maps if p.num_levels is not None)
        return f"Generated houses of the test split, {_count(number, 'level')} from {first} on; {rounds}."
    return f"{', '.join(names)}; {rounds}, as many on each map."


def _cells(table: LeagueTable, cells: Sequence[CellResult]) -> str:
    compared = cells[0].against is not None
    policies = [entry.name for entry in table.policies]
    rows = []
    for cell in cells:
        rates = {row.policy: percent(row.completion_rate) for row in cell.policies}
        ours = next(row for row in cell.policies if row.policy == table.planner)
        row = [ghosts_of(cell), f"{cell.speed_mps:g}", *(rates[name] for name in policies)]
        if cell.against is not None:
            verdict = f"**{cell.against.verdict}**" if cell.against.verdict == "WORSE" else cell.against.verdict
            row += [f"{verdict}: {with_interval(cell.against.difference, cell.against.ci, '+')}"]
        rows.append([*row, _worst(ours)])
    names = [f"`{name}`" for name in policies]
    against = [f"`{table.planner}` against the best other"] if compared else []
    head = ["ghosts", "m/s", *names, *against, "worst tenth"]
    return _markdown(head, "lr" + "r" * len(names) + "l" * compared + "r", rows)


def _worst(row: PolicyInCell) -> str:
    if row.worst_tenth is None:
        return "-"
    low, high = map(percent, sorted((row.worst_tenth.low, row.worst_tenth.high)))  # by chance, low may be above high
    return low if low == high else f"{low} to {high}"


def _how(table: LeagueTable) -> Iterator[str]:
    yield "Each policy alone, with the same rounds as above:"
    yield "```bash\n" + "\n".join(entry.command for entry in table.policies) + "\n```"
    rows = [(f"`{one.name}`", "-" if one.sha256 is None else f"`{one.sha256}`") for one in table.policies]
    yield _markdown(("policy", "file's SHA-256"), "ll", rows)
    if table.commit.endswith("+"):
        yield "A + means changes that were not committed."
    places = [(f"`{place.name}`", f"`{place.hash}`") for place in table.maps]
    yield "Maps and their hashes; of generated levels that of the first:"
    yield _markdown(("map", "hash"), "ll", places)
    settings = table.suite_content.settings
    if settings:
        yield "Settings of the suite: " + ", ".join(f"`{name}={value}`" for name, value in settings.items()) + "."


def _count(number: int, noun: str) -> str:
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def _markdown(head: Sequence[str], align: str, rows: Sequence[Sequence[str]]) -> str:
    """Return a Markdown table with an aligned source; ``align`` contains l or r for each column."""
    clean = [[cell.replace("|", "\\|") for cell in row] for row in rows]
    widths = [max(3, *map(len, column)) for column in zip(head, *clean, strict=True)]

    def line(cells: Sequence[str]) -> str:
        parts = (c.ljust(w) if a == "l" else c.rjust(w) for c, w, a in zip(cells, widths, align, strict=True))
        return f"| {' | '.join(parts)} |"

    rule = ("-" * w if a == "l" else "-" * (w - 1) + ":" for w, a in zip(widths, align, strict=True))
    return "\n".join([line(head), f"| {' | '.join(rule)} |", *map(line, clean)])
