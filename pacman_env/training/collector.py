"""Games that a network learns in, divided into parts; threads play them fragment by fragment.

Houses with both completed and lost rounds may be played again. The score of a house is p (1 - p), the variance of
completion at the share p of completed rounds (Rutherford et al., "No regrets: investigating and improving regret
approximations for curriculum discovery", 2024).
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from pacman_env.executors.executor import Executor
from pacman_env.sb3 import Observation
from pacman_env.training import fragments
from pacman_env.training.fragments import Fragment, How, use_device
from pacman_env.training.planner_network import EntityNetwork
from pacman_env.training.training_games import Games

_FEWEST_ROUNDS = 6  # a level with fewer rounds is not judged


class LevelCounts:
    """Counts of completed and of all rounds, by line-up and level; they start without rounds."""

    def __init__(self, lineups: Iterable[str]) -> None:
        self._counts: dict[str, dict[int, tuple[int, int]]] = {lineup: {} for lineup in lineups}

    def add(self, lineup: str, level: int, completed: bool) -> None:
        won, rounds = self._counts[lineup].get(level, (0, 0))
        self._counts[lineup][level] = won + completed, rounds + 1

    def best(self) -> dict[str, list[int]]:
        """Return the levels to play again by line-up, best first: at most half of the levels that the line-up met."""
        levels: dict[str, list[int]] = {}
        for lineup, counts in self._counts.items():
            judged = [
                (-won * (rounds - won) / rounds**2, level)
                for level, (won, rounds) in counts.items()
                if rounds >= _FEWEST_ROUNDS and 0 < won < rounds
            ]
            levels[lineup] = [level for _, level in sorted(judged)[: len(counts) // 2]]
        return levels


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
