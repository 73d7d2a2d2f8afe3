from __future__ import annotations

import json

import numpy as np
import pytest

from eval.rows import Row, make_row
from eval.statistics import paired_difference, wilson
from tests.eval.helpers import FIVE, OTHER_FIVE, records

PROMISED = {
    "map", "policy", "clyde_speed", "episodes", "completion_rate", "completion_ci", "all_but_one_rate",
    "all_but_one_ci", "pellets_mean", "death_rate", "timeout_rate", "time_mean_s", "decision_ms_p50",
    "decision_ms_p99", "paired_difference", "paired_ci",
}  # fmt: skip


def row(rounds: np.ndarray = FIVE, first: np.ndarray | None = None) -> Row:
    times = np.arange(101.0)
    return make_row(map_name="m", policy="p", clyde_speed=0.25, records=rounds, decision_ms=times, first=first)


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
