"""Selection of houses to play again: houses with both completed and lost rounds.

The score of a house is p (1 - p), the variance of completion at the share p of completed rounds (Rutherford et al.,
"No regrets: investigating and improving regret approximations for curriculum discovery", 2024).
"""

from collections.abc import Sequence

_FEWEST_ROUNDS = 6  # a level with fewer rounds is not judged


class LevelCounts:
    """Counts of completed and of all rounds, by sub-batch and level."""

    def __init__(self, lineups: Sequence[str | None]) -> None:
        """Start with no rounds; ``lineups``: one per sub-batch, None if its levels are not played again."""
        self.lineups = list(lineups)
        self.clear()

    def clear(self) -> None:
        self._counts: list[dict[int, tuple[int, int]]] = [{} for _ in self.lineups]  # completed rounds, all rounds

    def add(self, sub_batch: int, level: int, completed: bool) -> None:
        won, rounds = self._counts[sub_batch].get(level, (0, 0))
        self._counts[sub_batch][level] = won + completed, rounds + 1

    def best(self) -> dict[str, list[int]]:
        """Return the levels to play again by line-up, best first: at most half of the levels that the line-up met."""
        levels: dict[str, list[int]] = {}
        for lineup in dict.fromkeys(one for one in self.lineups if one is not None):
            own = [counts for one, counts in zip(self.lineups, self._counts, strict=True) if one == lineup]
            judged = {
                level: won * (rounds - won) / rounds**2
                for counts in own
                for level, (won, rounds) in counts.items()
                if rounds >= _FEWEST_ROUNDS and 0 < won < rounds
            }
            order = sorted(judged, key=lambda level: (-judged[level], level))
            levels[lineup] = order[: sum(map(len, own)) // 2]
        return levels
