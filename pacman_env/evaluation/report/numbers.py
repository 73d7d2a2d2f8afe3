"""The numbers of a report, as plain data: what its JSON holds and its page shows.

A *score* of a round is the share of the map's pellets that was collected; a round is *complete* when that is all of
them. Proportions of rounds have Wilson's interval, differences Newcombe's for pairs, everything else a bootstrap over
rounds. All intervals are 95 %; rates and probabilities are 0..1. Policies always meet the same seeds.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.episodes.statistics import (
    bootstrapped_improvement,
    bootstrapped_iqm,
    bootstrapped_mean,
    paired_difference,
    wilson,
)
from pacman_env.evaluation.compare.workers import Played
from pacman_env.evaluation.report.plan import ENDLESS_GAMES, ROUNDS, Cell, Plan, replay_command
from pacman_env.game.execution import CLEARED, COMPLETE, DEAD, TIMEOUT

END_NAMES = {COMPLETE: "complete", DEAD: "caught", TIMEOUT: "time-out", CLEARED: "pellets lost"}
Numbers = dict[str, Any]
Results = Mapping[Cell, Played]


def numbers(plan: Plan, played: Results) -> Numbers:
    return {
        "summary": [_summary(plan, played, policy) for policy in plan.policies],
        "curve": [_point(plan, played, policy, v) for policy in plan.policies for v in plan.speeds],
        "endings": [_endings(plan, played, policy) for policy in plan.policies],
        "endless": [_endless(plan, played, policy, name) for name in _endless_maps(plan) for policy in plan.policies],
        "pair": _pair(plan, played),
        "variants": [_variant(plan, played, k, policy) for k in range(len(plan.variants)) for policy in plan.policies],
        "decisions": [_decisions(plan, played, policy) for policy in plan.policies],
        "rounds": [_raw(cell, result[0]) for cell, result in played.items()],
    }


def _endless_maps(plan: Plan) -> list[str | None]:
    """The maps of the endless games, then (None) all together."""
    if len(plan.endless_seeds) == 0:
        return []
    return [*plan.maps, *([None] if len(plan.maps) > 1 else [])]


def _rng(plan: Plan) -> np.random.Generator:
    """The same draws for each number: rows differ by what was played alone."""
    return np.random.default_rng(plan.seed)


def _of_maps(
    plan: Plan, played: Results, policy: str, part: str = ROUNDS, speed: float | None = None
) -> dict[str, NDArray]:
    speed = plan.speed if speed is None else speed
    return {name: played[Cell(part, name, policy, speed)][0] for name in plan.maps}


def _rounds(plan: Plan, played: Results, policy: str, part: str = ROUNDS, speed: float | None = None) -> NDArray:
    """A policy's records of all maps, one after another."""
    return np.concatenate(list(_of_maps(plan, played, policy, part, speed).values()))


def _rate(records: NDArray) -> Numbers:
    complete = records["end"] == COMPLETE
    return {"rate": float(complete.mean()), "ci": list(wilson(int(complete.sum()), len(complete)))}


def _difference(ours: NDArray, theirs: NDArray) -> Numbers:
    """Completion of one minus that of the other, in the same rounds."""
    value, interval = paired_difference(ours["end"] == COMPLETE, theirs["end"] == COMPLETE)
    return {"difference": value, "difference_ci": list(interval)}


def _summary(plan: Plan, played: Results, policy: str) -> Numbers:
    ours, theirs = (_of_maps(plan, played, one) for one in (policy, plan.baseline))
    complete = [(records["end"] == COMPLETE).astype(np.float64) for records in ours.values()]
    scores, their_scores = ([r["collected"] / r["spawned"] for r in side.values()] for side in (ours, theirs))
    iqm, iqm_ci = bootstrapped_iqm(complete, _rng(plan))
    row = {
        "policy": policy,
        "maps": {name: _rate(records) for name, records in ours.items()},
        "all": _rate(np.concatenate(list(ours.values()))),
        "iqm": iqm,
        "iqm_ci": list(iqm_ci),
        "pellets_share": float(np.mean([s.mean() for s in scores])),
    }
    if policy != plan.baseline:
        probability, interval = bootstrapped_improvement(scores, their_scores, _rng(plan))
        row |= {"improvement": probability, "improvement_ci": list(interval)}
        row |= _difference(*(np.concatenate(list(side.values())) for side in (ours, theirs)))
    return row


