"""A right game has no violation; each thing that can be wrong with it is seen, by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from tests.system.campaign.verdict import Evidence, Outage, Record, Sample, outcome, violations

Change = Callable[[Evidence], Any]
MENU, HOME, STARTING, RUNNING, OVER, BACK = 1.0, 2.0, 2.1, 10.1, 30.0, 40.0  # robot's s


def at(time_s: float) -> int:
    return round(time_s * 1e9)


def publish(evidence: Evidence, time_s: float, *messages: tuple[str, object]) -> None:
    evidence.records += [Record(at(time_s), topic, value) for topic, value in messages]


def state(word: str) -> tuple[str, object]:
    return "game_state", word


def a_game(lost: bool = False) -> Evidence:
    """Two pellets; the second is the last, or the robot is caught before it."""
    e = Evidence(frozenset({3, 8}), 0.2, started=at(1.5))
    publish(e, 0.0, state("menu"), ("game/score", 5), ("game/round", 2), ("clyde/speed", 0.25))
    publish(e, 1.6, ("game/pellets_collected", 0), state("menu"), state("returning_home"), ("sent", "(0.00, 0.00)"))
    publish(e, 1.7, ("goals", {"a": 2}), ("game/pellets_spawned", 2), ("game_status", "home_reached"))
    publish(e, 1.8, ("goals", {"a": 4}))
    publish(e, STARTING, state("starting"))
    for k in range(160):
        publish(e, STARTING + 0.05 * k, ("turn", 1.5))
    publish(e, RUNNING, ("turn", 0.0), state("running"), ("sent", "(0.45, 2.70)"), ("goals", {"a": 4, "b": 2}))
    publish(e, 20.0, ("game_status", "pellet_collected:3"), ("goals", {"b": 4}))
    publish(e, 20.1, ("game/pellets_collected", 1), ("game/score", 6))
    if lost:
        publish(e, OVER, ("game_status", "death_detected"), state("dying"), ("game_result", "Death - Score: 6"))
        for k in range(100):
            publish(e, OVER + 0.05 * k, ("turn", 1.5 if k // 5 % 2 else -1.5))
        publish(e, OVER + 5.0, ("turn", 0.0))
    else:
        publish(e, OVER, ("game_status", "pellet_collected:8"), ("game/pellets_collected", 2), ("game/score", 7))
        publish(e, OVER + 0.01, ("game_result", "Complete - Score: 7"), state("complete"))
    publish(e, OVER + 5.0, state("returning_home"), ("sent", "(0.00, 0.00)"), ("goals", {"c": 2}))
    publish(e, BACK, ("goals", {"c": 4}), ("game_status", "home_reached"))
    last = (0, 1, 0.2) if lost else (7, 3, 0.3)
    publish(e, BACK + 0.1, *zip(("game/score", "game/round", "clyde/speed"), last, strict=True))
    publish(e, BACK + 0.2, ("game/pellets_collected", 0), state("menu"), ("game/pellets_spawned", 2))
    driving = ((1.6, STARTING), (RUNNING, OVER), (OVER + 5.0, BACK))
    x = 0.0
    for k in range(round(430 / 0.5)):
        time_s = 0.05 * k
        x += 0.3 * 0.05 * any(begin <= time_s < end for begin, end in driving)
        e.track.append(Sample(at(time_s), time_s, x, 0.0))
    return e


@pytest.mark.parametrize(("lost", "how"), [(False, "complete"), (True, "lost")])
def test_a_right_game_has_no_violation(lost: bool, how: str) -> None:
    assert violations(a_game(lost)) == []
    assert outcome(a_game(lost)) == how


def move(begin_s: float, end_s: float) -> Change:
    def change(e: Evidence) -> None:
        for k, sample in enumerate(e.track):
            moved = max(0.0, min(sample.time_s, end_s) - begin_s)
            e.track[k] = Sample(sample.at, sample.time_s, sample.x + 0.3 * moved, 0.0)

    return change


def add(time_s: float, topic: str, *values: object) -> Change:
    return lambda e: publish(e, time_s, *((topic, value) for value in values))


def replace(topic: str, before: object, after: object) -> Change:
    def change(e: Evidence) -> None:
        hits = [k for k, r in enumerate(e.records) if (r.topic, r.value) == (topic, before)]
        assert hits
        for k in hits:
            e.records[k] = Record(e.records[k].at, topic, after)

    return change


def stretch(show: str, by_s: float) -> Change:
    """Everything after the show's beginning comes later, but the turning goes on."""

    def change(e: Evidence) -> None:
        end = {"starting": RUNNING, "dying": OVER + 5.0}[show]
        e.records = [r if r.at < at(end) else Record(r.at + at(by_s), r.topic, r.value) for r in e.records]
        for k in range(round(by_s / 0.05)):
            publish(e, end + 0.05 * k, ("turn", 1.5))
        last = e.track[-1]
        e.track += [Sample(last.at + at(0.05 * k), last.time_s + 0.05 * k, last.x, 0.0) for k in range(1, 400)]

    return change


