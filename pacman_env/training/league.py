"""League of a training: Clydes that learned against earlier planners, and how often the planner meets each.

The behaviour ``learned`` in a line-up stands for such a Clyde; before the first member exists, ``arcade`` and ``chase``
replace it. A member is drawn more often if the planner loses more rounds to it (prioritised fictitious self-play:
Vinyals et al., "Grandmaster level in StarCraft II", 2019, with f(x) = 1 - x).
"""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..policies.learned import LearnedPlanner
from ..policies.opponents import BehaviourOpponent, Opponents
from .arguments import Arguments
from .checkpoint import facts_of
from .export import export_planner
from .lineups import LEARNED
from .network import EntityNetwork

_GAMES, _STEPS = 128, 64  # Clyde's games, and decisions of each game per rollout
_RATE = 1e-3, 1e-4  # Clyde's first and last learning rate
_GAMMA = 0.99
_DECISIONS, _SPEED_MPS = 131_072, (0.1, 0.35)
_STREAM = 1  # key of Clyde's random numbers

#: By member's name: rounds against the member that the planner completed, and all rounds against it.
Record = Mapping[str, tuple[int, int]]


class League:
    """Members that a run has trained so far, as ONNX files in its folder."""

    def __init__(self, arguments: Arguments) -> None:
        self._arguments = arguments

    def names(self, segment: int) -> list[str]:
        """Return the members in a segment: one more after every ``league_every`` segments."""
        every = self._arguments.hyper.league_every
        return [f"clyde-{k + 1}" for k in range(segment // every if every else 0)]

    def path(self, name: str) -> Path:
        return self._arguments.out / f"{name}.onnx"

    def is_due(self, segment: int) -> bool:
        """Return True if a member is trained before a segment."""
        return len(self.names(segment)) > len(self.names(max(segment - 1, 0)))

    def training(self, segment: int) -> tuple[Arguments, Path | None, list[int]]:
        """Return the arguments of the due member's training, the planner that it starts from, and two seeds.

        Members with odd numbers start from random weights, to find new weaknesses. Members with even numbers start from
        the weights of their predecessor.
        """
        names, arguments = self.names(segment), clyde_arguments(self._arguments)
        seeds = np.random.SeedSequence(arguments.seed, spawn_key=(segment, _STREAM)).generate_state(2).tolist()
        return arguments, self.path(names[-2]) if len(names) % 2 == 0 else None, seeds

    def add(self, segment: int, network: EntityNetwork, decisions: int) -> None:
        """Write the due member, which learned from ``decisions`` decisions."""
        facts = facts_of(clyde_arguments(self._arguments), decisions, {})
        export_planner(network, self.path(self.names(segment)[-1]), facts)

    def pool(self, segment: int, record: Record) -> Opponents:
        """Return the policies of ghosts called ``learned`` in a segment, with weights from the rounds in ``record``."""
        names = self.names(segment)
        if not names:
            return Opponents([BehaviourOpponent("arcade"), BehaviourOpponent("chase")], [1.0, 1.0])
        counts = [record.get(name, (0, 0)) for name in names]
        # For each member count one more lost and one more completed round, so that no weight is 0.
        weights = [(rounds - won + 1) / (rounds + 2) for won, rounds in counts]
        return Opponents([LearnedPlanner(self.path(name)) for name in names], weights)

    def record(
        self, segment: int, seeds: NDArray[np.uint64], completed: NDArray[np.bool_], pool: Opponents
    ) -> dict[str, tuple[int, int]]:
        """Return for each member how many of the rounds were completed against it, and how many there were.

        ``seeds`` (E,) are the seeds of the rounds, ``completed`` (E,) is the mask of completed rounds, and ``pool`` the
        segment's pool, with which they were played.
        """
        drawn = pool.drawn(seeds)
        names = enumerate(self.names(segment))
        return {name: (int(completed[drawn == k].sum()), int((drawn == k).sum())) for k, name in names}


def clyde_arguments(arguments: Arguments) -> Arguments:
    """Return the arguments of Clyde's games and training, derived from the planner's."""
    hyper = arguments.hyper
    rollout = _GAMES * _STEPS
    changes: dict[str, Any] = {"games": _GAMES, "n_steps": _STEPS, "segment": rollout, "batch_size": rollout // 4}
    changes |= {"decisions": _DECISIONS, "learning_rate": _RATE, "cycles": 1, "gamma": _GAMMA}
    changes |= {"ghosts": (LEARNED,), "clyde_speed": _SPEED_MPS, "decide": "tick", "imitation": 0}
    return dataclasses.replace(arguments, start=None, hyper=dataclasses.replace(hyper, **changes))
