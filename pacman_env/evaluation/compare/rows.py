"""The results of one policy on one map at one of Clyde's speeds: a row of plain numbers.

The JSON of ``pacman-env compare`` is ``{"schema": 2, "version", "kind", "seed", "seeds", "preset", "execution", "maps",
"policies", "arguments", "config", "rows"}``:

- ``kind``: ``round``, or ``endless`` for endless games; all rows are of this kind.
- ``seeds``: of each round, uint64 in decimal as strings (more digits than some readers of JSON keep). Round k of
  every row has the k-th.
- ``maps``: ``name``, ``source``, ``hash``; generated levels together are one map, with ``start_level``,
  ``num_levels`` and the hash of the first. ``policies``: ``name`` (as in the rows) and ``spec`` (as was asked for).
- ``config`` is that of the first of Clyde's speeds.

Every row holds ``map``, ``policy``, ``clyde_speed`` (m/s), ``kind``, ``episodes``, ``levels`` (how many were played
on), ``pellets`` and ``pellets_least`` (most and least of a round); rates 0..1 with 95 % Wilson intervals
[low, high]: ``death_rate``/``_ci``, ``timeout_rate``, ``cleared_rate`` (no pellet left, some lost); means per episode:
``pellets_mean``, ``time_mean_s``; times of one decision of the policy alone, ``decision_ms_p50`` and ``_p99``, and
``decision_ms`` with more percentiles, over ``decisions_timed`` samples; and what comes of the rounds, one after the
other as the seeds: ``outcomes`` with ``end`` (a letter each, ``ENDS``: C complete, L cleared but some lost, D caught,
T time-out), ``collected``, ``time_s`` and, on several levels, ``level``.

A row of kind ``round`` adds ``completion_rate``/``_ci``, ``all_but_one_rate``/``_ci``, ``lost_mean``, ``aborts_mean``,
``win_time_mean_s`` (null without a win), and ``paired_difference``/``paired_ci``: completion minus that of the first
policy in the same rounds. In a row of kind ``endless`` an episode is a game of many rounds; it adds ``pellets_ci``
(bootstrap), ``pellets_median``, ``rounds_mean`` and ``rounds_most`` (completed), ``outcomes.rounds``, and
``paired_difference``/``paired_ci``: pellets per game minus those of the first policy (paired bootstrap).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.episodes.statistics import bootstrapped_mean, paired_difference, wilson
from pacman_env.game.execution import CLEARED, COMPLETE, DEAD, TIMEOUT

Row = dict[str, Any]
ENDS = {COMPLETE: "C", CLEARED: "L", DEAD: "D", TIMEOUT: "T"}
_PERCENTILES = (1, 5, 25, 50, 75, 95, 99, 99.9)


def make_row(
    *,
    map_name: str,
    policy: str,
    clyde_speed: float,
    records: NDArray,
    decision_ms: NDArray[np.float64],
    first: NDArray | None = None,
    endless: bool = False,
) -> Row:
    """The row of one policy; rates are 0..1, intervals [low, high] at 95 %.

    Args:
        map_name: the map.
        policy: the policy as named in results.
        clyde_speed: m/s.
        records: (E,) of type ``pacman_env.episodes.rollout.EPISODE``.
        decision_ms: (T,) times of single decisions.
        first: (E,) records of the policy to compare with, in the same seeds; None: this is that policy.
        endless: the records are of endless games.

    Raises:
        ValueError: the two policies were not given the same seeds.
    """
    if first is not None and not np.array_equal(first["seed"], records["seed"]):
        raise ValueError(f"{policy} on {map_name}: not the seeds of the policy it is compared with")
    about = {"map": map_name, "policy": policy, "clyde_speed": clyde_speed, "kind": "endless" if endless else "round"}
    own = _of_games(records, first) if endless else _of_rounds(records, first)
    return about | _common(records) | own | _decisions(decision_ms) | {"outcomes": _outcomes(records, endless)}


def _common(records: NDArray) -> Row:
    episodes = len(records)
    dead = records["end"] == DEAD
    return {
        "episodes": episodes,
        "levels": len(np.unique(records["level"])),
        "pellets": int(records["spawned"].max()),
        "pellets_least": int(records["spawned"].min()),
        "pellets_mean": float(records["collected"].mean()),
        "death_rate": float(dead.mean()),
        "death_ci": list(wilson(int(dead.sum()), episodes)),
        "timeout_rate": float((records["end"] == TIMEOUT).mean()),
        "cleared_rate": float((records["end"] == CLEARED).mean()),
        "time_mean_s": float(records["time_s"].mean()),
    }


def _of_rounds(records: NDArray, first: NDArray | None) -> Row:
    episodes = len(records)
    complete = records["end"] == COMPLETE
    all_but_one = records["collected"] >= records["spawned"] - 1
    difference, interval = 0.0, (0.0, 0.0)
    if first is not None:
        difference, interval = paired_difference(complete, first["end"] == COMPLETE)
    return {
        "completion_rate": float(complete.mean()),
        "completion_ci": list(wilson(int(complete.sum()), episodes)),
        "all_but_one_rate": float(all_but_one.mean()),
        "all_but_one_ci": list(wilson(int(all_but_one.sum()), episodes)),
        "lost_mean": float(records["lost"].mean()),
        "aborts_mean": float(records["aborts"].mean()),
        "win_time_mean_s": float(records["time_s"][complete].mean()) if complete.any() else None,
        "paired_difference": difference,
        "paired_ci": list(interval),
    }


def _of_games(records: NDArray, first: NDArray | None) -> Row:
    collected = records["collected"].astype(np.float64)
    difference, interval = 0.0, (0.0, 0.0)
    if first is not None:
        difference, interval = bootstrapped_mean([collected - first["collected"]], _rng())
    return {
        "pellets_ci": list(bootstrapped_mean([collected], _rng())[1]),
        "pellets_median": float(np.median(collected)),
        "rounds_mean": float(records["rounds"].mean()),
        "rounds_most": int(records["rounds"].max()),
        "paired_difference": difference,
        "paired_ci": list(interval),
    }


def _rng() -> np.random.Generator:
    """The same draws for each interval: rows differ by what was played alone."""
    return np.random.default_rng(0)


def _decisions(decision_ms: NDArray[np.float64]) -> Row:
    percentiles = np.percentile(decision_ms, _PERCENTILES).tolist()
    by_name = {f"p{p:g}": value for p, value in zip(_PERCENTILES, percentiles, strict=True)}
    return {
        "decision_ms_p50": by_name["p50"],
        "decision_ms_p99": by_name["p99"],
        "decision_ms": by_name,
        "decisions_timed": len(decision_ms),
    }


def _outcomes(records: NDArray, endless: bool) -> dict[str, Any]:
    outcomes: dict[str, Any] = {
        "end": "".join(ENDS[end] for end in records["end"].tolist()),
        "collected": records["collected"].tolist(),
        "time_s": [round(t, 3) for t in records["time_s"].tolist()],
    }
    if len(np.unique(records["level"])) > 1:
        outcomes["level"] = records["level"].tolist()
    if endless:
        outcomes["rounds"] = records["rounds"].tolist()
    return outcomes
