"""Games that a network learns in, divided into parts; threads play them fragment by fragment."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence

import numpy as np

from pacman_env.executors.executor import Executor
from pacman_env.training import fragments
from pacman_env.training.fragments import Fragment, How, RunningPart, use_device
from pacman_env.training.learnability import LevelCounts
from pacman_env.training.planner_network import EntityNetwork
from pacman_env.training.training_games import Part, PlannerPart


class Collector:
    """Plays fragments, which depend only on the seed and the network, not on the number of threads."""

    def __init__(self, parts: Sequence[Part], executor: Executor) -> None:
        if not parts:
            raise ValueError("no games to play")
        self.parts, self._executor = list(parts), executor
        self.num_envs = sum(part.games for part in parts)
        planners = [part if isinstance(part, PlannerPart) else None for part in parts]
        #: Counts of the rounds that ended since :meth:`reset`.
        self.counts = LevelCounts([part.lineup if part and part.may_repeat else None for part in planners])
        use_device("cpu")
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Start new rounds in all games; ``seed`` decides everything that the games and the network draw."""
        self._seed = seed
        self._played = 0  # number of the next fragment of each part
        self._running: list[RunningPart | None] = [None] * len(self.parts)
        self.counts.clear()

    def play(
        self,
        network: EntityNetwork,
        steps: int,
        how: How = "drawn",
        on_fragment: Callable[[Fragment], object] = lambda fragment: None,
    ) -> list[Fragment]:
        """Play the next ``steps`` decisions in each game, and return one fragment per part.

        ``how`` selects the player; ``on_fragment`` is called with each fragment as soon as it is played.
        """
        network = network if next(network.parameters()).device.type == "cpu" else copy.deepcopy(network).cpu()
        first = np.cumsum([0, *(part.games for part in self.parts)]).tolist()

        def play_part(k: int) -> Fragment:
            running = self._running[k] or RunningPart(self.parts[k], self._seed + first[k])
            self._running[k] = running
            seed = int(np.random.SeedSequence(self._seed, spawn_key=(self._played, k)).generate_state(1)[0])
            return fragments.play(running, network, steps, how, seed)

        played = self._executor.map(play_part, range(len(self.parts)), on_fragment)
        self._played += 1
        for k, fragment in enumerate(played):
            for ending in fragment.endings:
                if ending.level is not None:
                    self.counts.add(k, ending.level, ending.outcome == "complete")
        return played
