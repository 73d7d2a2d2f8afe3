"""The fragment protocol, simulated with the real queue: each part's fragments come in order, each once."""

from __future__ import annotations

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from benchmarks.protocol import Setting, simulate


@settings(deadline=None, max_examples=40)
@given(
    st.integers(1, 12),
    st.integers(1, 30),
    st.floats(0.0, 0.4),
    st.floats(0.0, 1.0),
    st.floats(0.01, 50.0),
    st.integers(0, 10**6),
)
def test_every_fragment_comes_once_and_in_order_whoever_is_slow_or_lost(
    workers: int, parts: int, loss: float, slow: float, back_after_s: float, seed: int
) -> None:
    setting = Setting(workers, parts, 4, loss_per_fragment=loss, slow_workers=slow, back_after_s=back_after_s)
    found = simulate(setting, seed)
    assert found.played == [[0, 1, 2, 3]] * parts
    assert 0.0 < found.efficiency <= 1.0
    assert parts <= found.restored <= 4 * parts + found.lost


@pytest.mark.parametrize("workers", [10, 100, 1_000, 10_000])
def test_thousands_of_workers_play_what_ten_do(workers: int) -> None:
    found = simulate(Setting(workers, 2 * workers, 2, loss_per_fragment=0.01))
    assert found.played == [[0, 1]] * (2 * workers)
    assert found.lost > 0 or workers == 10


def test_games_stay_where_they_are_while_nobody_is_lost() -> None:
    found = simulate(Setting(7, 20, 10, loss_per_fragment=0.0))
    assert found.restored == 20
    fine = simulate(Setting(10, 20, 10, spread=0.0, slow_workers=0.0, loss_per_fragment=0.0))
    assert fine.efficiency > 0.9
