import json

import numpy as np
import pytest

from pacman_env.episodes.statistics import bootstrapped_mean, paired_difference, wilson
from pacman_env.evaluation.rounds.summary import Row, make_row, worst_tenth
from pacman_env.game.ends import CAUGHT, COMPLETE, TIMEOUT
from tests.evaluation.helpers import FIVE, OTHER_FIVE, records

PROMISED = {
    "policy", "episodes", "completion_rate", "completion_ci", "all_but_one_rate",
    "all_but_one_ci", "pellets_mean", "death_rate", "timeout_rate", "time_mean_s", "decision_ms_p50",
    "decision_ms_p99", "paired_difference", "paired_ci", "kind", "levels", "pellets", "pellets_least", "decision_ms",
    "outcomes", "ghosts_caught_mean", "ghosts_caught_ci",
}  # fmt: skip


def row(rounds: np.ndarray = FIVE, first: np.ndarray | None = None, endless: bool = False) -> Row:
    others = None if first is None else [first]
    return make_row({"policy": "p"}, [(rounds, np.arange(101.0))], others, endless=endless)


def test_row_contains_every_documented_key_as_json() -> None:
    assert set(row()) >= PROMISED
    assert json.loads(json.dumps(row(), allow_nan=False)) == row()


def test_row_counts_rounds_by_how_they_ended() -> None:
    r = row()
    assert (r["episodes"], r["completion_rate"], r["all_but_one_rate"]) == (5, 0.4, 0.6)
    assert (r["death_rate"], r["timeout_rate"], r["cleared_rate"]) == (0.2, 0.2, 0.2)
    assert (r["pellets_mean"], r["time_mean_s"], r["win_time_mean_s"]) == (5.0, 30.0, 15.0)
    assert (r["decision_ms_p50"], r["decision_ms_p99"]) == (50.0, 99.0)
    assert r["completion_ci"] == list(wilson(2, 5))
    assert r["all_but_one_ci"] == list(wilson(3, 5))
    assert (r["paired_difference"], r["paired_ci"]) == (0.0, [0.0, 0.0])  # to no other policy
    assert row(records([CAUGHT, CAUGHT], [0, 3]))["win_time_mean_s"] is None


@pytest.mark.parametrize("endless", [False, True])
def test_caught_ghosts_are_averaged_with_an_interval(endless: bool) -> None:
    several = FIVE.copy()
    several["ghosts_caught"] = [0, 4, 1, 0, 2]
    r = row(several, endless=endless)
    assert r["ghosts_caught_mean"] == pytest.approx(1.4)
    assert 0.0 <= r["ghosts_caught_ci"][0] < 1.4 < r["ghosts_caught_ci"][1] <= 4.0
    assert (row(endless=endless)["ghosts_caught_mean"], row()["ghosts_caught_ci"]) == (0.0, [0.0, 0.0])


def test_difference_is_paired_by_round() -> None:
    r = row(OTHER_FIVE, first=FIVE)
    ours, theirs = OTHER_FIVE["collected"] == 8, FIVE["collected"] == 8
    expected, interval = paired_difference(ours, theirs)
    assert r["paired_difference"] == expected == pytest.approx(-0.2)
    assert r["paired_ci"] == list(interval)


def test_rounds_of_other_seeds_are_refused() -> None:
    other = OTHER_FIVE.copy()
    other["seed"] += np.uint64(1)
    with pytest.raises(ValueError, match="not the seeds"):
        row(other, first=FIVE)


def test_outcomes_list_rounds_in_seed_order() -> None:
    times = [10.0, 20.0, 30.0, 40.0, 50.0]
    assert row()["outcomes"] == {"end": "CCLDT", "collected": [8, 8, 7, 2, 0], "time_s": times}


def test_row_counts_levels_and_fewest_pellets() -> None:
    several = FIVE.copy()
    several["level"], several["spawned"] = [7, 7, 8, 9, 7], [8, 8, 8, 5, 8]
    r = row(several)
    assert (r["levels"], r["pellets"], r["pellets_least"]) == (3, 8, 5)
    assert r["outcomes"]["level"] == [7, 7, 8, 9, 7]
    assert (row()["levels"], row()["pellets_least"]) == (1, 8)


