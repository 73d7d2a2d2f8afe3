import pytest

from pacman_env.game.pending_requests import AGAIN_S, CALLS, EFFECT_S, Removals, Requests


def test_service_is_called_until_it_answers() -> None:
    requests = Requests()
    requests.ask("reset_pellets", 10.0)
    assert requests.due(10.0, lambda name: False) == []
    assert requests.due(11.0, lambda name: True) == ["reset_pellets"]
    assert requests.due(12.9, lambda name: True) == []
    assert requests.due(13.0, lambda name: True) == ["reset_pellets"]
    assert "reset_pellets" in requests
    requests.answered("reset_pellets")
    assert "reset_pellets" not in requests
    assert requests.due(20.0, lambda name: True) == []


@pytest.mark.parametrize("gone", [False, True])
def test_server_silent_three_times_is_reported(gone: bool) -> None:
    requests = Requests()
    requests.ask("reset_pellets", 0.0)
    for call in range(CALLS):
        assert requests.due(call * AGAIN_S, lambda name: True) == ["reset_pellets"]
        assert requests.overdue(call * AGAIN_S) == {}
    late_s = CALLS * AGAIN_S
    calls = CALLS + len(requests.due(late_s, lambda name: not gone))
    assert requests.overdue(late_s) == {"reset_pellets": f"reset_pellets: no answer to {calls} calls"}
    requests.answered("reset_pellets")
    assert requests.overdue(late_s) == {}


def test_missing_server_is_reported() -> None:
    requests = Requests()
    requests.ask("reset_clyde", 0.0)
    assert requests.overdue(CALLS * AGAIN_S - 0.1) == {}
    assert requests.overdue(CALLS * AGAIN_S) == {"reset_clyde": "reset_clyde: no server"}
    assert requests.due(20.0, lambda name: True) == ["reset_clyde"]
    assert requests.overdue(20.0) == {}
    assert requests.unanswered("reset_clyde") == "reset_clyde: no answer to 1 call"


def test_pellet_shown_after_removal_is_reported() -> None:
    removals = Removals()
    removals.shown(frozenset({4, 3}), 10.0)
    removals.shown(frozenset({3}), 10.0 + EFFECT_S - 0.1)
    assert removals.overdue(10.0 + EFFECT_S - 0.1) == ""
    assert removals.overdue(10.0 + EFFECT_S) == "remove_pellet: pellet 3 still shown after 5 s"
    removals.shown(frozenset(), 16.0)
    assert removals.overdue(30.0) == ""