COMPLETE: dict[str, Change] = {
    "the state went from running to starting": add(15.0, "game_state", "starting", "running"),
    "the state went from starting to menu": add(5.0, "game_state", "menu", "returning_home", "starting"),
    "starting lasted 16": stretch("starting", 8.0),
    "a turn of 16": stretch("starting", 8.0),
    "a goal was sent 7.00 s after driving was over: (0.45, 2.70)": add(BACK + 7.2, "sent", "(0.45, 2.70)"),
    "4 goals were accepted, 3 were sent": add(20.0, "goals", {"d": 4}),
    "the robot moved 2": move(STARTING, RUNNING),
    "outside of a show": add(20.0, "turn", 1.5, 1.5, 0.0),
    "a turn at 1.90 rad/s": replace("turn", 1.5, 1.9),
    "2 pellets were counted, 1 to 1 were collected": replace("game_status", "pellet_collected:3", "pellet_collected:4"),
    "the score went up to 9, from 5 with 2 pellets": replace("game/score", 7, 9),
    "the round was complete with 1 of 2 pellets": replace("game/pellets_collected", 2, 1),
    "game_result is 'Death - Score: 7' at the end": replace("game_result", "Complete - Score: 7", "Death - Score: 7"),
    "1 pellets were reported as spawned, there are 2": add(20.0, "game/pellets_spawned", 1, 2),
    "game/round is 2 at the end, not 3": replace("game/round", 3, 2),
    "clyde/speed is 0.25 at the end": replace("clyde/speed", 0.3, 0.25),
    "game/pellets_spawned is 7 at the end, not 2": add(BACK + 1.0, "game/pellets_spawned", 7),
}


@pytest.mark.parametrize("line", COMPLETE)
def test_what_is_wrong_with_a_complete_game_is_seen(line: str) -> None:
    e = a_game()
    COMPLETE[line](e)
    found = violations(e)
    assert any(line in one for one in found), found


LOST: dict[str, Change] = {
    "a goal was pursued for 17": lambda e: (
        replace("goals", {"b": 4}, {"b": 2})(e),
        stretch("dying", 12.0)(e),
    ),
    "dying lasted 17.0 s, not 5": stretch("dying", 12.0),
    "a turn of 17.0 s, longer than 5": stretch("dying", 12.0),
    "game/score is 6 at the end, not 0": replace("game/score", 0, 6),
    "game/round is 2 at the end, not 1": replace("game/round", 1, 2),
    "the robot moved 1.5": move(OVER, OVER + 5.0),
}


@pytest.mark.parametrize("line", LOST)
def test_what_is_wrong_with_a_lost_game_is_seen(line: str) -> None:
    e = a_game(lost=True)
    LOST[line](e)
    found = violations(e)
    assert any(line in one for one in found), found


def test_a_reset_in_the_middle_is_a_way_to_the_menu() -> None:
    e = a_game()
    e.records = [r for r in e.records if r.at < at(25.0)]
    e.resets.append(at(24.95))
    publish(e, 25.0, ("game/score", 0), ("game/round", 1), ("clyde/speed", 0.2), ("game_result", ""), state("menu"))
    publish(e, 25.0, ("game/pellets_collected", 0), ("game/pellets_spawned", 2))
    e.track = [s if s.time_s < 25.0 else Sample(s.at, s.time_s, e.track[499].x, 0.0) for s in e.track]
    assert outcome(e) == "reset"
    assert violations(e) == []
    e.resets.clear()
    assert "the state went from running to menu" in violations(e)


