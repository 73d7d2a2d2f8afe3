"""One operator at a time, one person a seat, whatever people do in whatever order."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.web.control import KEPT_S, SEATS, Control
from pacman_env.web.game import Refused

PEOPLE = ("ann", "bob", "cid")
people = st.sampled_from(PEOPLE)
deeds = st.lists(
    st.one_of(
        st.tuples(st.sampled_from(["take", "ask", "give", "stand_up", "went", "came"]), people),
        st.tuples(st.just("sit"), people, st.sampled_from(SEATS)),
        st.tuples(st.just("wait"), st.floats(0, 2 * KEPT_S)),
    ),
    max_size=40,
)


@given(deeds)
def test_control_passes_only_by_the_will_of_who_has_it_or_after_he_stayed_away(deeds: list[tuple]) -> None:
    control, now = Control(), 0.0
    here, gone = set(PEOPLE), {}
    for what, *rest in deeds:
        before, seats = control.operator, dict(control.seats)
        if what == "wait":
            now += rest[0]
            expired = control.expire(now)
            assert all(now - gone[person] >= KEPT_S for person in expired)
        elif what in ("went", "came"):
            (person,) = rest
            here.discard(person) if what == "went" else here.add(person)
            if what == "went":
                gone.setdefault(person, now)
                control.went(person, gone[person])
            else:
                gone.pop(person, None)
                control.came(person)
        elif rest[0] in here:
            try:
                getattr(control, what)(*rest)
            except Refused:
                assert (control.operator, control.seats) == (before, seats)
        if control.operator != before and before is not None:
            assert (what, *rest) == ("give", before) or (what == "wait" and now - gone[before] >= KEPT_S)
        if control.operator != before and control.operator is not None:
            assert control.operator in here
        assert control.operator not in control.asking
        assert set(control.asking) <= here
        assert control.operator is not None or not control.asking
        assert len(set(control.seats.values())) == len(control.seats)  # nobody has two
        for seat, person in seats.items():
            assert control.seats.get(seat) in (person, None) or what == "wait"  # nobody is pushed off


def test_who_asks_sees_it_and_gets_control_when_it_is_given() -> None:
    control = Control()
    control.take("ann")
    control.take("ann")
    for person in ("bob", "cid", "bob"):
        control.ask(person)
    assert (control.operator, control.asking) == ("ann", ["bob", "cid"])
    with pytest.raises(Refused, match="ann has control"):
        control.take("bob")
    with pytest.raises(Refused, match="do not have"):
        control.give("bob")
    control.give("ann")
    assert (control.operator, control.asking) == ("bob", ["cid"])


def test_asking_for_what_nobody_has_is_taking_it() -> None:
    control = Control()
    control.ask("ann")
    assert (control.operator, control.asking) == ("ann", [])


def test_a_page_that_comes_back_in_time_has_lost_nothing() -> None:
    control = Control()
    control.take("ann")
    control.sit("ann", "robot")
    control.went("ann", 100.0)
    assert control.expire(100.0 + KEPT_S - 0.1) == []
    with pytest.raises(Refused):
        control.take("bob")
    control.came("ann")
    assert control.expire(1000.0) == []
    assert (control.operator, control.seats) == ("ann", {"robot": "ann"})


def test_after_ten_seconds_control_and_seat_are_free() -> None:
    control = Control()
    control.take("ann")
    control.sit("ann", "robot")
    control.ask("bob")
    control.went("ann", 100.0)
    assert control.expire(100.0 + KEPT_S) == ["ann"]
    assert (control.operator, control.seats, control.asking) == (None, {}, [])
    control.take("bob")
    control.sit("bob", "robot")


def test_a_seat_has_one_person_and_a_person_one_seat() -> None:
    control = Control()
    control.sit("ann", "ghost-1")
    control.sit("ann", "robot")
    assert control.seats == {"robot": "ann"}
    with pytest.raises(Refused, match="ann has the seat robot"):
        control.sit("bob", "robot")
    control.stand_up("ann")
    control.sit("bob", "robot")
    assert control.seat_of("bob") == "robot"
    assert control.seat_of("ann") is None
