"""League table of a suite's rows, as Markdown: the first policy against the best other one in every cell."""

import itertools
from collections.abc import Iterator, Sequence
from typing import Any

from pacman_env.evaluation.compare.text_table import TextTable, percent, with_interval
from pacman_env.evaluation.rounds.summary import LEAST_ROUNDS, Row

MEANING = f"""\
All policies play the same rounds of a cell: the same maps, seeds and ghosts. Rates are the completed rounds in %,
brackets are 95 % intervals.

- **difference**: completion of the first policy minus completion of the best other policy, in the same rounds, with
  Newcombe's interval for pairs. The verdict is *better* or *WORSE* if the interval excludes 0. The best other policy is
  chosen in each cell by these rounds, which favours it. Against one equal policy, one cell in 40 would be called WORSE
  by chance alone, and more against several.
- **worst tenth** of the levels (of given maps: of the maps, at least one): mean completion of the first policy there,
  over levels with at least {LEAST_ROUNDS} rounds. There are two estimates. The lower one chooses the levels by the
  rounds that also measure them and is too low on average. The higher one chooses them by every second round, measures
  them by the others, and is too high on average. One number is shown if both agree.

The JSON has more for every policy: intervals, how rounds ended, pellets, and the length of completed rounds."""


def cells_of(rows: Sequence[Row]) -> list[list[Row]]:
    """Return one list of rows for each cell; the list has a row for each policy."""
    return [list(g) for _, g in itertools.groupby(rows, key=lambda row: (row["group"], *row["ghosts"], place_of(row)))]


def groups_of(rows: Sequence[Row]) -> dict[str, list[list[Row]]]:
    """Return the cells of each group of maps."""
    return {group: cells_of(list(some)) for group, some in itertools.groupby(rows, key=lambda row: row["group"])}


def ghosts_of(row: Row) -> str:
    """Format the ghosts of a cell: ``2 chase`` or ``arcade, chase, wander``."""
    ghosts = row["ghosts"]
    return f"{len(ghosts)} {ghosts[0]}" if len(set(ghosts)) == 1 else ", ".join(ghosts)


def place_of(row: Row) -> str:
    return f"{ghosts_of(row)}, {row['clyde_speed']:g} m/s"


def headline(rows: Sequence[Row]) -> str:
    """Return a sentence: in how many cells the first policy is better or worse than the best other policy."""
    verdicts = [against_best(cell)[0] for cell in cells_of(rows) if len(cell) > 1]
    counts = ", ".join(f"{one} in {verdicts.count(one)}" for one in ("better", "not different", "WORSE"))
    cells = _count(len(cells_of(rows)), "cell")
    first = f"`{rows[0]['policy']}`"
    return f"{first} against the best other policy in {cells}: {counts}." if verdicts else f"{first} in {cells}."


def against_best(cell: Sequence[Row]) -> tuple[str, str]:
    """Compare the first policy with the best other policy, which has the highest completion rate of the others.

    Return the verdict on the first policy, and its rate minus the best other rate, with the difference's interval.
    """
    best = max(cell[1:], key=lambda row: row["completion_rate"])
    low, high = (-limit for limit in reversed(best["paired_ci"]))
    verdict = "better" if low > 0 else "WORSE" if high < 0 else "not different"
    return verdict, with_interval(-best["paired_difference"], (low, high), "+")


ABOUT_MEANS = "Completion over all cells of a group, each cell counting the same, and the cell in which it is least:"


def means(rows: Sequence[Row]) -> TextTable:
    """Return a table with the mean and the lowest completion rate of each policy in each group of maps.

    Every cell (a line-up of ghosts at one speed) counts equally. The table also names the cell of the lowest rate.
    """
    texts = []
    for group, cells in groups_of(rows).items():
        for of_policy in zip(*cells, strict=True):
            rates = [row["completion_rate"] for row in of_policy]
            least = min(of_policy, key=lambda row: row["completion_rate"])
            mean, lowest = percent(sum(rates) / len(rates)), percent(least["completion_rate"])
            texts.append((group, f"`{least['policy']}`", mean, lowest, place_of(least)))
    return TextTable(("maps", "policy", "mean", "least", "in"), "llrrl", texts)


