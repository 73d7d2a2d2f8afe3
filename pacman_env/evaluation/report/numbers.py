"""Compute the numbers of a report as plain data, for its JSON and its page.

``rows`` are rows of ``rounds.summary`` with ``part`` (``rounds``, ``endless games`` or the name of a variant), on each
map and on all maps together (``map`` null), over Clyde's speeds. They are compared with the baseline; rows of a variant
are compared with the same policy without the variant. ``summary`` treats maps as tasks: interquartile mean of
completion, and the probability of improvement over the baseline in *score*, the share of a round's pellets. ``pair``
lists the rounds that only one of two policies completes. All intervals are 95 %; rates and probabilities are 0..1.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.episodes import statistics
from pacman_env.evaluation.report.plan import ENDLESS_GAMES, ROUNDS, ReportPlan, RoundsKey, replay_command
from pacman_env.evaluation.rounds.play import Played
from pacman_env.evaluation.rounds.summary import Row, make_row
from pacman_env.game.execution import CLEARED, COMPLETE, DEAD, TIMEOUT

END_NAMES = {COMPLETE: "complete", DEAD: "caught", TIMEOUT: "time-out", CLEARED: "pellets lost"}


class Results:
    """Results of the rounds of a plan."""

    def __init__(self, plan: ReportPlan, played: Mapping[RoundsKey, Played]) -> None:
        self._plan, self._played = plan, played

    def numbers(self) -> dict[str, Any]:
        plan = self._plan
        rows = [
            self._row(part, config.clyde.speed_mps, map_name, policy)
            for part, config, _ in plan.parts
            for map_name in (*plan.maps, None)
            for policy in plan.policies
        ]
        return {"rows": rows, "summary": [self._summary(policy) for policy in plan.policies], "pair": self._pair()}

    def _row(self, part: str, speed: float, map_name: str | None, policy: str) -> Row:
        maps = list(self._plan.maps) if map_name is None else [map_name]
        played = [self._played[RoundsKey(part, name, policy, speed)] for name in maps]
        with_ = RoundsKey(part, "", self._plan.baseline, speed)
        if part not in (ROUNDS, ENDLESS_GAMES):
            with_ = RoundsKey(ROUNDS, "", policy, self._plan.speed)
        others = [self._played[with_._replace(map=name)][0] for name in maps]
        about = {"part": part, "map": map_name, "policy": policy, "clyde_speed": speed}
        row = make_row(about, played, others, endless=part == ENDLESS_GAMES)
        if map_name is None:
            row.pop("outcomes", None)
        return row

    def _of_maps(self, policy: str) -> dict[str, NDArray]:
        return {name: self._played[RoundsKey(ROUNDS, name, policy, self._plan.speed)][0] for name in self._plan.maps}

    def _rng(self) -> np.random.Generator:
        """Return a new generator with the same draws for each number, so that only rounds cause differences."""
        return np.random.default_rng(self._plan.seed)

    def _summary(self, policy: str) -> Row:
        ours, theirs = (self._of_maps(one) for one in (policy, self._plan.baseline))
        complete = [(records["end"] == COMPLETE).astype(np.float64) for records in ours.values()]
        scores, their_scores = ([r["collected"] / r["spawned"] for r in side.values()] for side in (ours, theirs))
        iqm, iqm_ci = statistics.bootstrapped_iqm(complete, self._rng())
        row = {"policy": policy, "iqm": iqm, "iqm_ci": list(iqm_ci)}
        if policy != self._plan.baseline:
            probability, interval = statistics.bootstrapped_improvement(scores, their_scores, self._rng())
            row |= {"improvement": probability, "improvement_ci": list(interval)}
        return row

    def _pair(self) -> dict[str, Any] | None:
        """Return the rounds that only one of the first policy and the baseline completes."""
        plan = self._plan
        if plan.challenger is None:
            return None
        sides: dict[str, list[tuple[int, Row]]] = {"wins": [], "losses": []}
        for map_name, ours in self._of_maps(plan.challenger).items():
            theirs = self._of_maps(plan.baseline)[map_name]
            our_win, their_win = ours["end"] == COMPLETE, theirs["end"] == COMPLETE
            for name, which in (("wins", our_win & ~their_win), ("losses", their_win & ~our_win)):
                for place, k in enumerate(np.flatnonzero(which)):
                    seed = int(ours["seed"][k])
                    row = {
                        "map": map_name,
                        "seed": str(seed),  # as in ``seeds``
                        "ours": _outcome(ours[k]),
                        "theirs": _outcome(theirs[k]),
                        "command": replay_command(plan, map_name, seed),
                    }
                    sides[name].append((place, row))
        # Order by place, then by map, so that the start of the list shows every map.
        mixed = {name: [row for _, row in sorted(rows, key=lambda pair: pair[0])] for name, rows in sides.items()}
        return {"policy": plan.challenger, "baseline": plan.baseline, **mixed}


def _outcome(record: Any) -> Row:
    return {
        "end": END_NAMES[int(record["end"])],
        "collected": int(record["collected"]),
        "pellets": int(record["spawned"]),
        "time_s": float(record["time_s"]),
    }
