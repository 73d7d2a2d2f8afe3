"""Validation and test rounds, on levels that no training uses: they judge a training and fill its report."""

import copy
import functools
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from ..config import Config
from ..engine.cores import cores
from ..episodes.rollout import episode_seeds, play_in
from ..episodes.statistics import paired_difference, wilson
from ..game.ends import COMPLETE
from ..game.ghosts import POLICY
from ..levels.level_source import TEST_LEVEL, GeneratedMaps
from ..policies.base import Policy
from ..sim.batch import GameBatch
from .arguments import Arguments
from .games import VALIDATION_LEVEL, game_config, lineup_settings
from .lineups import LEARNED, read

_RULES = ("clyde_aware", "lookahead", "nearest")  # policies that the report compares with
_HELD_OUT = 128  # number of levels for validation, and of levels for the report
_ROUNDS = 64  # rounds of a task; with another number, sums of the network are rounded differently


class _CachedLevels(GeneratedMaps):
    """Levels that stay prepared between batches."""

    prepare = functools.cache(GeneratedMaps.prepare)


@functools.cache
def _levels(config: Config, first: int) -> _CachedLevels:
    return _CachedLevels(config, first, _HELD_OUT)


class HeldOut:
    """Validation or test rounds with a decision at each tick; levels stay prepared between evaluations.

    The rounds are divided evenly among the line-ups ``ghosts``, by default the line-ups of the training.
    """

    def __init__(
        self, arguments: Arguments, rounds: int, *, test: bool = False, ghosts: Sequence[str] | None = None
    ) -> None:
        lineups = arguments.hyper.lineups if ghosts is None else ghosts
        self._config = game_config(arguments).with_fields(**{"decisions.when": "tick"})
        self._arguments, self._first = arguments, TEST_LEVEL if test else VALIDATION_LEVEL
        self.seeds = episode_seeds(arguments.seed if test else VALIDATION_LEVEL, rounds)
        ends = [rounds * k // len(lineups) for k in range(len(lineups) + 1)]
        #: Rounds that are played against each line-up.
        self.rows = {lineup: slice(*ends[k : k + 2]) for k, lineup in enumerate(lineups)}

    def completed(self, policy: str | Policy, learned: Policy | None = None) -> NDArray[np.bool_]:
        """Play the rounds and return the mask (E,) of completed rounds; ``learned`` moves ghosts called ``learned``."""

        def play(lineup: str, seeds: NDArray[np.uint64]) -> NDArray[np.bool_]:
            robot, ghost = copy.deepcopy((policy, learned))  # other threads play with the originals
            names = read(lineup).behaviours
            ghosts = {k: ghost for k, name in enumerate(names) if name == LEARNED and ghost is not None}
            moved = tuple(POLICY if k in ghosts else name for k, name in enumerate(names))
            config = self._config.with_fields(**{"clyde.ghosts": moved, **lineup_settings(self._arguments, lineup)})
            games = GameBatch(_levels(self._config, self._first), config, len(seeds))
            records, _ = play_in(games, robot, seeds, ghosts=ghosts, timed=False)
            return np.asarray(records["end"] == COMPLETE)

        tasks = [
            (lineup, self.seeds[rows][k : k + _ROUNDS])
            for lineup, rows in self.rows.items()
            for k in range(0, rows.stop - rows.start, _ROUNDS)
        ]
        with ThreadPoolExecutor(self._arguments.threads or cores()) as pool:
            return np.concatenate([np.zeros(0, dtype=np.bool_), *pool.map(play, *zip(*tasks, strict=True))])

    def shares(self, completed: NDArray[np.bool_]) -> tuple[float, dict[str, float]]:
        """Return the completion rates in the mask (E,): over all rounds, and by line-up (0 if there are no rounds)."""
        each = {lineup: completed[rows] for lineup, rows in {"": slice(None), **self.rows}.items()}
        shares = {lineup: float(ended.sum()) / max(len(ended), 1) for lineup, ended in each.items()}
        return shares.pop(""), shares

    def learned(self) -> NDArray[np.bool_]:
        """Return the mask (E,) of the rounds with a ghost that a member of the league moves."""
        mask = np.zeros(len(self.seeds), dtype=np.bool_)
        for lineup, rows in self.rows.items():
            mask[rows] = LEARNED in read(lineup).behaviours
        return mask


def report(arguments: Arguments, planner: Policy, learned: Policy, seconds: float) -> str:
    """Return the planner's table: completed test rounds, compared with rules, after ``seconds`` of training."""
    hyper = arguments.hyper
    lines = [f"{hyper.segments * hyper.segment} decisions, seed {arguments.seed}, {seconds:.0f} s"]
    if arguments.evaluation == 0:
        return lines[0]
    test = HeldOut(arguments, arguments.evaluation, test=True)
    played = {"ppo": test.completed(planner, learned), **{rule: test.completed(rule, learned) for rule in _RULES}}
    low, high = hyper.clyde_speed
    lines += [f"{len(test.seeds)} rounds on test levels, Clyde {low}-{high} m/s:", ""]
    several = len(test.rows) > 1
    lines += [f"| {'ghosts | ' * several}policy | completed | ppo minus it, paired |", "|---" * (3 + several) + "|"]
    for lineup, rows in (({"all": slice(None)} if several else {}) | test.rows).items():
        for name, ended in played.items():
            share, (first, last) = ended[rows].mean(), wilson(int(ended[rows].sum()), len(ended[rows]))
            difference, (low, high) = paired_difference(played["ppo"][rows], ended[rows])
            against = "" if name == "ppo" else f"{difference:+.1%} [{low:+.1%}, {high:+.1%}]"
            place = f"{lineup} | " if several else ""
            lines.append(f"| {place}{name} | {share:.1%} [{first:.1%}, {last:.1%}] | {against} |")
    return "\n".join(lines)