def test_decision_times_are_percentiles() -> None:
    times = row()["decision_ms"]
    assert list(times) == ["p1", "p5", "p25", "p50", "p75", "p95", "p99", "p99.9"]
    assert [times["p1"], times["p50"], times["p99"]] == [1.0, 50.0, 99.0]


def test_endless_row_counts_pellets_and_rounds() -> None:
    games = records([CAUGHT, CAUGHT, TIMEOUT], [3, 20, 40])
    games["rounds"] = [0, 2, 5]
    r = row(games, endless=True)
    assert json.loads(json.dumps(r, allow_nan=False)) == r
    assert (r["kind"], r["pellets_mean"], r["pellets_median"]) == ("endless", 21.0, 20.0)
    assert (r["rounds_mean"], r["rounds_most"]) == (pytest.approx(7 / 3), 5)
    assert r["pellets_ci"] == list(bootstrapped_mean([np.array([3.0, 20.0, 40.0])], np.random.default_rng(0))[1])
    assert r["outcomes"]["rounds"] == [0, 2, 5]
    assert not {name for name in r if name.startswith(("completion", "all_but_one", "win"))}


def test_endless_difference_is_paired_by_game() -> None:
    ours, theirs = records([CAUGHT] * 4, [10, 20, 30, 40]), records([CAUGHT] * 4, [8, 18, 28, 38])
    r = row(ours, first=theirs, endless=True)
    assert (r["paired_difference"], r["paired_ci"]) == (2.0, [2.0, 2.0])  # unpaired, they would not differ
    assert row(theirs, endless=True)["paired_ci"] == [0.0, 0.0]


def test_row_of_several_maps_is_stratified() -> None:
    games = [records([CAUGHT] * 3, [10, 10, 10]), records([CAUGHT] * 3, [30, 30, 30])]
    r = make_row({}, [(one, np.ones(1)) for one in games], endless=True)
    assert (r["pellets_mean"], r["pellets_ci"], r["episodes"]) == (20.0, [20.0, 20.0], 6)
    assert "outcomes" not in r


def on_levels(complete: np.ndarray, level: np.ndarray) -> np.ndarray:
    rounds = records([COMPLETE if one else CAUGHT for one in complete], [8] * len(complete))
    rounds["level"] = level
    return rounds


def test_worst_tenth_is_exact_for_known_levels() -> None:
    """20 levels of 10 rounds; of level k the first k // 2 are completed."""
    level = np.repeat(np.arange(20), 10)
    complete = np.tile(np.arange(10), 20) < level // 2
    # By rounds 0, 2, ... the first two levels are the worst, and complete nothing. By rounds 1, 3, ... the first four
    # are equal, and two of them complete round 0.
    expected = {"places": 20, "worst": 2, "low": 0.0, "high": pytest.approx((0.0 + 0.1) / 2)}
    assert worst_tenth([on_levels(complete, level)]) == expected
    # The last two levels complete their last round. By rounds 0, 2, ... they are the worst, and complete one of five
    # others. By rounds 1, 3, ... the last four are equal, and two of them complete one of five others, two none.
    expected |= {"low": pytest.approx(0.1), "high": pytest.approx((0.2 + 0.1) / 2)}
    assert worst_tenth([on_levels(~complete, level)]) == expected


def test_worst_tenth_ignores_places_with_few_rounds() -> None:
    level = np.array([0] * 3 + [1] * 4)
    found = worst_tenth([on_levels(level == 1, level)])
    assert found == {"places": 1, "worst": 1, "low": 1.0, "high": 1.0}
    assert worst_tenth([on_levels(np.ones(3), np.zeros(3))]) is None


def test_worst_tenth_of_several_maps_counts_maps() -> None:
    maps = [on_levels(np.array([1, 1, 0, 0]), np.arange(4)), on_levels(np.array([1, 0, 0, 0]), np.arange(4))]
    # By rounds 1 and 3 the second map is the worst: C, D. By rounds 0 and 2 both are equal: C, D and D, D.
    assert worst_tenth(maps) == {"places": 2, "worst": 1, "low": 0.25, "high": pytest.approx((1 / 2 + 1 / 4) / 2)}
