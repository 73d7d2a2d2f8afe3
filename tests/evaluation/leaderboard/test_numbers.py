import numpy as np
import pytest
from numpy.typing import NDArray

from pacman_env.episodes.statistics import paired_difference, wilson
from pacman_env.evaluation.leaderboard.numbers import Against, against, means, policy_in_cell, verdicts, worst_tenth
from pacman_env.evaluation.leaderboard.numbers import CellResult as Cell
from pacman_env.evaluation.rounds.summary import ENDS
from tests.evaluation.helpers import records


def rounds(end: str, time_s: float = 10.0) -> NDArray:
    ends = {letter: code for code, letter in ENDS.items()}
    result = records([ends[letter] for letter in end], [8 if letter == "C" else 2 for letter in end])
    result["time_s"] = time_s
    return result


def test_policy_numbers_are_computed_from_its_rounds() -> None:
    one, other = rounds("CCDT", 30.0), rounds("CDDL", 50.0)
    found = policy_in_cell("mine", [one, other])
    assert (found.completion_rate, found.death_rate, found.timeout_rate, found.cleared_rate) == (
        3 / 8,
        3 / 8,
        1 / 8,
        1 / 8,
    )
    assert tuple(found.completion_ci) == wilson(3, 8)
    assert found.pellets_share == pytest.approx((3 * 1.0 + 5 * 0.25) / 8)
    assert found.win_time_mean_s == pytest.approx((30 + 30 + 50) / 3)
    worst = found.worst_tenth
    assert worst is not None
    assert (worst.places, worst.worst, worst.low) == (2, 1, 1 / 4)  # the second map
    # By rounds 1 and 3 the second map is the worst: C, D. By rounds 0 and 2 both are equal: C, T and D, L.
    assert worst.high == pytest.approx((1 / 2 + 1 / 4) / 2)
    assert policy_in_cell("mine", [rounds("DDDD")]).win_time_mean_s is None


def test_worst_tenth_is_exact_for_known_levels() -> None:
    """20 levels of 10 rounds; of level k the first k // 2 are completed."""
    level = np.repeat(np.arange(20), 10)
    complete = np.tile(np.arange(10), 20) < level // 2
    worst = worst_tenth(complete, level)
    assert worst is not None
    assert (worst.places, worst.worst, worst.low) == (20, 2, 0.0)
    # By rounds 0, 2, ... the first two levels are the worst, and complete nothing. By rounds 1, 3, ... the first four
    # are equal, and two of them complete round 0.
    assert worst.high == pytest.approx((0.0 + 0.1) / 2)
    worst = worst_tenth(~complete, level)
    assert worst is not None
    assert worst.low == pytest.approx(0.1)  # the last two levels complete their last round
    # By rounds 0, 2, ... the last two levels are the worst, and complete one of five others. By rounds 1, 3, ... the
    # last four are equal, and two of them complete one of five others, two none.
    assert worst.high == pytest.approx((0.2 + 0.1) / 2)
    order = np.random.default_rng(0).permutation(200)
    assert worst_tenth(~complete[order], level[order]).low == pytest.approx(0.1)  # type: ignore[union-attr]


def test_worst_tenth_ignores_places_with_few_rounds() -> None:
    level = np.array([0] * 3 + [1] * 4)
    worst = worst_tenth(level == 1, level)
    assert worst is not None
    assert (worst.places, worst.low, worst.high) == (1, 1.0, 1.0)
    assert worst_tenth(np.ones(3, np.bool_), np.zeros(3, np.int64)) is None


@pytest.mark.parametrize("each", [4, 10, 40])
def test_worst_tenth_interval_contains_true_value(each: int) -> None:
    """100 levels whose completion is 0.5 to 0.995: the worst tenth complete 0.5225 of their rounds."""
    chance = 0.5 + 0.005 * np.arange(100)
    truth = chance[:10].mean()
    rng = np.random.default_rng(3)
    level = np.repeat(np.arange(100), each)
    found = [worst_tenth(rng.random(100 * each) < chance[level], level) for _ in range(60)]
    low, high = (np.mean([getattr(one, side) for one in found]) for side in ("low", "high"))
    assert low < truth < high
    assert (truth - low < 0.07) == (each == 40)  # with few rounds a level it is far too low


def test_planner_is_compared_with_best_other_policy() -> None:
    planner = rounds("C" * 60 + "D" * 40)
    others = {"low": [rounds("D" * 100)], "best": [rounds("C" * 20 + "D" * 80)], "same": [rounds("D" * 80 + "C" * 20)]}
    found = against([planner], others)
    assert found is not None
    assert (found.other, found.verdict) == ("best", "better")
    assert (found.difference, found.ci) == paired_difference(np.arange(100) < 60, np.arange(100) < 20)
    assert against(others["low"], {"planner": [planner]}).verdict == "WORSE"  # type: ignore[union-attr]
    assert against([planner], {"planner": [planner]}).verdict == "not different"  # type: ignore[union-attr]
    assert against([planner], {}) is None


def test_cell_means_have_equal_weights() -> None:
    def cell(group: str, speed: float, end: str, verdict: str) -> Cell:
        result = Against("other", 0.0, (0.0, 0.0), verdict)  # type: ignore[arg-type]
        return Cell(group, ("wander",), speed, len(end), (policy_in_cell("mine", [rounds(end)]),), result)

    cells = [
        cell("test levels", 0.1, "CC", "better"),
        cell("test levels", 0.2, "CDDD", "WORSE"),
        cell("given maps", 0.1, "DC", "WORSE"),
    ]
    first, second = means(cells)
    assert (first.group, first.mean, first.least, first.least_cell) == ("test levels", 0.625, 0.25, 1)
    assert (second.group, second.mean, second.least, second.least_cell) == ("given maps", 0.5, 0.5, 2)
    assert verdicts(cells) == {"better": 1, "not different": 0, "WORSE": 2}
