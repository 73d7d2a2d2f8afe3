"""The numbers of a report, as plain data: what its JSON holds and its page shows.

A *score* of a round is the share of the map's pellets that was collected; a round is *complete* when that is all of
them. Proportions of rounds have Wilson's interval, differences Newcombe's for pairs, everything else a bootstrap over
rounds. All intervals are 95 %; rates and probabilities are 0..1. Policies always meet the same seeds.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.episodes import statistics
from pacman_env.episodes.rollout import EPISODE
from pacman_env.evaluation.compare.workers import Played
from pacman_env.evaluation.report.plan import ENDLESS_GAMES, ROUNDS, Cell, Plan, Variant, replay_command
from pacman_env.game.execution import CLEARED, COMPLETE, DEAD, TIMEOUT

END_NAMES = {COMPLETE: "complete", DEAD: "caught", TIMEOUT: "time-out", CLEARED: "pellets lost"}
Numbers = dict[str, Any]


class Results:
    def __init__(self, plan: Plan, played: Mapping[Cell, Played]) -> None:
        self._plan, self._played = plan, played

    def numbers(self) -> Numbers:
        plan, policies = self._plan, self._plan.policies
        endless_maps = [*plan.maps, *([None] if len(plan.maps) > 1 else [])] if len(plan.endless_seeds) else []
        return {
            "summary": [self._summary(policy) for policy in policies],
            "curve": [self._point(policy, speed) for policy in policies for speed in plan.speeds],
            "endings": [self._endings(policy) for policy in policies],
            "endless": [self._endless(policy, name) for name in endless_maps for policy in policies],
            "pair": self._pair(),
            "variants": [self._variant(variant, policy) for variant in plan.variants for policy in policies],
            "decisions": [self._decisions(policy) for policy in policies],
            "rounds": [  # in the order of the seeds
                cell._asdict() | {name: records[name].tolist() for name in EPISODE.names or () if name != "seed"}
                for cell, (records, _) in self._played.items()
            ],
        }

    def _rng(self) -> np.random.Generator:
        """The same draws for each number: rows differ only by what was played."""
        return np.random.default_rng(self._plan.seed)

    def _of_maps(self, policy: str, part: str = ROUNDS, speed: float | None = None) -> dict[str, NDArray]:
        speed = self._plan.speed if speed is None else speed
        return {name: self._played[Cell(part, name, policy, speed)][0] for name in self._plan.maps}

    def _rounds(self, policy: str, part: str = ROUNDS, speed: float | None = None) -> NDArray:
        """A policy's records of all maps, one after another."""
        return np.concatenate(list(self._of_maps(policy, part, speed).values()))

    def _summary(self, policy: str) -> Numbers:
        ours, theirs = (self._of_maps(one) for one in (policy, self._plan.baseline))
        complete = [(records["end"] == COMPLETE).astype(np.float64) for records in ours.values()]
        scores, their_scores = ([r["collected"] / r["spawned"] for r in side.values()] for side in (ours, theirs))
        iqm, iqm_ci = statistics.bootstrapped_iqm(complete, self._rng())
        row = {
            "policy": policy,
            "maps": {name: _rate(records) for name, records in ours.items()},
            "all": _rate(self._rounds(policy)),
            "iqm": iqm,
            "iqm_ci": list(iqm_ci),
            "pellets_share": float(np.mean([s.mean() for s in scores])),
        }
        if policy != self._plan.baseline:
            probability, interval = statistics.bootstrapped_improvement(scores, their_scores, self._rng())
            row |= {"improvement": probability, "improvement_ci": list(interval)}
            row |= _difference(self._rounds(policy), self._rounds(self._plan.baseline))
        return row

    def _point(self, policy: str, speed: float) -> Numbers:
        records = self._rounds(policy, speed=speed)
        return {"policy": policy, "speed": speed, "rounds": len(records), **_rate(records)}

    def _endings(self, policy: str) -> Numbers:
        records = self._rounds(policy)
        won = records["time_s"][records["end"] == COMPLETE]
        return {
            "policy": policy,
            "rounds": len(records),
            "ends": {name: float((records["end"] == end).mean()) for end, name in END_NAMES.items()},
            "win_time_mean_s": float(won.mean()) if len(won) else None,
            "aborts_mean": float(records["aborts"].mean()),
        }

    def _endless(self, policy: str, map_name: str | None) -> Numbers:
        """Of one map, or (None) of all."""
        ours, theirs = (
            [r for name, r in self._of_maps(one, ENDLESS_GAMES).items() if map_name in (name, None)]
            for one in (policy, self._plan.baseline)
        )
        games = np.concatenate(ours)
        pellets, their_pellets = ([r["collected"].astype(np.float64) for r in side] for side in (ours, theirs))
        mean, interval = statistics.bootstrapped_mean(pellets, self._rng())
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
        if policy != self._plan.baseline:
            pairs = [our - their for our, their in zip(pellets, their_pellets, strict=True)]
            difference, interval = statistics.bootstrapped_mean(pairs, self._rng())
            row |= {"difference": difference, "difference_ci": list(interval)}
        return row

    def _variant(self, variant: Variant, policy: str) -> Numbers:
        changed = self._rounds(policy, variant.name, variant.config.clyde.speed_mps)
        row = {"variant": variant.name, "settings": variant.settings, "policy": policy, "rounds": len(changed)}
        return row | _rate(changed) | _difference(changed, self._rounds(policy))

    def _decisions(self, policy: str) -> Numbers:
        plan = self._plan
        times_ms = np.concatenate([self._played[Cell(ROUNDS, name, policy, plan.speed)][1] for name in plan.maps])
        p50, p99 = np.percentile(times_ms, (50, 99)).tolist()
        return {"policy": policy, "p50_ms": p50, "p99_ms": p99, "timed": len(times_ms)}

    def _pair(self) -> Numbers | None:
        """The rounds that one of the first policy and the baseline completes and the other does not."""
        plan = self._plan
        if plan.challenger is None:
            return None
        sides: dict[str, list[tuple[int, Numbers]]] = {"wins": [], "losses": []}
        for map_name, ours in self._of_maps(plan.challenger).items():
            theirs = self._of_maps(plan.baseline)[map_name]
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
        return {"policy": plan.challenger, "baseline": plan.baseline, **mixed}


def _rate(records: NDArray) -> Numbers:
    complete = records["end"] == COMPLETE
    return {"rate": float(complete.mean()), "ci": list(statistics.wilson(int(complete.sum()), len(complete)))}


def _difference(ours: NDArray, theirs: NDArray) -> Numbers:
    """Completion of one minus that of the other, in the same rounds."""
    value, interval = statistics.paired_difference(ours["end"] == COMPLETE, theirs["end"] == COMPLETE)
    return {"difference": value, "difference_ci": list(interval)}


def _outcome(record: Any) -> Numbers:
    return {
        "end": END_NAMES[int(record["end"])],
        "collected": int(record["collected"]),
        "pellets": int(record["spawned"]),
        "time_s": float(record["time_s"]),
    }
