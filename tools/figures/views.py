"""Write the figures of a page from stored results.

A page marks the place of a figure with ``<!-- figure: NAME/VIEW WORDS -->`` and ``<!-- end -->``: NAME is a
measurement, VIEW one of :data:`VIEWS`, and WORDS select a policy, a map and a speed.
"""

import math
import re
import statistics
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from pacman_env.envs.registration import IDS
from pacman_env.episodes.statistics import paired_difference, wilson
from pacman_env.evaluation import benchmark
from pacman_env.evaluation.compare.table import percent, render, with_interval
from tools import scores
from tools.common import table

Record = Mapping[str, Any]  # one measurement in docs/figures.json
Records = Mapping[str, Record]
Row = Mapping[str, Any]

BLOCK = re.compile(r"(<!-- figure: (\S+)/([\w-]+)((?: [\w.:-]+)*) -->)(.*?)(<!-- end -->)", re.DOTALL)
_WIDTH = 150  # of the terminal's table, in characters
_NAV2_HZ = 20.0  # controller_frequency in config/nav2.yaml


def filled(page: str, records: Records) -> str:
    """Return a page with its figures; raises ValueError for a figure that is not measured or a view that is unknown."""

    def fill(match: re.Match[str]) -> str:
        start, name, view, words, _, end = match.groups()
        if view not in VIEWS:
            raise ValueError(f"figure {name}/{view}: no such view: choose from {', '.join(VIEWS)}")
        if name not in records and name != "ids":
            raise ValueError(f"figure {name}/{view}: not measured: scripts/figures {name}")
        text = VIEWS[view](name, records, words.split())
        return f"{start}\n\n{text.strip()}\n\n{end}" if "\n" in text else f"{start}{text}{end}"

    return BLOCK.sub(fill, page)


def _stamp(name: str, records: Records, words: Sequence[str]) -> str:
    shown = records[name] if name in records else records[f"ids/{next(iter(IDS)).split('/')[1]}"]
    later = "".join(f"; `{row}`: {stamp}" for row, stamp in shown.get("later", {}).items())  # rows of another version
    return f"{shown['version']} at {shown['commit'][:8]}, {shown['date']}, {shown['machine']}{later}"


def _command(name: str, records: Records, words: Sequence[str]) -> str:
    return f"`{records[name]['command']}`"


def _chosen(rows: Sequence[Row], words: Sequence[str]) -> list[Row]:
    """Return the rows of a policy, a map or a speed that ``words`` name, in any order."""
    for word in words:
        rows = [row for row in rows if word in (row["policy"], row["map"], f"{row['clyde_speed']:.2f}")]
    if not rows:
        raise ValueError(f"no row of {' '.join(words)}")
    return list(rows)


def _share(name: str, records: Records, words: Sequence[str]) -> str:
    (row,) = _chosen(records[name]["values"], words)
    return f"{percent(row['completion_rate'])} % [{', '.join(map(percent, row['completion_ci']))}]"


def _mean(name: str, records: Records, words: Sequence[str]) -> str:
    return percent(_mean_rate(_chosen(records[name]["values"], words)))


def _mean_rate(rows: Sequence[Row]) -> float:
    return statistics.fmean(row["completion_rate"] for row in rows)


def _seconds(name: str, records: Records, words: Sequence[str]) -> str:
    (row,) = _chosen(records[name]["values"], words)
    return f"{row['win_time_mean_s']:.0f}"


def _terminal(name: str, records: Records, words: Sequence[str]) -> str:
    """Return the table and the verdict that ``pacman-env compare`` prints, without the legend."""
    lines = render(records[name]["values"], _WIDTH).split("\n\n")
    return "\n".join(["```", *"\n\n".join(lines[:2]).splitlines(), "```"])


