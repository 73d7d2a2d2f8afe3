"""Numbers of a league table, computed from the rounds of its parts, for its JSON and its page.

Rates are 0..1. Shares of rounds have Wilson's interval, and differences of two shares in the same rounds have
Newcombe's interval for pairs; both are 95 %.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Annotated, Literal

import msgspec
import numpy as np
from msgspec import Meta
from numpy.typing import NDArray

from pacman_env.config.validation import AtLeastOne, Count, NotNegative, Share
from pacman_env.episodes.statistics import Interval
from pacman_env.evaluation.leaderboard.suites import Ghosts, Suite
from pacman_env.evaluation.rounds.summary import compare_completion, of_rounds
from pacman_env.game.execution import COMPLETE

SCHEMA: Literal[2] = 2
LEAST_ROUNDS = 4  # least rounds of a place that counts for the worst tenth
Verdict = Literal["better", "not different", "WORSE"]
Difference = Annotated[float, Meta(ge=-1, le=1)]
Group = Annotated[str, Meta(min_length=1)]


class WorstTenth(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Mean completion over the worst tenth of places; the true value is expected between ``low`` and ``high``."""

    places: AtLeastOne  # levels or maps with at least LEAST_ROUNDS rounds
    worst: AtLeastOne  # number of places in the worst tenth
    low: Share  # places chosen and measured by the same rounds
    high: Share  # places chosen by one half of the rounds, measured by the other half


class PolicyInCell(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Results of one policy in one cell."""

    policy: str
    completion_rate: Share
    completion_ci: Interval
    death_rate: Share
    timeout_rate: Share
    cleared_rate: Share  # no pellet left, some lost
    pellets_share: Share  # mean share of a round's pellets that was collected
    worst_tenth: WorstTenth | None  # None: no place has enough rounds
    win_time_mean_s: NotNegative | None  # mean of completed rounds; None: no round was completed
    ghosts_caught_mean: NotNegative | None = None  # in a round; None: of an older version


class Against(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Completion of the planner minus completion of the best other policy, in the same rounds."""

    other: str
    difference: Difference
    ci: tuple[Difference, Difference]
    verdict: Verdict


class CellResult(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Results of all policies in one cell of the table: one list of ghosts at one speed on one group of maps."""

    group: Group
    ghosts: Ghosts
    speed_mps: NotNegative
    rounds: AtLeastOne  # rounds of each policy, on all maps of the group together
    policies: tuple[PolicyInCell, ...]
    against: Against | None  # None: there is no other policy


class PolicyEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A policy of the table and how its rounds were made."""

    name: str
    spec: str  # as given on the command line
    sha256: str | None  # hash of a planner's file
    apart: bool  # not counted among the best others
    command: str  # command that repeats the rounds


class PolicyMean(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Completion of a policy over all cells of a group, each cell with the same weight."""

    group: str
    policy: str
    mean: Share
    least: Share
    least_cell: Count  # index in ``cells``


class MapEntry(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """A map, or levels that count as one map, as returned by ``describe_scenario``."""

    name: str
    hash: str  # hash of the map, or of the first level
    source: str
    start_level: Count | None = None  # None: a map
    num_levels: AtLeastOne | None = None


class LeagueTable(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The JSON of ``pacman-env leaderboard``."""

    schema: Literal[2]  # first field, because other schemas have other fields
    version: str
    commit: str  # commit of the sources
    command: str
    suite: str
    suite_content: Suite
    preset: str
    execution: str
    seed: Count
    maps: tuple[MapEntry, ...]
    planner: str
    policies: tuple[PolicyEntry, ...]
    means: tuple[PolicyMean, ...]
    verdicts: dict[str, Count]  # cells by verdict
    cells: Annotated[tuple[CellResult, ...], Meta(min_length=1)]


def worst_tenth(complete: NDArray[np.bool_], place: NDArray[np.int64]) -> WorstTenth | None:
    """Return the conditional value at risk over places, from (n,) rounds with the level or map of each.

    The worst tenth are the ceil(m / 10) places with the lowest completion of the m places with at least
    ``LEAST_ROUNDS`` rounds; all have the same weight. ``low`` is too low, most of all with few rounds per place,
    because the same rounds choose the places and measure them. ``high`` avoids that: every second round of a place
    chooses and the others measure, then the other way round, and the mean is taken. It is too high, because half of the
    rounds seldom finds the worst places. Returns None if no place has enough rounds.
    """
    rounds = [complete[place == one] for one in np.unique(place)]
    rounds = [one for one in rounds if len(one) >= LEAST_ROUNDS]
    if not rounds:
        return None
    worst = math.ceil(len(rounds) / 10)
    whole, first, second = (
        np.array([one[part].mean() for one in rounds]) for part in (slice(None), slice(0, None, 2), slice(1, None, 2))
    )

    def measured(by: NDArray[np.float64], chosen_by: NDArray[np.float64]) -> float:
        limit = np.sort(chosen_by)[worst - 1]
        below, equal = chosen_by < limit, chosen_by == limit
        weight = below + equal * (worst - below.sum()) / equal.sum()  # equal places share the remaining weight
        return float(np.sum(by * weight) / worst)

    high = (measured(first, second) + measured(second, first)) / 2
    return WorstTenth(len(rounds), worst, measured(whole, whole), high)


def policy_in_cell(policy: str, parts: Sequence[NDArray]) -> PolicyInCell:
    """Return the numbers of a policy from ``parts``, the records of its rounds on each map of the cell."""
    records = np.concatenate(parts)
    complete, caught = records["end"] == COMPLETE, float(records["ghosts_caught"].mean())
    # A place is a map, or a level if the cell has levels.
    places = [part["level"] if len(parts) == 1 else np.full(len(part), k) for k, part in enumerate(parts)]
    row, own = of_rounds(parts), ("policy", "worst_tenth", "ghosts_caught_mean")
    shared = {name: row[name] for name in PolicyInCell.__struct_fields__ if name not in own}
    worst = worst_tenth(complete, np.concatenate(places))
    return PolicyInCell(policy=policy, worst_tenth=worst, ghosts_caught_mean=caught, **shared)


def against(planner: Sequence[NDArray], others: Mapping[str, Sequence[NDArray]]) -> Against | None:
    """Compare the planner's rounds with the rounds of the other policy that completed most (the first one if equal)."""
    complete = {name: sum(int((part["end"] == COMPLETE).sum()) for part in parts) for name, parts in others.items()}
    if not complete:
        return None
    best = max(complete, key=lambda name: complete[name])
    difference, (low, high) = compare_completion(planner, others[best])
    verdict: Verdict = "better" if low > 0 else "WORSE" if high < 0 else "not different"
    return Against(best, difference, (low, high), verdict)


def means(results: Sequence[CellResult]) -> tuple[PolicyMean, ...]:
    """Return the mean and least completion of each policy in each group, over the cells of the group."""
    rows = []
    for group in dict.fromkeys(cell.group for cell in results):
        numbers = [number for number, cell in enumerate(results) if cell.group == group]
        for k, row in enumerate(results[numbers[0]].policies):
            rates = [results[number].policies[k].completion_rate for number in numbers]
            least = int(np.argmin(rates))
            rows.append(PolicyMean(group, row.policy, float(np.mean(rates)), rates[least], numbers[least]))
    return tuple(rows)


def verdicts(results: Sequence[CellResult]) -> dict[str, int]:
    """Return the number of cells for each verdict."""
    all_verdicts = [cell.against.verdict for cell in results if cell.against is not None]
    return {verdict: all_verdicts.count(verdict) for verdict in ("better", "not different", "WORSE")}