def _point(plan: Plan, played: Results, policy: str, speed: float) -> Numbers:
    records = _rounds(plan, played, policy, speed=speed)
    return {"policy": policy, "speed": speed, "rounds": len(records), **_rate(records)}


def _endings(plan: Plan, played: Results, policy: str) -> Numbers:
    records = _rounds(plan, played, policy)
    won = records["time_s"][records["end"] == COMPLETE]
    return {
        "policy": policy,
        "rounds": len(records),
        "ends": {name: float((records["end"] == end).mean()) for end, name in END_NAMES.items()},
        "win_time_mean_s": float(won.mean()) if len(won) else None,
        "aborts_mean": float(records["aborts"].mean()),
    }


def _endless(plan: Plan, played: Results, policy: str, map_name: str | None) -> Numbers:
    """Of one map, or (None) of all."""
    ours, theirs = (
        [r for name, r in _of_maps(plan, played, one, ENDLESS_GAMES).items() if map_name in (name, None)]
        for one in (policy, plan.baseline)
    )
    games = np.concatenate(ours)
    pellets, their_pellets = ([r["collected"].astype(np.float64) for r in side] for side in (ours, theirs))
    mean, interval = bootstrapped_mean(pellets, _rng(plan))
    row = {
        "policy": policy,
        "map": map_name,
        "games": len(games),
        "pellets_mean": mean,
        "pellets_ci": list(interval),
        "pellets_median": float(np.median(games["collected"])),
        "rounds_mean": float(games["rounds"].mean()),
        "caught": float((games["end"] == DEAD).mean()),
    }
    if policy != plan.baseline:
        pairs = [our - their for our, their in zip(pellets, their_pellets, strict=True)]
        difference, interval = bootstrapped_mean(pairs, _rng(plan))
        row |= {"difference": difference, "difference_ci": list(interval)}
    return row


def _variant(plan: Plan, played: Results, number: int, policy: str) -> Numbers:
    variant = plan.variants[number]
    changed = _rounds(plan, played, policy, variant.name, variant.config.clyde.speed_mps)
    plain = _rounds(plan, played, policy)
    row = {"variant": variant.name, "settings": variant.settings, "policy": policy, "rounds": len(changed)}
    return row | _rate(changed) | _difference(changed, plain)


def _decisions(plan: Plan, played: Results, policy: str) -> Numbers:
    times_ms = np.concatenate([played[Cell(ROUNDS, name, policy, plan.speed)][1] for name in plan.maps])
    p50, p99 = np.percentile(times_ms, (50, 99)).tolist()
    return {"policy": policy, "p50_ms": p50, "p99_ms": p99, "timed": len(times_ms)}


def _pair(plan: Plan, played: Results) -> Numbers | None:
    """The rounds that one of the first policy and the baseline completes and the other does not."""
    challenger = plan.challenger
    if challenger is None:
        return None
    sides: dict[str, list[tuple[int, Numbers]]] = {"wins": [], "losses": []}
    for map_name, ours in _of_maps(plan, played, challenger).items():
        theirs = _of_maps(plan, played, plan.baseline)[map_name]
        our_win, their_win = ours["end"] == COMPLETE, theirs["end"] == COMPLETE
        for name, which in (("wins", our_win & ~their_win), ("losses", their_win & ~our_win)):
            for place, k in enumerate(np.flatnonzero(which)):
                seed = int(ours["seed"][k])
                row = {
                    "map": map_name,
                    "seed": str(seed),  # as in "seeds"
                    "ours": _outcome(ours[k]),
                    "theirs": _outcome(theirs[k]),
                    "command": replay_command(plan, map_name, seed),
                }
                sides[name].append((place, row))
    # the first of each map, then the second of each: the beginning of the list has every map
    mixed = {name: [row for _, row in sorted(rows, key=lambda pair: pair[0])] for name, rows in sides.items()}
    return {"policy": challenger, "baseline": plan.baseline, **mixed}


def _outcome(record: Any) -> Numbers:
    return {
        "end": END_NAMES[int(record["end"])],
        "collected": int(record["collected"]),
        "pellets": int(record["spawned"]),
        "time_s": float(record["time_s"]),
    }


def _raw(cell: Cell, records: NDArray) -> Numbers:
    """The records of the rounds, in the order of the seeds."""
    shown: Sequence[str] = [name for name in records.dtype.names or () if name != "seed"]
    return {**cell._asdict(), **{name: records[name].tolist() for name in shown}}
