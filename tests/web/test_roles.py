"""One operator at a time, one person a role, whatever people do in whatever order."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.web.game_interface import Refused
from pacman_env.web.roles import KEPT_S, ROLES, RoleControl

PEOPLE = ("ann", "bob", "cid")
people = st.sampled_from(PEOPLE)
deeds = st.lists(
    st.one_of(
        st.tuples(st.sampled_from(["take", "ask", "give", "keep", "leave", "went", "came"]), people),
        st.tuples(st.just("assume"), people, st.sampled_from(ROLES)),
        st.tuples(st.just("wait"), st.floats(0, 2 * KEPT_S), st.booleans()),
    ),
    max_size=40,
)


@given(deeds)
def test_control_passes_only_when_given_or_left(deeds: list[tuple]) -> None:
    control, now = RoleControl(), 0.0
    here, gone = set(PEOPLE), {}
    for what, *rest in deeds:
        before, roles = control.operator, dict(control.roles.people)
        if what == "wait":
            now += rest[0]
            expired = control.expire(now, round_runs=rest[1])
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
                getattr(control if hasattr(control, what) else control.roles, what)(*rest)
            except Refused:
                assert (control.operator, control.roles.people) == (before, roles)
        if control.operator != before and before is not None:
            late = what == "wait" and (now - gone[before] >= KEPT_S or not rest[1])
            assert late or (what, *rest) == ("give", before)
        if control.operator != before and control.operator is not None:
            assert control.operator in here
        assert control.operator not in control.asking
        assert set(control.asking) <= here
        assert control.operator is not None or not control.asking
        assert len(set(control.roles.people.values())) == len(control.roles.people)  # nobody has two
        for role, person in roles.items():
            assert control.roles.people.get(role) in (person, None) or what == "wait"  # nobody is pushed off


def test_control_is_given_to_first_person_asking() -> None:
    control = RoleControl()
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
    control = RoleControl()
    control.ask("ann")
    assert (control.operator, control.asking) == ("ann", []), "asking for free control takes it"


def test_control_and_role_are_kept_during_round() -> None:
    control = RoleControl()
    control.take("ann")
    control.roles.assume("ann", "robot")
    control.went("ann", 100.0)
    assert control.expire(100.0 + KEPT_S - 0.1, round_runs=True) == []
    with pytest.raises(Refused):
        control.take("bob")
    control.came("ann")
    assert control.expire(1000.0, round_runs=True) == []
    assert (control.operator, control.roles.people) == ("ann", {"robot": "ann"})
    control.went("ann", 2000.0)
    assert control.expire(2000.0 + KEPT_S, round_runs=True) == ["ann"]
    assert (control.operator, control.roles.people) == (None, {})


def test_control_and_role_are_free_in_menu() -> None:
    control = RoleControl()
    control.take("ann")
    control.roles.assume("ann", "robot")
    control.went("ann", 100.0)
    assert control.expire(100.0, round_runs=False) == []
    assert (control.operator, control.roles.people) == (None, {})
    control.came("ann")
    assert (control.operator, control.roles.people) == ("ann", {"robot": "ann"}), "what is still free comes back"
    control.went("ann", 200.0)
    control.expire(200.0, round_runs=False)
    control.take("bob")
    control.came("ann")
    assert (control.operator, control.roles.people) == ("bob", {"robot": "ann"})


def test_operator_who_keeps_control_refuses_all() -> None:
    control = RoleControl()
    control.take("ann")
    control.ask("bob")
    control.ask("cid")
    with pytest.raises(Refused, match="do not have"):
        control.keep("bob")
    control.keep("ann")
    assert (control.operator, control.asking) == ("ann", [])
