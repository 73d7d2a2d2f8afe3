"""Selection of houses to play again: houses with both completed and lost rounds.

The score of a house is p (1 - p), the variance of completion at the share p of completed rounds (Rutherford et al.,
"No regrets: investigating and improving regret approximations for curriculum discovery", 2024).
"""

from collections.abc import Iterable

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
