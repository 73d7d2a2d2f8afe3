"""When the planner is asked: by the rule, for one robot, and for the simulator's games at the same ticks."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacman_env.config import ConfigError, make_config
from pacman_env.game.decisions import HOLD, LastDecision, Moment, decision_due, decision_rules
from pacman_env.game.ends import RUNNING
from pacman_env.game.execution import NO_CHOICE
from pacman_env.sim import kernels
from pacman_env.sim.parameters import GAME, LAST_DECISION, batch_parameters

RULES = SimpleNamespace(**decision_rules(make_config(), float))
FAR, NEAR = RULES.threat_distance + 1.0, RULES.threat_distance - 0.5


def due(choice: int = 3, pursued: int = 3, news: bool = False, **other: float) -> bool:
    seen = {"before": FAR, "now": FAR, "waited": 0.5, **other}
    return bool(decision_due(choice, pursued, news, *seen.values(), RULES))


def test_decision_is_due_when_goal_or_pellets_change() -> None:
    assert not due()
    assert not due(HOLD, HOLD)
    assert due(3, HOLD)  # the goal has ended
    assert due(3, 2)  # the goal was not taken up
    assert due(HOLD, 2)
    assert due(news=True)  # a pellet, or the end of the round


def test_near_ghost_asks_once_then_at_short_intervals() -> None:
    assert due(before=FAR, now=NEAR)
    assert not due(before=NEAR, now=NEAR)
    assert due(before=NEAR, now=NEAR, waited=RULES.threat_longest)
    assert not due(before=NEAR, now=FAR, waited=RULES.threat_longest)
    assert all(due(before=before, now=now, waited=RULES.longest) for before in (FAR, NEAR) for now in (FAR, NEAR))


@pytest.mark.parametrize(
    ("settings", "named"),
    [
        ({"decisions.when": "event", "decisions.longest_s": 0.4}, "decisions.longest_s"),
        ({"decisions.when": "event", "decisions.threat_longest_s": 0.1}, "threat_longest_s"),
        ({"decisions.when": "event", "action": "velocity"}, "decisions.when"),
    ],
)
def test_impossible_rules_are_refused_by_name(settings: dict[str, object], named: str) -> None:
    with pytest.raises(ConfigError, match=named):
        make_config("robot", "robust", **settings)


# One robot


PELLETS, REFUGES = 3, 1
SIM_HOLD = PELLETS + REFUGES
CONFIG = make_config(**{"decisions.when": "event"})
TICK_S = CONFIG.execution.tick_s


def moment(time_s: float, pursued: int = 1, distance: float = FAR) -> Moment:
    return Moment(time_s, pursued, "all", distance)


def decided(choice: int = 1, config: Any = CONFIG, **at: Any) -> LastDecision:
    last = LastDecision(config)
    last.decide(choice, moment(0.0, **at))
    return last


def test_the_first_decision_of_a_round_is_due() -> None:
    last = LastDecision(CONFIG)
    assert last.due(moment(0.0))
    last.decide(1, moment(0.0))
    assert not last.due(moment(TICK_S))
    last.clear()
    assert last.due(moment(TICK_S))
    assert decided(config=make_config()).due(moment(TICK_S))  # decisions at each tick


@pytest.mark.parametrize(
    ("distance", "longest_s"), [(FAR, CONFIG.decisions.longest_s), (NEAR, CONFIG.decisions.threat_longest_s)]
)
@pytest.mark.parametrize("early", [0.0, 0.2, -0.2])  # of a tick, as timers are
def test_longest_time_tolerates_early_and_late_timers(distance: float, longest_s: float, early: float) -> None:
    last = decided(distance=distance)
    due = [tick for tick in range(1, 20) if last.due(moment((tick - early) * TICK_S, distance=distance))]
    assert due[0] == round(longest_s / TICK_S)


def test_forbidden_choice_holds_and_asks_again() -> None:
    last = LastDecision(CONFIG)
    last.decide(2, moment(0.0), allowed=False)
    assert last.choice == HOLD
    assert last.due(moment(TICK_S, pursued=HOLD))
    assert decided().due(moment(-1.0))  # the clock was set back


ticks = st.lists(
    st.tuples(
        st.integers(0, SIM_HOLD),  # what the planner says if it is asked
        st.sampled_from(["chosen", "chosen", "chosen", "none", "other"]),  # what is pursued after the tick
        st.booleans() | st.just(False),  # a pellet is collected in it
        st.sampled_from([NEAR, FAR, CONFIG.decisions.threat_distance_m]),
        st.sampled_from([False] * 15 + [True]),  # a round follows
    ),
    min_size=10,
    max_size=60,
)


@settings(max_examples=150, deadline=None)
@given(ticks=ticks)
def test_simulator_asks_at_the_same_ticks(ticks: list[tuple[int, str, bool, float, bool]]) -> None:
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
