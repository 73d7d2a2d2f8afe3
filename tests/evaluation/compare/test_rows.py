from __future__ import annotations

import json

import numpy as np
import pytest

from pacman_env.episodes.statistics import bootstrapped_mean, paired_difference, wilson
from pacman_env.evaluation.compare.rows import Row, make_row
from pacman_env.game.execution import DEAD, TIMEOUT
from tests.evaluation.helpers import CONFIG, ENDLESS, FIVE, OTHER_FIVE, records

PROMISED = {
    "map", "policy", "clyde_speed", "episodes", "completion_rate", "completion_ci", "all_but_one_rate",
    "all_but_one_ci", "pellets_mean", "death_rate", "timeout_rate", "time_mean_s", "decision_ms_p50",
    "decision_ms_p99", "paired_difference", "paired_ci", "kind", "levels", "pellets", "pellets_least", "decision_ms",
    "outcomes",
}  # fmt: skip


def row(rounds: np.ndarray = FIVE, first: np.ndarray | None = None) -> Row:
    return make_row("m", "p", CONFIG, (rounds, np.arange(101.0)), first)


def test_a_row_has_every_promised_key_and_goes_into_json() -> None:
    assert set(row()) >= PROMISED
    assert json.loads(json.dumps(row(), allow_nan=False)) == row()


def test_rounds_are_counted_by_their_ends() -> None:
    r = row()
    assert (r["episodes"], r["completion_rate"], r["all_but_one_rate"]) == (5, 0.4, 0.6)
    assert (r["death_rate"], r["timeout_rate"], r["cleared_rate"]) == (0.2, 0.2, 0.2)
    assert (r["pellets_mean"], r["time_mean_s"], r["win_time_mean_s"]) == (5.0, 30.0, 15.0)
    assert (r["decision_ms_p50"], r["decision_ms_p99"]) == (50.0, 99.0)
    assert r["completion_ci"] == list(wilson(2, 5))
    assert r["all_but_one_ci"] == list(wilson(3, 5))


def test_the_first_policy_differs_from_itself_by_nothing() -> None:
    assert (row()["paired_difference"], row()["paired_ci"]) == (0.0, [0.0, 0.0])


def test_other_policies_are_compared_round_by_round() -> None:
    r = row(OTHER_FIVE, first=FIVE)
    ours, theirs = OTHER_FIVE["collected"] == 8, FIVE["collected"] == 8
    expected, interval = paired_difference(ours, theirs)
    assert r["paired_difference"] == expected == pytest.approx(-0.2)
    assert r["paired_ci"] == list(interval)


def test_rounds_of_other_seeds_are_not_compared() -> None:
    other = OTHER_FIVE.copy()
    other["seed"] += np.uint64(1)
    with pytest.raises(ValueError, match="p on m: not the seeds"):
        row(other, first=FIVE)


def test_without_a_win_there_is_no_time_of_wins() -> None:
    assert row(records([1, 1], [0, 3]))["win_time_mean_s"] is None


def endless(rounds: np.ndarray = FIVE, first: np.ndarray | None = None) -> Row:
    return make_row("m", "p", ENDLESS, (rounds, np.arange(101.0)), first)


def test_outcomes_have_every_round_in_the_order_of_the_seeds() -> None:
    assert row()["outcomes"] == {
        "end": "CCLDT",
        "collected": [8, 8, 7, 2, 0],
        "time_s": [10.0, 20.0, 30.0, 40.0, 50.0],
    }


def test_rounds_on_several_levels_name_theirs_and_the_fewest_pellets() -> None:
    several = FIVE.copy()
    several["level"], several["spawned"] = [7, 7, 8, 9, 7], [8, 8, 8, 5, 8]
    r = row(several)
    assert (r["levels"], r["pellets"], r["pellets_least"]) == (3, 8, 5)
    assert r["outcomes"]["level"] == [7, 7, 8, 9, 7]
    assert (row()["levels"], row()["pellets_least"]) == (1, 8)


def test_decision_times_have_percentiles() -> None:
    times = row()["decision_ms"]
    assert list(times) == ["p1", "p5", "p25", "p50", "p75", "p95", "p99", "p99.9"]
    assert [times["p1"], times["p50"], times["p99"]] == [1.0, 50.0, 99.0]


def test_a_row_of_endless_games_counts_pellets_and_rounds_but_no_completion() -> None:
    games = records([DEAD, DEAD, TIMEOUT], [3, 20, 40])
    games["rounds"] = [0, 2, 5]
    r = endless(games)
    assert json.loads(json.dumps(r, allow_nan=False)) == r
    assert (r["kind"], r["pellets_mean"], r["pellets_median"]) == ("endless", 21.0, 20.0)
    assert (r["rounds_mean"], r["rounds_most"]) == (pytest.approx(7 / 3), 5)
    assert r["pellets_ci"] == list(bootstrapped_mean([np.array([3.0, 20.0, 40.0])], np.random.default_rng(0))[1])
    assert r["outcomes"]["rounds"] == [0, 2, 5]
    assert not {name for name in r if name.startswith(("completion", "all_but_one", "win"))}


def test_endless_games_are_compared_pair_by_pair() -> None:
    ours, theirs = records([DEAD] * 4, [10, 20, 30, 40]), records([DEAD] * 4, [8, 18, 28, 38])
    r = endless(ours, first=theirs)
    assert (r["paired_difference"], r["paired_ci"]) == (2.0, [2.0, 2.0])  # unpaired, they would not differ
    assert endless(theirs)["paired_ci"] == [0.0, 0.0]
