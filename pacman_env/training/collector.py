"""Games that a network learns in, divided into parts; threads play them fragment by fragment."""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence

import numpy as np

from pacman_env.executors.executor import Executor
from pacman_env.sb3 import Observation
from pacman_env.training import fragments
from pacman_env.training.fragments import Fragment, How, use_device
from pacman_env.training.learnability import LevelCounts
from pacman_env.training.planner_network import EntityNetwork
from pacman_env.training.training_games import Games


class Collector:
    """Plays fragments, which depend only on the seed and the network, not on the number of threads."""

    def __init__(self, parts: Sequence[Games], executor: Executor) -> None:
        if not parts:
            raise ValueError("no games to play")
        self.parts, self._executor = list(parts), executor
        self.num_envs = sum(part.num_envs for part in parts)
        use_device("cpu")
        self.reset(0)

    def reset(self, seed: int) -> None:
        """Start new rounds in all games; ``seed`` decides everything that the games and the network draw."""
        self._seed = seed
        self._played = 0  # number of the next fragment of each part
        self._observations: list[Observation | None] = [None] * len(self.parts)
        #: Counts of the rounds that ended since the reset.
        self.counts = LevelCounts(part.repeats for part in self.parts if part.repeats is not None)

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
        first = np.cumsum([0, *(part.num_envs for part in self.parts)]).tolist()

        def play_part(k: int) -> Fragment:
            part = self.parts[k]
            observation = self._observations[k] or part.reset(self._seed + first[k])
            seed = int(np.random.SeedSequence(self._seed, spawn_key=(self._played, k)).generate_state(1)[0])
            fragment, self._observations[k] = fragments.play(part, observation, network, steps, how, seed)
            return fragment

        played = list(self._executor.map(play_part, range(len(self.parts)), on_fragment))
        self._played += 1
        for part, fragment in zip(self.parts, played, strict=True):
            for ending in fragment.endings:
                if part.repeats is not None and ending.level is not None:
                    self.counts.add(part.repeats, ending.level, ending.outcome == "complete")
        return played
