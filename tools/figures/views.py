"""Write the figures of a page from stored results.

A page marks the place of a figure with ``<!-- figure: NAME/VIEW WORDS -->`` and ``<!-- end -->``: NAME is a
measurement, VIEW one of :data:`VIEWS`, and WORDS select a policy, a map and a speed.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pacman_env.evaluation.compare.text_table import percent, render
from tools import scores

Record = Mapping[str, Any]  # one measurement in docs/figures.json
Records = Mapping[str, Record]

BLOCK = re.compile(r"(<!-- figure: (\S+)/([\w-]+)((?: [\w.:-]+)*) -->)(.*?)(<!-- end -->)", re.DOTALL)
_WIDTH = 150  # of the terminal's table, in characters


def filled(page: str, records: Records) -> str:
    """Return a page with its figures; raises ValueError for a figure that is not measured or a view that is unknown."""

    def fill(match: re.Match[str]) -> str:
        start, name, view, words, _, end = match.groups()
        if view not in VIEWS:
            raise ValueError(f"figure {name}/{view}: no such view: choose from {', '.join(VIEWS)}")
        if name not in records:
            raise ValueError(f"figure {name}/{view}: not measured: scripts/figures {name}")
        text = VIEWS[view](name, records, words.split())
        return f"{start}\n\n{text.strip()}\n\n{end}" if "\n" in text else f"{start}{text}{end}"

    return BLOCK.sub(fill, page)


def _stamp(name: str, records: Records, words: Sequence[str]) -> str:
    shown = records[name]
    return f"{shown['version']} at {shown['commit'][:8]}, {shown['date']}, {shown['machine']}"


def _chosen(rows: Sequence[Record], words: Sequence[str]) -> list[Record]:
    """Return the rows of a policy, a map or a speed that ``words`` name, in any order."""
    for word in words:
        rows = [row for row in rows if word in (row["policy"], row["map"], f"{row['clyde_speed']:.2f}")]
    if not rows:
        raise ValueError(f"no row of {' '.join(words)}")
    return list(rows)


def _share(name: str, records: Records, words: Sequence[str]) -> str:
    (row,) = _chosen(records[name]["values"], words)
    return f"{percent(row['completion_rate'])} % [{', '.join(map(percent, row['completion_ci']))}]"


def _terminal(name: str, records: Records, words: Sequence[str]) -> str:
    """Return the table and the verdict that ``pacman-env compare`` prints, without the legend."""
    lines = render(records[name]["values"], _WIDTH).split("\n\n")
    return "\n".join(["```", *"\n\n".join(lines[:2]).splitlines(), "```"])


def _rate(name: str, records: Records, words: Sequence[str]) -> str:
    """Return decisions or simulated seconds per second of the row with 64 games of an id: ``rate Flat decisions``."""
    env, unit = words
    rows = records[name]["values"]["rows"]
    (row,) = (row for title, row in rows.items() if title.startswith(f"{env}, make_vec, N = 64, random"))
    return f"{round(row[f'{unit}_per_s'], -2):,.0f}"


def _learned_range(name: str, records: Records, words: Sequence[str]) -> str:
    """Return the lowest and highest completion over the seeds in new houses, of the model or of ``words[0]``."""
    row = rf"  {words[0]} ([\d.]+) %" if words else r"generated:test: ([\d.]+) \["
    rates = []
    for printed in records[name]["values"].values():
        found = re.search(row, "\n".join(printed))  # generated:test comes before house
        assert found
        rates.append(round(float(found[1])))
    return " to ".join(str(rate) for rate in sorted({min(rates), max(rates)})) + " %"


def _all_ids(name: str, records: Records, words: Sequence[str]) -> str:
    return scores.overview(scores.read(records))


View = Callable[[str, Records, Sequence[str]], str]
VIEWS: dict[str, View] = {
    view.__name__[1:].replace("_", "-"): view for view in (_stamp, _share, _terminal, _rate, _learned_range, _all_ids)
}
