"""Which houses of a segment are worth playing again: those in which some rounds were completed, and some were not.

A house is judged by p (1 - p), p its share of completed rounds: the variance of completing (Rutherford et al., "No
regrets: investigating and improving regret approximations for curriculum discovery", 2024).
"""

from collections.abc import Sequence

_FEWEST_ROUNDS = 6  # by which a level is judged


class LevelCounts:
    """Rounds that ended, by sub-batch and level."""

    def __init__(self, lineups: Sequence[str | None]) -> None:
        """``lineups``: of each sub-batch; None: its levels are not played again."""
        self.lineups = list(lineups)
        self.clear()

    def clear(self) -> None:
        self._counts: list[dict[int, tuple[int, int]]] = [{} for _ in self.lineups]  # completed, all

    def add(self, sub_batch: int, level: int, completed: bool) -> None:
        won, rounds = self._counts[sub_batch].get(level, (0, 0))
        self._counts[sub_batch][level] = won + completed, rounds + 1

    def best(self) -> dict[str, list[int]]:
        """By line-up, the levels to be played again, the best first; at most half of those that it has played."""
        found: dict[str, list[int]] = {}
        for lineup in dict.fromkeys(one for one in self.lineups if one is not None):
            own = [counts for one, counts in zip(self.lineups, self._counts, strict=True) if one == lineup]
            judged = {
                level: won * (rounds - won) / rounds**2
                for counts in own
                for level, (won, rounds) in counts.items()
                if rounds >= _FEWEST_ROUNDS and 0 < won < rounds
            }
            order = sorted(judged, key=lambda level: (-judged[level], level))
            found[lineup] = order[: sum(map(len, own)) // 2]
        return found
