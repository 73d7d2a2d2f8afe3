"""The Clydes that a planner is trained against: a pool that gives each game one of many, a table of results.

The rules are the environment's own behaviours (``game/ghosts.py``), here for a ghost that another policy may move in
every game.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacman_env.episodes.rollout import episode_seeds, play
from pacman_env.episodes.statistics import wilson
from pacman_env.game.execution import COMPLETE
from pacman_env.policies.base import BasePolicy, Policy
from pacman_env.policies.registry import make_policy
from pacman_env.sim.core.ghosts import BEHAVIOUR_NAMES, behaviour_choice
from pacman_env.sim.core.parameters import draw_below
from pacman_env.sim.maps.generated import GeneratedMaps
from pacman_env.sim.observation.situation import Situation
from pacman_env.training.arguments import Arguments
from pacman_env.training.games import VALIDATION_LEVEL, game_config

BUILT_IN = ("wander", "arcade", "chase")  # behaviours of the environment
RULES = ("lookahead", "clyde_aware")
_OPPONENT = 32  # purpose of the draw, beside those of pacman_env/rng.py
_PARTS = 1 << 20  # a share is drawn so finely
_HELD_OUT = 128  # validation levels that rounds are drawn from
_GAMES = 128  # at once


class BehaviourOpponent(BasePolicy):
    """A behaviour of the environment's as Clyde's policy.

    Args:
        name: one of :data:`pacman_env.sim.core.ghosts.BEHAVIOUR_NAMES`.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._number = BEHAVIOUR_NAMES.index(name)

    def select(self, situation: Situation) -> NDArray[np.int64]:
        """(N,) the choice beyond the candidates that stands for the behaviour."""
        n, candidates = situation.mask.shape
        return np.full(n, behaviour_choice(candidates - 1, self._number), dtype=np.int64)


class Opponents(BasePolicy):
    """A pool: each round is played by one of several, drawn from the round's seed.

    Args:
        members: none may need to remember anything.
        shares: of the rounds, in proportion.

    Raises:
        ValueError: no members, not a share for each, a negative one, or none above 0.
    """

    name = "opponents"

    def __init__(self, members: Sequence[Policy], shares: Sequence[float]) -> None:
        if not members or len(members) != len(shares):
            raise ValueError(f"{len(members)} members and {len(shares)} shares: must be as many, at least one")
        weights = np.array(shares, dtype=np.float64)
        if not (np.isfinite(weights).all() and (weights >= 0).all() and weights.sum() > 0):
            raise ValueError(f"shares = {list(shares)}: must be at least 0, one of them above")
        self.members = tuple(members)
        self._limits = np.cumsum(weights) / weights.sum()

    def drawn(self, seeds: NDArray[np.uint64]) -> NDArray[np.int64]:
        """(M,) number of the member that plays the round with each seed."""
        share = (draw_below(seeds, _OPPONENT, _PARTS) + 0.5) / _PARTS
        return np.minimum(np.searchsorted(self._limits, share, side="right"), len(self.members) - 1)

    def select(self, situation: Situation) -> NDArray[np.int64]:
        """(N,) each round's choice by the member that plays it."""
        numbers = self.drawn(situation.seed)
        chosen = np.empty(len(numbers), dtype=np.int64)
        for number in np.unique(numbers).tolist():
            rows = np.flatnonzero(numbers == number)
            chosen[rows] = self.members[number].select(situation.rows(rows))
        return chosen


def make_pool(learned: Sequence[Policy], wander: float) -> Opponents:
    """Wander with this share of the rounds; the rules and the learned Clydes share the others equally.

    Raises:
        ValueError: a share that is none.
    """
    others: list[Policy] = [BehaviourOpponent("chase"), BehaviourOpponent("arcade"), *learned]
    return Opponents([BehaviourOpponent("wander"), *others], [wander, *[(1.0 - wander) / len(others)] * len(others)])


def completed_against(policy: Policy, clyde: str | Policy, arguments: Arguments, rounds: int) -> NDArray[np.bool_]:
    """Which of ``rounds`` on validation levels the robot's policy completes; the same rounds for all.

    Args:
        policy: of the robot.
        clyde: a behaviour of the environment's, or Clyde's policy.
        arguments: the game that is trained on.
        rounds: how many.

    Raises:
        ConfigError: an unknown behaviour.
    """
    ghost, behaviour = (None, clyde) if isinstance(clyde, str) else (clyde, "policy")
    config = game_config(arguments).with_fields(**{"clyde.ghosts": (behaviour,)})
    source = GeneratedMaps(config, VALIDATION_LEVEL, _HELD_OUT)
    seeds = episode_seeds(VALIDATION_LEVEL, rounds)
    records, _ = play(source, config, policy, seeds, batch_size=_GAMES, ghost=ghost, num_threads=arguments.threads)
    return np.asarray(records["end"] == COMPLETE)


class Table:
    """Share of validation rounds that a policy completes against a Clyde; every pair is played once."""

    def __init__(self, arguments: Arguments, rounds: int) -> None:
        self._arguments, self._rounds = arguments, rounds
        self._files: dict[str, Path] = {}
        self.completed: dict[str, dict[str, NDArray[np.bool_]]] = {}  # by policy, by Clyde

    def add(self, name: str, path: Path) -> None:
        """Call a planner's or a Clyde's file by a name."""
        self._files[name] = path

    def play(self, policy: str, clydes: Sequence[str]) -> None:
        """Fill a row where it is empty yet: a policy's name or file against behaviours or learned Clydes."""
        row = self.completed.setdefault(policy, {})
        for clyde in clydes:
            if clyde not in row:
                robot = make_policy(str(self._files.get(policy, policy)))
                rival = make_policy(str(self._files[clyde])) if clyde in self._files else clyde
                row[clyde] = completed_against(robot, rival, self._arguments, self._rounds)

    def shares(self) -> dict[str, dict[str, float]]:
        """Share of rounds completed, by policy and by Clyde."""
        return {
            policy: {clyde: float(ended.mean()) for clyde, ended in row.items()}
            for policy, row in self.completed.items()
        }

    def render(self) -> str:
        """As Markdown, with Wilson's intervals; empty where a pair has not been played."""
        clydes = list(dict.fromkeys(clyde for row in self.completed.values() for clyde in row))
        lines = [f"| completed of {self._rounds} | {' | '.join(clydes)} |", "|---" * (len(clydes) + 1) + "|"]
        for policy, row in self.completed.items():
            cells = [_cell(row[clyde]) if clyde in row else "" for clyde in clydes]
            lines.append(f"| {policy} | {' | '.join(cells)} |")
        return "\n".join(lines)


def _cell(ended: NDArray[np.bool_]) -> str:
    low, high = wilson(int(ended.sum()), len(ended))
    return f"{ended.mean():.1%} [{low:.0%}, {high:.0%}]"


def robustness(planner: Path, clyde: Path | None, arguments: Arguments, rounds: int) -> Table:
    """The table of one planner and the rules, for a model card; ``clyde`` is a learned one to be in it too.

    Raises:
        ValueError: a file is no planner for this version.
    """
    table = Table(arguments, rounds)
    table.add("planner", planner)
    if clyde is not None:
        table.add("clyde", clyde)
    for policy in ("planner", *RULES):
        table.play(policy, (*BUILT_IN, "clyde") if clyde is not None else BUILT_IN)
    return table
