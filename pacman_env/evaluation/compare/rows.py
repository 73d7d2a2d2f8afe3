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
``decision_ms`` with more percentiles, over ``decisions_timed`` samples; and the results of the rounds, one after the
other as the seeds: ``outcomes`` with ``end`` (a letter each, ``ENDS``: C complete, L cleared but some lost, D caught,
T time-out), ``collected``, ``time_s`` and, on several levels, ``level``.

A row of kind ``round`` adds ``completion_rate``/``_ci``, ``all_but_one_rate``/``_ci``, ``lost_mean``, ``aborts_mean``,
``win_time_mean_s`` (null without a win), and ``paired_difference``/``paired_ci``: completion minus that of the first
policy in the same rounds. In a row of kind ``endless`` an episode is a game of many rounds; it adds ``pellets_ci``
(bootstrap), ``pellets_median``, ``rounds_mean`` and ``rounds_most`` (completed), ``outcomes.rounds``, and
``paired_difference``/``paired_ci``: pellets per game minus those of the first policy (paired bootstrap).
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config
from pacman_env.episodes.statistics import bootstrapped_mean, paired_difference, wilson
from pacman_env.evaluation.compare.workers import Played
from pacman_env.game.execution import CLEARED, COMPLETE, DEAD, TIMEOUT

Row = dict[str, Any]
ENDS = {COMPLETE: "C", CLEARED: "L", DEAD: "D", TIMEOUT: "T"}
_DRAWS = 0  # seed of each interval: rows differ only by what was played
_PERCENTILES = (1, 5, 25, 50, 75, 95, 99, 99.9)


def make_row(map_name: str, policy: str, config: Config, played: Played, first: NDArray | None = None) -> Row:
    """The row of one policy; ``first`` are the records of the policy to compare with, None if this is that policy."""
    records, decision_ms = played
    if first is not None and not np.array_equal(first["seed"], records["seed"]):
        raise ValueError(f"{policy} on {map_name}: not the seeds of the policy it is compared with")
    kind, own = ("endless", _of_games) if config.endless else ("round", _of_rounds)
    about = {"map": map_name, "policy": policy, "clyde_speed": config.clyde.speed_mps, "kind": kind}
    return about | _common(records) | own(records, first) | _decisions(decision_ms) | _outcomes(records, config.endless)


def _rate(name: str, which: NDArray[np.bool_]) -> Row:
    return {f"{name}_rate": float(which.mean()), f"{name}_ci": list(wilson(int(which.sum()), len(which)))}


def _common(records: NDArray) -> Row:
    return {
        "episodes": len(records),
        "levels": len(np.unique(records["level"])),
        "pellets": int(records["spawned"].max()),
        "pellets_least": int(records["spawned"].min()),
        "pellets_mean": float(records["collected"].mean()),
        **_rate("death", records["end"] == DEAD),
        "timeout_rate": float((records["end"] == TIMEOUT).mean()),
        "cleared_rate": float((records["end"] == CLEARED).mean()),
        "time_mean_s": float(records["time_s"].mean()),
    }


def _of_rounds(records: NDArray, first: NDArray | None) -> Row:
    complete = records["end"] == COMPLETE
    difference, interval = 0.0, (0.0, 0.0)
    if first is not None:
        difference, interval = paired_difference(complete, first["end"] == COMPLETE)
    return {
        **_rate("completion", complete),
        **_rate("all_but_one", records["collected"] >= records["spawned"] - 1),
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
        difference, interval = bootstrapped_mean([collected - first["collected"]], np.random.default_rng(_DRAWS))
    return {
        "pellets_ci": list(bootstrapped_mean([collected], np.random.default_rng(_DRAWS))[1]),
        "pellets_median": float(np.median(collected)),
        "rounds_mean": float(records["rounds"].mean()),
        "rounds_most": int(records["rounds"].max()),
        "paired_difference": difference,
        "paired_ci": list(interval),
    }


def _decisions(decision_ms: NDArray[np.float64]) -> Row:
    percentiles = np.percentile(decision_ms, _PERCENTILES).tolist()
    by_name = {f"p{p:g}": value for p, value in zip(_PERCENTILES, percentiles, strict=True)}
    times = {"decision_ms_p50": by_name["p50"], "decision_ms_p99": by_name["p99"], "decision_ms": by_name}
    return times | {"decisions_timed": len(decision_ms)}


def _outcomes(records: NDArray, endless: bool) -> Row:
    outcomes: dict[str, Any] = {
        "end": "".join(ENDS[end] for end in records["end"].tolist()),
        "collected": records["collected"].tolist(),
        "time_s": [round(t, 3) for t in records["time_s"].tolist()],
    }
    if len(np.unique(records["level"])) > 1:
        outcomes["level"] = records["level"].tolist()
    if endless:
        outcomes["rounds"] = records["rounds"].tolist()
    return {"outcomes": outcomes}
