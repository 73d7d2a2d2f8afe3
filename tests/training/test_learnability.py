"""Houses in which some rounds were completed and some were not are played again, the evenest first."""

from pacman_env.training.learnability import LevelCounts


def counted(lineups: list[str | None], *rounds: tuple[int, int, int, int]) -> LevelCounts:
    """``rounds``: of a sub-batch, a level: completed, all."""
    counts = LevelCounts(lineups)
    for sub_batch, level, won, number in rounds:
        for k in range(number):
            counts.add(sub_batch, level, k < won)
    return counts


def test_half_completed_levels_come_first() -> None:
    counts = counted(
        ["chase"], (0, 3, 1, 10), (0, 5, 5, 10), (0, 9, 0, 10), (0, 2, 10, 10), (0, 4, 3, 10), (0, 1, 4, 9)
    )
    assert counts.best() == {"chase": [5, 1, 4]}  # of six; 9 is never completed, 2 always


def test_levels_with_few_rounds_are_ignored() -> None:
    assert counted(["chase"], (0, 1, 2, 5), (0, 2, 3, 6)).best() == {"chase": [2]}


def test_counts_are_summed_over_sub_batches_of_lineup() -> None:
    counts = counted(["chase", None, "wander", "chase"], (0, 1, 3, 6), (1, 2, 3, 6), (2, 3, 3, 6), (3, 4, 2, 6))
    assert counts.best() == {"chase": [1], "wander": []}  # half of two, half of one


def test_counts_are_empty_after_clearing() -> None:
    counts = counted(["chase"], (0, 1, 3, 6), (0, 2, 3, 6))
    counts.clear()
    assert counts.best() == {"chase": []}