def _by_map(name: str, records: Records, words: Sequence[str]) -> str:
    """Return the completion of each policy on each map: a column per speed with all policies."""
    rows = records[name]["values"]
    policies, maps, speeds = ([*dict.fromkeys(row[key] for row in rows)] for key in ("policy", "map", "clyde_speed"))

    def cell(chosen: Callable[[Row], bool]) -> list[str]:
        shown = [row for row in rows if chosen(row)]
        columns = ([_mean_rate(_chosen(shown, [one, f"{speed:.2f}"])) for one in policies] for speed in speeds)
        return [", ".join(percent(rate).removesuffix(".0") for rate in column) for column in columns]

    heads = [f"{speed:.2f} m/s" for speed in speeds]
    heads[0] += ": " + ", ".join(f"`{policy}`" for policy in policies)
    lines = [[f"`{place}`", *cell(lambda row, place=place: row["map"] == place)] for place in maps]  # type: ignore[misc]
    return table(["map", *heads], [*lines, ["**mean**", *cell(lambda row: True)]])


def _text(name: str, records: Records, words: Sequence[str]) -> str:
    return str(records[name]["values"])


def _goals(name: str, records: Records, words: Sequence[str]) -> str:
    """Return the main quantities of the comparison with recorded goals."""
    shown = ("quantity", "---", "travel time, s", "goals that pre-empt another", "path length", "within")
    lines = records[name]["values"].splitlines()
    return "\n".join(line for line in lines if any(text in line for text in shown))


def _speed(name: str, records: Records, words: Sequence[str]) -> str:
    return "\n".join(benchmark.table(records[name]["values"]))


def _rate(name: str, records: Records, words: Sequence[str]) -> str:
    """Return decisions or simulated seconds per second of the row with 64 games of an id: ``rate Flat decisions``."""
    env, unit = words
    rows = records[name]["values"]["rows"]
    (row,) = (row for title, row in rows.items() if title.startswith(f"{env}, make_vec, N = 64, random"))
    return f"{round(row[f'{unit}_per_s'], -2):,.0f}"


def _scores(name: str, records: Records, words: Sequence[str]) -> str:
    return scores.all_scores()


def _differences(name: str, records: Records, words: Sequence[str]) -> str:
    """Return the completion in the rounds of ``house``, with the settings of this measurement, and the difference."""
    lines = []
    for row in records[name]["values"]:
        (base,) = _chosen(records["house"]["values"], [row["policy"], f"{row['clyde_speed']:.2f}"])
        ends = [np.array(list(one["ends"][: row["episodes"]])) == "C" for one in (row, base)]
        rates = f"{percent(ends[1].mean())} to {percent(row['completion_rate'])}"
        difference = with_interval(*paired_difference(*ends), "+")
        lines.append([f"`{row['policy']}`", f"{row['clyde_speed']:.2f}", rates, difference])
    return table(("policy", "Clyde, m/s", "completed, %", "difference, points"), lines)


def _driven(name: str, records: Records, words: Sequence[str]) -> str:
    """Return a table of recorded rounds by the real Nav2 and of simulated rounds on the same map.

    Rounds in which Nav2's controller was late in less than a hundredth of its cycles have a row of their own.
    """
    rounds, lines = records[name]["values"], []
    for place, policy in dict.fromkeys((one["map"], one["policy"]) for one in rounds):
        ours = [one for one in rounds if (one["map"], one["policy"]) == (place, policy)]
        counted = [one for one in ours if one["late_cycles"]]  # older rows have no count
        on_time = [one for one in counted if int(one["late_cycles"]) < 0.01 * _NAV2_HZ * float(one["time_s"])]
        for driver, driven in (("Nav2", ours if len(on_time) < len(ours) else []), ("Nav2, on time", on_time)):
            if driven:
                lines.append([f"`{place}`", f"`{policy}`", driver, *_summary(driven)])
        simulated_rounds = records["house" if place == "house" else "real_maps"]["values"]
        (row,) = _chosen(simulated_rounds, [place, policy, f"{float(ours[0]['clyde_mps']):.2f}"])
        simulated = with_interval(row["completion_rate"], row["completion_ci"]), f"{row['win_time_mean_s']:.0f}"
        lines.append([f"`{place}`", f"`{policy}`", "simulator", f"{row['episodes']:,}", *simulated, "", "", "", ""])
    heads = ("map", "policy", "driven by", "rounds", "complete, %", "a completed round, s", "goals a round")
    return table((*heads, "failed goals", "bumps", "AMCL, m: rms, most"), lines)


