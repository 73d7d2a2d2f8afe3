"""Games that a network learns in, divided into parts; the workers of an executor play them fragment by fragment."""

from __future__ import annotations

import copy
import itertools
from collections.abc import Callable, Sequence

import numpy as np

from pacman_env.executors.base import Executor
from pacman_env.training import fragments
from pacman_env.training.fragments import Fragment, How, Task
from pacman_env.training.games import Part, PlannerPart
from pacman_env.training.learnability import LevelCounts
from pacman_env.training.network import EntityNetwork

_NUMBERS = itertools.count()


class Collector:
    """Plays fragments; they depend on seed and network alone, not on the number of workers or on lost workers."""

    def __init__(self, parts: Sequence[Part], executor: Executor) -> None:
        if not parts:
            raise ValueError("no games to play")
        self.parts, self._executor, self._number = list(parts), executor, next(_NUMBERS)
        self.num_envs = sum(part.games for part in parts)
        planners = [part if isinstance(part, PlannerPart) else None for part in parts]
        #: Counts of the rounds that ended since :meth:`reset`.
        self.counts = LevelCounts([part.lineup if part and part.may_repeat else None for part in planners])
        self._played = 0  # number of the next fragment of each part
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Start new rounds in all games; ``seed`` decides everything that the games and the network draw."""
        self._played += 1  # so that running games are not reused
        self._seed, self._first = seed, self._played
        self._states: list[bytes | None] = [None] * len(self.parts)
        self.counts.clear()

    def play(
        self,
        network: EntityNetwork,
        steps: int,
        how: How = "drawn",
        on_fragment: Callable[[Fragment], object] = lambda fragment: None,
    ) -> list[Fragment]:
        """Play the next ``steps`` decisions in each game; return the fragments by part."""
        network = network if next(network.parameters()).device.type == "cpu" else copy.deepcopy(network)
        first = np.cumsum([0, *(part.games for part in self.parts)]).tolist()
        since_reset = self._played - self._first
        tasks = [
            Task(
                key=(self._number, k),
                number=self._played,
                part=part,
                games_seed=self._seed + first[k],
                state=self._states[k],
                network=network,
                seed=int(np.random.SeedSequence(self._seed, spawn_key=(since_reset, k)).generate_state(1)[0]),
                steps=steps,
                how=how,
            )
            for k, part in enumerate(self.parts)
        ]
        played = self._executor.map(fragments.play, tasks, on_fragment, keys=[task.key for task in tasks])
        self._played += 1
        for k, fragment in enumerate(played):
            self._states[k] = fragment.state
            for ending in fragment.endings:
                if ending.level is not None:
                    self.counts.add(k, ending.level, ending.outcome == "complete")
        return played

    def close(self) -> None:
        fragments.forget()