def cell_table(cells: Sequence[Sequence[Row]]) -> TextTable:
    """Return a table of one group's cells: completion rates of all policies, and the verdict on the first policy."""
    names = [f"`{row['policy']}`" for row in cells[0]]
    compared = len(names) > 1
    rows = []
    for cell in cells:
        texts = [ghosts_of(cell[0]), f"{cell[0]['clyde_speed']:g}", *(percent(row["completion_rate"]) for row in cell)]
        if compared:
            verdict, difference = against_best(cell)
            texts.append(f"{f'**{verdict}**' if verdict == 'WORSE' else verdict}: {difference}")
        rows.append([*texts, _worst(cell[0]["worst_tenth"])])
    head = ["ghosts", "m/s", *names, *([f"{names[0]} against the best other"] if compared else []), "worst tenth"]
    return TextTable(head, "lr" + "r" * len(names) + "l" * compared + "r", rows)


def about_group(content: dict[str, Any], cell: Sequence[Row]) -> str:
    """Return a sentence with the maps and the number of rounds of a group of cells."""
    rounds = f"{_count(cell[0]['episodes'], 'round')} a cell and policy"
    levels = next(place for place in content["maps"] if "num_levels" in place)
    if cell[0]["map"] == levels["name"]:
        number = _count(levels["num_levels"], "level")
        return f"Generated houses of the test split, {number} from {levels['start_level']} on; {rounds}."
    names = ", ".join(f"`{place['name']}`" for place in content["maps"] if place is not levels)
    return f"{names}; {rounds}, as many on each map."


def summary(rows: Sequence[Row]) -> list[str]:
    """Return the paragraphs of the summary."""
    return [headline(rows), ABOUT_MEANS, markdown(means(rows))]


def tables(content: dict[str, Any]) -> Iterator[str]:
    """Yield for each group of maps a heading, a sentence about its rounds and the table of its cells, as Markdown."""
    for group, cells in groups_of(content["rows"]).items():
        yield f"## {group[0].upper()}{group[1:]}"
        yield about_group(content, cells[0])
        yield markdown(cell_table(cells))


def render(content: dict[str, Any], picture: str) -> str:
    """Return the page, which ends with a line break; ``picture`` is the name of the heat map next to it."""
    rows = content["rows"]
    dirty = "+" if content["commit"].endswith("+") else ""
    made = (
        f"Suite `{content['suite']}`, {_count(len(cells_of(rows)), 'cell')}, seed {content['seed']}, preset"
        f" {content['preset']}, execution {content['execution']}, version {content['version']}, commit"
        f" `{content['commit'].rstrip('+')[:12]}{dirty}`. Do not edit this page: it was written by"
    )
    files = [(f"`{one['name']}`", f"`{one['sha256']}`" if "sha256" in one else "-") for one in content["policies"]]
    places = [(f"`{place['name']}`", f"`{place['hash']}`") for place in content["maps"]]
    blocks = [
        *("# League table", made, f"```bash\n{content['command']}\n```", "## Summary", *summary(rows)),
        f"![Completion of every policy, by ghosts and speed]({picture})",
        *("## What the numbers are", MEANING, *tables(content), "## How it was made"),
        markdown(TextTable(("policy", "file's SHA-256"), "ll", files)),
        *(["A + means changes that were not committed."] if dirty else []),
        "Maps and their hashes; of generated levels that of the first:",
        markdown(TextTable(("map", "hash"), "ll", places)),
    ]
    return "\n\n".join(blocks) + "\n"


def markdown(table: TextTable) -> str:
    """Return the table as Markdown, whose source text has aligned columns."""
    clean = [[cell.replace("|", "\\|") for cell in row] for row in table.rows]
    head, *rows = table._replace(rows=clean).padded(least=3)
    rule = ["-" * (len(cell) - 1) + ("-" if side == "l" else ":") for cell, side in zip(head, table.align, strict=True)]
    return "\n".join(f"| {' | '.join(line)} |" for line in (head, rule, *rows))


def _worst(worst: dict[str, float] | None) -> str:
    if worst is None:
        return "-"
    low, high = map(percent, sorted((worst["low"], worst["high"])))  # by chance, low may be above high
    return low if low == high else f"{low} to {high}"


def _count(number: int, noun: str) -> str:
    return f"{number:,} {noun}{'' if number == 1 else 's'}"
