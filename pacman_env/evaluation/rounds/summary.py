"""Summarize rounds: rates, means, intervals and paired differences, in rows of plain data.

The JSON file of ``pacman-env compare`` has the fields ``schema``, ``version``, ``commit``, ``command``, ``kind``
(``compare``), ``suite`` (null without), ``seed``, ``seeds``, ``preset``, ``execution``, ``maps``, ``policies``,
``config``, ``arguments`` and ``rows``:

- ``seeds``: seed of each round, uint64 in decimal as strings (more digits than some JSON readers support). Round k of
  every row has the k-th seed.
- ``maps``: ``name``, ``source``, ``hash``; generated levels together are one map, with ``start_level``,
  ``num_levels`` and the hash of the first level. ``policies``: ``name`` (as in the rows), ``spec`` (the argument)
  and, of a planner file, ``sha256``.
- ``config`` is the configuration of the first rows.

Rows of a suite also have ``group`` (``test levels`` or ``given maps``), ``ghosts`` and ``worst_tenth`` (see
:func:`worst_tenth`). Every row has ``map`` (null: all maps of the group), ``policy``, ``clyde_speed`` (m/s), ``kind``
(``round``, or ``endless`` for endless games), ``episodes``, ``levels`` (number of different levels), ``pellets`` and
``pellets_least`` (most and fewest in a round); rates 0..1 with 95 % Wilson intervals [low, high]:
``death_rate``/``_ci``, ``timeout_rate``, ``cleared_rate`` (no pellet left, but some lost); means per episode:
``pellets_mean``, ``ghosts_caught_mean``/``_ci`` (bootstrap, stratified by map; 0 without power pellets),
``time_mean_s``; times of one decision of the policy alone, ``decision_ms_p50`` and ``_p99``, and ``decision_ms`` with
more percentiles, over ``decisions_timed`` samples. A row of one map also has the results of its rounds, in the order of
the seeds: ``outcomes`` with ``end`` (a letter each, see ``game/ends.py``), ``collected``, ``time_s`` and, on several
levels, ``level``.

A row of kind ``round`` adds ``completion_rate``/``_ci``, ``all_but_one_rate``/``_ci``, ``pellets_share`` (mean share of
a round's pellets), ``lost_mean``, ``aborts_mean``, ``win_time_mean_s`` (null without a win), and
``paired_difference``/``paired_ci``: completion minus completion of the reference policy, in the same rounds. In a
row of kind ``endless`` an episode is a game of many rounds; it adds ``pellets_ci`` (bootstrap, stratified by map),
``pellets_median``, ``rounds_mean`` and ``rounds_most`` (completed), ``outcomes.rounds``, and
``paired_difference``/``paired_ci``: pellets per game minus pellets per game of the reference policy (paired bootstrap).
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.episodes.statistics import Interval, bootstrapped_mean, paired_difference, wilson
from pacman_env.evaluation.rounds.matchups import Played
from pacman_env.game.ends import CAUGHT, CLEARED, COMPLETE, ENDS, TIMEOUT

SCHEMA = 3
Row = dict[str, Any]
LEAST_ROUNDS = 4  # a level or map with fewer rounds does not count for the worst tenth
_DRAWS = 0  # the same seed for each bootstrap, so that only rounds cause differences
_PERCENTILES = (1, 5, 25, 50, 75, 95, 99, 99.9)


def make_row(
    about: Row, played: Sequence[Played], others: Sequence[NDArray] | None = None, *, endless: bool = False
) -> Row:
    """Return the row of one policy.

    ``about`` are the fields that identify the row, ``played`` its rounds on each map, and ``others`` the records (E,)
    of the policy for comparison on the same maps. Raises ValueError if the seeds of the two differ.
    """
    parts = [records for records, _ in played]
    for ours, theirs in zip(parts, others or parts, strict=True):
        if not np.array_equal(ours["seed"], theirs["seed"]):
            raise ValueError(f"{about}: not the seeds of the policy it is compared with")
    own = _of_games if endless else of_rounds
    row = about | {"kind": "endless" if endless else "round"} | _common(parts) | own(parts, others)
    row |= _decisions(np.concatenate([times for _, times in played]))
    return row | (_outcomes(parts[0], endless) if len(parts) == 1 else {})


def worst_tenth(parts: Sequence[NDArray]) -> Row | None:
    """Return the mean completion of the worst tenth of levels, or of maps if there are several ``parts``.

    Of the m places (``places``: levels or maps) with at least ``LEAST_ROUNDS`` rounds, the worst tenth are the
    ceil(m / 10) places with the lowest completion rate. All have the same weight. ``low`` is too low, most of all with
    few rounds per place, because the same rounds choose the places and measure them. For ``high``, every second round
    of a place chooses and the other rounds measure, then the other way round, and the mean is taken. ``high`` is too
    high, because half of the rounds seldom finds the worst places. Returns None if no place has enough rounds.
    """
    places = parts
    if len(parts) == 1:
        places = [parts[0][parts[0]["level"] == level] for level in np.unique(parts[0]["level"])]
    rounds = [place["end"] == COMPLETE for place in places if len(place) >= LEAST_ROUNDS]
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
    return {"places": len(rounds), "worst": worst, "low": measured(whole, whole), "high": high}


def of_rounds(parts: Sequence[NDArray], others: Sequence[NDArray] | None = None) -> Row:
    """Return the fields of a row of kind ``round``, from the records (E,) on each map."""
    records = np.concatenate(parts)
    complete = records["end"] == COMPLETE
    difference, interval = 0.0, (0.0, 0.0)
    if others is not None:
        difference, interval = paired_difference(complete, np.concatenate(others)["end"] == COMPLETE)
    return {
        **_rate("completion", complete),
        **_rate("all_but_one", records["collected"] >= records["spawned"] - 1),
        "pellets_share": float((records["collected"] / records["spawned"]).mean()),
        **_ends(records),
        "lost_mean": float(records["lost"].mean()),
        "aborts_mean": float(records["aborts"].mean()),
        "win_time_mean_s": float(records["time_s"][complete].mean()) if complete.any() else None,
        "paired_difference": difference,
        "paired_ci": list(interval),
    }


def _of_games(parts: Sequence[NDArray], others: Sequence[NDArray] | None) -> Row:
    records = np.concatenate(parts)
    collected = [part["collected"].astype(np.float64) for part in parts]
    difference, interval = 0.0, (0.0, 0.0)
    if others is not None:
        pairs = [ours - theirs["collected"] for ours, theirs in zip(collected, others, strict=True)]
        difference, interval = _mean(pairs)
    return {
        **_ends(records),
        "pellets_ci": list(_mean(collected)[1]),
        "pellets_median": float(np.median(records["collected"])),
        "rounds_mean": float(records["rounds"].mean()),
        "rounds_most": int(records["rounds"].max()),
        "paired_difference": difference,
        "paired_ci": list(interval),
    }


def _mean(parts: Sequence[NDArray[np.float64]]) -> tuple[float, Interval]:
    return bootstrapped_mean(parts, np.random.default_rng(_DRAWS))


def _rate(name: str, which: NDArray[np.bool_]) -> Row:
    return {f"{name}_rate": float(which.mean()), f"{name}_ci": list(wilson(int(which.sum()), len(which)))}


def _ends(records: NDArray) -> Row:
    shares = {f"{ENDS[end].field}_rate": float((records["end"] == end).mean()) for end in (TIMEOUT, CLEARED)}
    return _rate(ENDS[CAUGHT].field, records["end"] == CAUGHT) | shares


def _common(parts: Sequence[NDArray]) -> Row:
    records = np.concatenate(parts)
    caught, interval = _mean([part["ghosts_caught"].astype(np.float64) for part in parts])
    return {
        "episodes": len(records),
        "levels": len(np.unique(records["level"])),
        "pellets": int(records["spawned"].max()),
        "pellets_least": int(records["spawned"].min()),
        "pellets_mean": float(records["collected"].mean()),
        "ghosts_caught_mean": caught,
        "ghosts_caught_ci": list(interval),
        "time_mean_s": float(records["time_s"].mean()),
    }


def _decisions(decision_ms: NDArray[np.float64]) -> Row:
    percentiles = np.percentile(decision_ms, _PERCENTILES).tolist()
    by_name = {f"p{p:g}": value for p, value in zip(_PERCENTILES, percentiles, strict=True)}
    times = {"decision_ms_p50": by_name["p50"], "decision_ms_p99": by_name["p99"], "decision_ms": by_name}
    return times | {"decisions_timed": len(decision_ms)}


def _outcomes(records: NDArray, endless: bool) -> Row:
    outcomes: dict[str, Any] = {
        "end": "".join(ENDS[end].letter for end in records["end"].tolist()),
        "collected": records["collected"].tolist(),
        "time_s": [round(t, 3) for t in records["time_s"].tolist()],
    }
    if len(np.unique(records["level"])) > 1:
        outcomes["level"] = records["level"].tolist()
    if endless:
        outcomes["rounds"] = records["rounds"].tolist()
    return {"outcomes": outcomes}
