"""When the planner is asked."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.config import ConfigError, make_config
from pacman_env.game.decisions import HOLD, decision_due, decision_rules

RULES = SimpleNamespace(**decision_rules(make_config(), float))
FAR, NEAR = RULES.threat_distance + 1.0, RULES.threat_distance - 0.5


def due(
    choice: int = 3,
    pursued: int | None = None,
    news: bool = False,
    before: float = FAR,
    now: float = FAR,
    waited: float = 0.5,
) -> bool:
    return bool(decision_due(choice, choice if pursued is None else pursued, news, before, now, waited, RULES))


def test_a_robot_on_its_way_is_left_alone() -> None:
    assert not due()
    assert not due(choice=HOLD)


def test_the_end_of_the_goal_asks() -> None:
    assert due(pursued=HOLD)


def test_a_goal_that_was_not_taken_up_asks() -> None:
    assert due(choice=3, pursued=2)
    assert due(choice=HOLD, pursued=2)


def test_a_pellet_or_the_end_of_the_round_asks() -> None:
    assert due(news=True)


def test_a_ghost_that_comes_near_asks_once_and_then_in_short_intervals() -> None:
    assert due(before=FAR, now=NEAR)
    assert not due(before=NEAR, now=NEAR)
    assert due(before=NEAR, now=NEAR, waited=RULES.threat_longest)
    assert not due(before=NEAR, now=FAR, waited=RULES.threat_longest)


@given(st.floats(0, 10), st.floats(0, 10))
def test_after_the_longest_interval_it_is_asked_in_any_case(before: float, now: float) -> None:
    assert due(before=before, now=now, waited=RULES.longest)


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"decisions.when": "event", "decisions.longest_s": 0.4}, "decisions.longest_s"),
        ({"decisions.when": "event", "decisions.threat_longest_s": 0.1}, "threat_longest_s"),
        ({"decisions.when": "event", "action": "velocity"}, "decisions.when"),
        ({"decisions.discount_per_s": 0.0}, "decisions.discount_per_s"),
        ({"decisions.when": "never"}, "decisions.when"),
    ],
)
def test_rules_that_make_no_sense_are_refused_by_name(settings: dict[str, object], named: str) -> None:
    with pytest.raises(ConfigError, match=named):
        make_config("robot", "robust", **settings)
