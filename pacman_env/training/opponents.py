"""The Clydes that a planner is trained against: the pool of a training run, a table of results."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pacman_env.episodes.rollout import episode_seeds, play
from pacman_env.episodes.statistics import wilson
from pacman_env.game.execution import COMPLETE
from pacman_env.policies.base import Policy
from pacman_env.policies.opponents import BehaviourOpponent, Opponents
from pacman_env.policies.registry import make_policy
from pacman_env.sim.maps.generated import GeneratedMaps
from pacman_env.training.arguments import Arguments
from pacman_env.training.games import VALIDATION_LEVEL, game_config

BUILT_IN = ("wander", "arcade", "chase")  # behaviours of the environment
RULES = ("lookahead", "clyde_aware")
_HELD_OUT = 128  # validation levels that rounds are drawn from
_GAMES = 128  # at once


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