def test_a_game_of_which_nothing_was_received_is_no_game() -> None:
    assert violations(Evidence(frozenset(), 0.2)) == ["the game's state was never received"]


def test_what_happens_at_one_simulated_moment_may_be_in_any_order_and_a_step_later_it_may_not() -> None:
    e = a_game()
    ended = round((BACK + 0.2) * 1e9)
    e.records.append(Record(ended + 7, "sent", "(0.45, 2.70)"))
    assert violations(e) == []
    e.records.append(Record(ended + 50_000_000, "sent", "(0.45, 2.70)"))
    assert violations(e) == ["a goal was sent 0.05 s after driving was over: (0.45, 2.70)"]


def test_a_reset_is_obeyed_at_once() -> None:
    for late_s, wrong in ((0.0, False), (0.3, True)):
        e = a_game()
        e.records = [r for r in e.records if r.at < at(25.0)]
        e.resets.append(at(25.0 - late_s))
        publish(e, 25.0, state("menu"))
        assert ("the state went from running to menu" in violations(e)) == wrong


def test_a_goal_whose_server_has_gone_is_pursued_no_more() -> None:
    e = a_game()
    replace("goals", {"b": 4}, {"b": 2})(e)
    assert violations(e) == ["a goal was pursued for 5.0 s while no node may drive"]
    publish(e, 25.0, ("goals", {}))  # from another one, that knows of none
    assert violations(e) == []


def test_the_score_of_a_game_before_a_reset_in_the_menu_is_not_this_games() -> None:
    e = a_game()
    for record in [r for r in e.records if r.topic in ("game/score", "game/round", "clyde/speed") and r.at == 0]:
        e.records.remove(record)
    publish(e, 0.0, ("game/score", 26), ("game/round", 3))
    publish(e, 1.0, ("game/score", 5), ("game/round", 2))
    assert violations(e) == []


def away(e: Evidence, node: str, begin_s: float, end_s: float) -> None:
    e.outages.append(Outage("freeze", node, at(begin_s), at(end_s)))


def test_what_a_referee_who_was_away_says_late_is_no_violation_and_what_another_node_says_late_is_one() -> None:
    late = "starting lasted 16.0 s, not 8 s"
    for node, wrong in (("game_controller", False), ("game_light_node", True)):
        e = a_game()
        stretch("starting", 8.0)(e)
        assert late in violations(e)
        away(e, node, STARTING + 1.0, STARTING + 4.0)
        assert (late in violations(e)) == wrong


def test_a_state_is_left_out_by_no_referee_be_it_away_or_not() -> None:
    e = a_game()
    e.records = [r for r in e.records if r.value != "complete"]
    away(e, "game_controller", OVER - 5.0, OVER - 1.0)
    assert "the state went from running to returning_home" in violations(e)


def test_the_result_of_the_game_before_said_again_by_a_referee_that_comes_back_is_not_this_games() -> None:
    e = a_game(lost=True)
    away(e, "game_controller", 1.0, 1.55)
    publish(e, 1.55, ("game_result", "Complete - Score: 5"), state("menu"), ("game_result", ""))
    assert outcome(e) == "lost"
    assert violations(e) == []


@pytest.mark.parametrize("node", ["game_controller", "goal_selector", "sim_robot", "pellet_manager", "all"])
def test_a_wrong_score_is_one_whoever_was_away(node: str) -> None:
    e = a_game(lost=True)
    away(e, node, 15.0, 25.0)
    publish(e, 19.0, ("game_status", "pellet_collected:8"))  # it was not counted
    assert "1 pellets were counted, 2 to 2 were collected" in violations(e)
    e = a_game()
    away(e, node, 15.0, 25.0)
    replace("game/score", 7, 9)(e)
    assert "the score went up to 9, from 5 with 2 pellets" in violations(e)
