"""Houses in which some rounds were completed and some were not are played again, the evenest first."""

from pacman_env.training.collector import LevelCounts


def counted(*rounds: tuple[str, int, int, int]) -> LevelCounts:
    """``rounds``: against a line-up, on a level: completed, all."""
    counts = LevelCounts(["chase", "wander"])
    for lineup, level, won, number in rounds:
        for k in range(number):
            counts.add(lineup, level, k < won)
    return counts


def test_half_completed_levels_come_first() -> None:
    chase = [(3, 1, 10), (5, 5, 10), (9, 0, 10), (2, 10, 10), (4, 3, 10), (1, 4, 9)]
    counts = counted(*(("chase", *rounds) for rounds in chase))
    assert counts.best()["chase"] == [5, 1, 4]  # of six; 9 is never completed, 2 always


def test_levels_with_few_rounds_are_ignored() -> None:
    assert counted(("chase", 1, 2, 5), ("chase", 2, 3, 6)).best()["chase"] == [2]


def test_counts_are_separate_for_each_lineup() -> None:
    counts = counted(("chase", 1, 3, 6), ("wander", 3, 3, 6), ("chase", 4, 2, 6))
    assert counts.best() == {"chase": [1], "wander": []}  # half of two, half of one