def _summary(rounds: Sequence[Mapping[str, str]]) -> list[str]:
    """Return the cells of recorded rounds: their number, completion, times, goals, failures, errors of AMCL."""
    won = [float(one["time_s"]) for one in rounds if one["end"] == "complete"]
    goals, aborted, bumps = (sum(int(one[key]) for one in rounds) for key in ("goals", "aborted", "bumps"))
    error_m = math.sqrt(statistics.fmean(float(one["amcl_rms_m"]) ** 2 for one in rounds))
    most_m = max(float(one["amcl_most_m"]) for one in rounds)
    return [
        str(len(rounds)), _completed(len(won), len(rounds)),
        f"{statistics.median(won):.0f} ({min(won):.0f} to {max(won):.0f})", f"{goals / len(rounds):.0f}",
        str(aborted), str(bumps), f"{error_m:.3f}, {most_m:.2f}",
    ]  # fmt: skip


def _nodes(name: str, records: Records, words: Sequence[str]) -> str:
    """Return a table of rounds that the ROS nodes played in lock-step and of rounds in the simulator."""
    lines = []
    for one in records[name]["values"]:
        (row,) = _chosen(records["house"]["values"], [one["policy"], f"{float(one['clyde_mps']):.2f}"])
        played = _completed(int(one["complete"]), int(one["rounds"]))
        simulated = with_interval(row["completion_rate"], row["completion_ci"])
        lines.append([f"`{one['policy']}`", one["clyde_mps"], one["rounds"], played, simulated])
    return table(("policy", "Clyde, m/s", "rounds by nodes", "nodes, complete, %", "simulator, complete, %"), lines)


def _power(name: str, records: Records, words: Sequence[str]) -> str:
    """Return completion without and with power pellets, and the ghosts caught per round with them."""
    rows, lines = records[name]["values"], []
    policies = [*dict.fromkeys(row["policy"] for row in rows)]
    for ghosts in dict.fromkeys(row["ghosts"] for row in rows):
        cells = []
        for policy in policies:
            without, with_ = (row for row in rows if row["ghosts"] == ghosts and row["policy"] == policy)
            rates = f"{percent(without['completion_rate'])} to {percent(with_['completion_rate'])}"
            cells.append(f"{rates}; {with_['ghosts_caught_mean']:.2f}")
        lines.append([ghosts.replace(",", ", "), *cells])
    return table(("ghosts", *(f"`{policy}`" for policy in policies)), lines)


def _learned(name: str, records: Records, words: Sequence[str]) -> str:
    """Return the completed rounds of stock MaskablePPO: a row for each seed, a column for each map."""
    lines = []
    for seed, printed in records[name]["values"].items():
        shares = [
            line.split(": ")[1].split(" % of ")[0] for line in printed if line.endswith("] % of 400 rounds completed")
        ]
        lines.append([seed.removeprefix("--seed "), *shares])
    return table(("Seed", "`generated:test`, %", "`house`, %"), lines)


def _learned_range(name: str, records: Records, words: Sequence[str]) -> str:
    """Return the lowest and highest completion over the seeds in new houses, of the model or of ``words[0]``."""
    row = rf"  {words[0]} ([\d.]+) %" if words else r"generated:test: ([\d.]+) \["
    rates = []
    for printed in records[name]["values"].values():
        found = re.search(row, "\n".join(printed))  # generated:test comes before house
        assert found
        rates.append(round(float(found[1])))
    return " to ".join(str(rate) for rate in sorted({min(rates), max(rates)})) + " %"


def _completed(complete: int, rounds: int) -> str:
    return with_interval(complete / rounds, wilson(complete, rounds))


View = Callable[[str, Records, Sequence[str]], str]
VIEWS: dict[str, View] = {
    "stamp": _stamp,
    "command": _command,
    "share": _share,
    "mean": _mean,
    "seconds": _seconds,
    "terminal": _terminal,
    "by-map": _by_map,
    "text": _text,
    "goals": _goals,
    "speed": _speed,
    "rate": _rate,
    "scores": _scores,
    "differences": _differences,
    "power": _power,
    "learned": _learned,
    "learned-range": _learned_range,
    "nav2": _driven,
    "nodes": _nodes,
}
