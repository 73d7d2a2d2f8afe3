"""What is reported of one policy on one map at one of Clyde's speeds: a row of plain numbers.

The JSON of ``eval.compare`` is ``{"schema": 1, "version", "seed", "preset", "execution", "maps", "arguments",
"config", "rows"}``. A row holds ``map``, ``policy``, ``clyde_speed`` (m/s), ``episodes``, ``pellets`` (on the map);
rates 0..1 with 95 % Wilson intervals [low, high]: ``completion_rate``/``_ci``, ``all_but_one_rate``/``_ci``,
``death_rate``, ``death_ci``, ``timeout_rate``, ``cleared_rate`` (no pellet left, some lost); means per episode:
``pellets_mean``, ``lost_mean``, ``aborts_mean``, ``time_mean_s``, ``win_time_mean_s`` (null without a win); times of
one decision of the policy alone, ``decision_ms_p50`` and ``_p99``, over ``decisions_timed`` samples; and
``paired_difference``/``paired_ci``: completion minus that of the first policy in the same rounds.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from eval.statistics import paired_difference, wilson
from pacman_env.sim.records import CLEARED, COMPLETE, DEAD, TIMEOUT

Row = dict[str, Any]


def make_row(
    *,
    map_name: str,
    policy: str,
    clyde_speed: float,
    records: NDArray,
    decision_ms: NDArray[np.float64],
    first: NDArray | None = None,
) -> Row:
    """The row of one policy; rates are 0..1, intervals [low, high] at 95 %.

    Args:
        map_name: the map.
        policy: the policy as named on the command line.
        clyde_speed: m/s.
        records: (E,) of type ``eval.episodes.EPISODE``.
        decision_ms: (T,) times of single decisions.
        first: (E,) records of the policy to compare with, in the same seeds; None: this is that policy.

    Raises:
        ValueError: the two policies were not given the same seeds.
    """
    episodes = len(records)
    complete = records["end"] == COMPLETE
    all_but_one = records["collected"] >= records["spawned"] - 1
    dead = records["end"] == DEAD
    difference, difference_ci = 0.0, (0.0, 0.0)
    if first is not None:
        if not np.array_equal(first["seed"], records["seed"]):
            raise ValueError(f"{policy} on {map_name}: not the seeds of the policy it is compared with")
        difference, difference_ci = paired_difference(complete, first["end"] == COMPLETE)
    p50, p99 = np.percentile(decision_ms, (50, 99))
    return {
        "map": map_name,
        "policy": policy,
        "clyde_speed": clyde_speed,
        "episodes": episodes,
        "completion_rate": float(complete.mean()),
        "completion_ci": list(wilson(int(complete.sum()), episodes)),
        "all_but_one_rate": float(all_but_one.mean()),
        "all_but_one_ci": list(wilson(int(all_but_one.sum()), episodes)),
        "pellets_mean": float(records["collected"].mean()),
        "death_rate": float(dead.mean()),
        "timeout_rate": float((records["end"] == TIMEOUT).mean()),
        "time_mean_s": float(records["time_s"].mean()),
        "decision_ms_p50": float(p50),
        "decision_ms_p99": float(p99),
        "paired_difference": difference,
        "paired_ci": list(difference_ci),
        "pellets": int(records["spawned"][0]),
        "death_ci": list(wilson(int(dead.sum()), episodes)),
        "cleared_rate": float((records["end"] == CLEARED).mean()),
        "lost_mean": float(records["lost"].mean()),
        "aborts_mean": float(records["aborts"].mean()),
        "win_time_mean_s": float(records["time_s"][complete].mean()) if complete.any() else None,
        "decisions_timed": len(decision_ms),
    }
