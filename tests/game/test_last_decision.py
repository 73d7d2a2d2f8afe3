"""One robot's last decision: when it holds, when another is due, and that the simulator says the same."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacman_env.config import make_config
from pacman_env.game.decisions import HOLD, LastDecision, Moment
from pacman_env.game.execution import NO_CHOICE, RUNNING
from pacman_env.sim.core import kernels
from pacman_env.sim.core.parameters import GAME, LAST_DECISION, batch_parameters

PELLETS, REFUGES = 3, 1
SIM_HOLD = PELLETS + REFUGES
CONFIG = make_config(**{"decisions.when": "event"})
TICK_S = CONFIG.execution.tick_s
RULES = CONFIG.decisions
FAR, NEAR = RULES.threat_distance_m + 1.0, RULES.threat_distance_m - 0.5


def moment(time_s: float, pursued: int = 1, pellets: object = "all", distance: float = FAR) -> Moment:
    return Moment(time_s, pursued, pellets, distance)


def decided(choice: int = 1, config: Any = CONFIG, **at: Any) -> LastDecision:
    last = LastDecision(config)
    last.decide(choice, moment(0.0, **at))
    return last


def test_the_first_decision_of_a_round_is_due() -> None:
    last = LastDecision(CONFIG)
    assert last.due(moment(0.0))
    last.decide(1, moment(0.0))
    assert not last.due(moment(TICK_S))
    last.forget()
    assert last.due(moment(TICK_S))


def test_at_each_tick_every_decision_is_due() -> None:
    assert decided(config=make_config()).due(moment(TICK_S))


@pytest.mark.parametrize(
    ("later", "due"),
    [
        ({}, False),
        ({"pursued": HOLD}, True),
        ({"pellets": "one less"}, True),
        ({"distance": NEAR}, True),
    ],
)
def test_a_goal_ended_a_pellet_gone_and_a_threat_make_another_due(later: dict[str, Any], due: bool) -> None:
    assert decided().due(moment(TICK_S, **later)) == due


@pytest.mark.parametrize(("distance", "longest_s"), [(FAR, RULES.longest_s), (NEAR, RULES.threat_longest_s)])
@pytest.mark.parametrize("early", [0.0, 0.2, -0.2])  # of a tick, as timers are
def test_after_the_longest_time_another_is_due_though_the_timer_is_early_or_late(
    distance: float, longest_s: float, early: float
) -> None:
    last = decided(distance=distance)
    due = [tick for tick in range(1, 20) if last.due(moment((tick - early) * TICK_S, distance=distance))]
    assert due[0] == round(longest_s / TICK_S)


def test_a_choice_that_is_not_allowed_is_to_hold_and_asks_at_the_next_tick() -> None:
    last = LastDecision(CONFIG)
    last.decide(2, moment(0.0), allowed=False)
    assert last.choice == HOLD
    assert last.due(moment(TICK_S, pursued=HOLD))


def test_a_clock_that_is_set_back_asks() -> None:
    last = LastDecision(CONFIG)
    last.decide(1, moment(100.0))
    assert last.due(moment(3.0))


ticks = st.lists(
    st.tuples(
        st.integers(0, SIM_HOLD),  # what the planner says if it is asked
        st.sampled_from(["chosen", "chosen", "chosen", "none", "other"]),  # what is pursued after the tick
        st.booleans() | st.just(False),  # a pellet is collected in it
        st.sampled_from([NEAR, FAR, RULES.threat_distance_m]),
        st.sampled_from([False] * 15 + [True]),  # a round follows
    ),
    min_size=10,
    max_size=60,
)


@settings(max_examples=300, deadline=None)
@given(ticks=ticks)
def test_the_simulators_games_are_asked_at_the_same_ticks(ticks: list[tuple[int, str, bool, float, bool]]) -> None:
    games, before, last = np.zeros(1, GAME), np.zeros(1, LAST_DECISION), LastDecision(CONFIG)
    game, parameters = games[0], batch_parameters(CONFIG, 0.05, PELLETS, REFUGES)
    game["end"], game["pursued"], game["distance"], game["round"] = RUNNING, NO_CHOICE, FAR, 1
    awake = np.zeros(1, np.bool_)
    choice = np.full(1, SIM_HOLD)
    for name in ("tick", "distance", "round"):
        before[name] = games[name]
    for said, pursued, collects, distance, follows in ticks:
        now = Moment(
            float(game["tick"]) * TICK_S,
            int(game["pursued"]),
            (int(game["round"]), int(game["collected"])),
            float(game["distance"]),
        )
        assert last.due(now) == (not awake[0])
        if not awake[0]:
            choice[0], awake[0] = said, True
            for name in ("tick", "distance", "round"):
                before[name] = games[name]
            last.decide(HOLD if said == SIM_HOLD else said, now)
        goal = NO_CHOICE if choice[0] == SIM_HOLD else int(choice[0])
        game["pursued"] = {"chosen": goal, "none": NO_CHOICE, "other": (goal + 1) % SIM_HOLD}[pursued]
        game["distance"] = distance
        game["tick_pellets"] = collects
        game["collected"] += collects
        game["tick"] += 1
        if follows:
            game["round"] += 1
            game["tick"] = game["collected"] = 0
        awake[0] = not kernels.due(game, choice[0], before[0], parameters[0])
