import json
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.config import PowerConfig, ShowConfig
from pacman_env.game.power import score_ghost
from pacman_env.game.round import Action, RoundController, awaits_pellets

POWER = PowerConfig(pellets=1)  # pellet 0, in all games with it
SHOWN = ("command", "event", "state", "score", "round", "clyde_speed", "collected", "spawned", "result")


def words(actions: list[Action], *kinds: str) -> list[str]:
    """``state menu`` and the like."""
    return [
        f"{a.kind} {a.value:g}" if isinstance(a.value, float) else f"{a.kind} {a.value}"
        for a in actions
        if a.kind in (kinds or SHOWN)
    ]


def act(game: RoundController, word: str, now: float) -> list[Action]:
    """One input."""
    name, _, argument = word.partition(" ")
    if name == "left":
        return game.pellets_left(map(int, argument), now, range(game.power.pellets))
    if name == "speed":
        return game.base_clyde_speed(float(argument))
    if name in ("start", "reset", "tick"):
        actions: list[Action] = getattr(game, name)(now)
        return actions
    return game.status(word, now)


INPUTS = st.one_of(
    st.sampled_from(["start", "reset", "tick", "tick", "left ", "left 0123", "left 013", "speed 0.5"]),
    st.sampled_from(["death_detected", "game_complete", "home_reached", "home_reached", "home_failed"]),
    st.integers(0, 3).map(lambda i: f"pellet_collected:{i}"),
    st.integers(1, 3).map(lambda i: f"ghost_caught:{i}:clyde"),
)

#: What brings a game into each of its states, one after the other.
STEPS = {
    "menu": (),
    "returning_home": ("start",),
    "starting": ("home_reached",),
    "running": ("left 01234567", "tick"),
    "dying": ("death_detected",),
}


def game_in(wanted: str) -> RoundController:
    """A game in the state, 10 s after the one before, without a score."""
    game = RoundController()
    for now, (state, inputs) in enumerate(STEPS.items()):
        for word in inputs:
            act(game, word, 10.0 * now)
        if state == wanted:
            break
    assert game.state == wanted
    return game


def running(
    pellets: int = 8, home_retries: int = ShowConfig.home_retries, power: PowerConfig | None = None
) -> RoundController:
    game = RoundController(show=ShowConfig(home_retries=home_retries), power=power or PowerConfig())
    game.start(0.0)
    act(game, "left " + "".join(map(str, range(pellets))), 0.5)
    game.status("home_reached", 1.0)
    game.tick(1.0 + game.show.start_s)
    assert game.state == "running"
    return game


def ignored(actions: list[Action]) -> bool:
    return [a.kind for a in actions] == ["ignored"]


def test_a_start_follows_the_recorded_game() -> None:
    game = RoundController()
    assert words(game.start(0.0), "command", "event", "state") == [
        *("command disable", "command reset_round", "event reset", "state menu"),
        *("command return_home", "state returning_home"),
    ]
    assert words(game.pellets_left(range(8), 0.02)) == ["spawned 8"]
    assert words(game.status("home_reached", 0.03)) == ["event start theatrical", "state starting"]
    assert game.tick(8.02) == []
    assert words(game.tick(8.03)) == ["clyde_speed 0.25", "command enable", "state running"]
    assert game.tick(9.0) == []


def test_pellets_follow_the_recorded_game() -> None:
    game = running(2)
    assert words(game.status("pellet_collected:0", 20.0)) == ["collected 1", "score 1", "event pellet"]
    assert words(game.status("pellet_collected:1", 30.0)) == [
        *("collected 2", "score 2", "event pellet", "command disable", "event win", "result Complete - Score: 2"),
        *("command return_home", "state complete", "state returning_home"),
    ]
    assert ignored(game.status("game_complete", 30.1))
    home = game.status("home_reached", 40.0)
    assert words(home, "command", "event", "state") == [
        *("command disable", "command reset_round", "event reset", "state menu"),
    ]
    assert words(home, "score", "round", "collected", "clyde_speed", "result") == [
        *("clyde_speed 0.3", "result Complete - Score: 2", "collected 0", "score 2", "round 2"),
    ]
    assert [a.kind for a in home if a.kind.startswith("reset")] == ["reset_pellets", "reset_clyde"]


def test_death_follows_the_recorded_game() -> None:
    game = running()
    game.round = 3
    game.status("pellet_collected:0", 20.0)
    assert words(game.status("death_detected", 30.0)) == [
        *("command disable", "result Death - Score: 1", "state dying"),
    ]
    assert game.tick(34.9) == []
    assert words(game.tick(35.0)) == ["command return_home", "state returning_home"]
    assert "clyde_speed 0.25" in words(game.status("home_reached", 50.0))
    assert (game.state, game.score, game.round, game.collected) == ("menu", 0, 1, 0)
    assert game.result == "Death - Score: 1"


def test_stale_pellet_report_blocks_no_completion_fault_7() -> None:
    game = running(2)
    game.status("pellet_collected:0", 20.0)
    game.pellets_left([1], 20.5)
    game.pellets_left(range(12), 21.0)
    assert game.spawned == 12
    assert words(game.pellets_left([1], 22.0)) == ["spawned 2"]
    assert "event win" in words(game.status("pellet_collected:1", 30.0))


@pytest.mark.parametrize("seen_before_the_status", [[1, 2], [2]])
def test_overtaking_pellet_report_does_not_end_round(seen_before_the_status: list[int]) -> None:
    game = running(3)
    game.status("pellet_collected:0", 20.0)
    game.pellets_left(seen_before_the_status, 20.0)
    game.status("pellet_collected:1", 20.01)
    assert (game.state, game.spawned, game.collected) == ("running", 3, 2)


@pytest.mark.parametrize("reported", [False, True])
def test_round_waits_for_its_first_pellet(reported: bool) -> None:
    game = RoundController()
    game.start(0.0)
    game.status("home_reached", 1.0)
    if reported:
        game.pellets_left([], 2.0)
    assert not awaits_pellets(game, 8.9)
    assert game.tick(9.0) == game.tick(20.0) == []
    assert game.state == "starting"
    assert awaits_pellets(game, 20.0)
    assert (game.pellets.left is not None) == reported
    assert words(game.pellets_left([3], 21.0)) == ["spawned 1"]
    assert "state running" in words(game.tick(21.05))
    assert not awaits_pellets(game, 21.1)


def test_failed_way_home_is_retried_then_reported_fault_9() -> None:
    game = RoundController(show=ShowConfig(home_retries=2, home_retry_s=5.0))
    game.start(0.0)
    for now in (10.0, 20.0):
        assert game.status("home_failed", now) == []
        assert game.tick(now + 4.9) == []
        assert words(game.tick(now + 5.0)) == ["command return_home"]
        assert game.state == "returning_home"
    assert "result home_failed" in words(game.status("home_failed", 30.0))
    assert game.state == "menu"
    assert words(game.start(40.0), "result") == ["result "]
    assert "state starting" in words(game.status("home_reached", 41.0))


@pytest.mark.parametrize("dies", [False, True])
def test_failed_way_home_ends_rounds_as_usual(dies: bool) -> None:
    game = running(2 if dies else 1, home_retries=0)
    game.status("pellet_collected:0", 20.0)
    if dies:
        game.status("death_detected", 30.0)
        game.tick(35.0)
    game.status("home_failed", 40.0)
    assert (game.state, game.result) == ("menu", "home_failed")
    assert (game.score, game.round) == ((0, 1) if dies else (1, 2))


def test_repeated_failure_counts_once_until_home_is_reached() -> None:
    game = RoundController(show=ShowConfig(home_retries=1))
    game.start(0.0)
    game.status("home_failed", 1.0)
    assert ignored(game.status("home_failed", 1.1))
    assert ignored(game.start(1.2))  # outside the menu
    assert game.state == "returning_home"
    game.status("home_reached", 2.0)
    assert game.tick(7.0) == []  # no other try
    assert game.state == "starting"


@pytest.mark.parametrize("state", ["menu", "returning_home", "starting", "dying"])
def test_game_statuses_outside_of_running_are_ignored(state: str) -> None:
    game = game_in(state)
    for word in ("pellet_collected:1", "death_detected", "game_complete"):
        assert ignored(game.status(word, 41.0))
        assert (game.state, game.score) == (state, 0)


@pytest.mark.parametrize(
    "word",
    ["", "pellet", "pellet_collected", "pellet_collected:", "pellet_collected:-1", "pellet_collected:x",
     "pellet_collected:" + "9" * 5000, "pellet_collected:²", "death_detected:1", "ghost_caught:1",
     "ghost_caught:1:casper", "ghost_caught:x:clyde", "ghost_caught:²:clyde"],
)  # fmt: skip
def test_unknown_status_is_ignored_with_a_reason(word: str) -> None:
    game = running()
    actions = game.status(word, 20.0)
    assert ignored(actions)
    assert word.strip() in str(actions[0].value)
    assert (game.state, game.score) == ("running", 0)


@pytest.mark.parametrize("before", ["returning_home", "starting", "running", "dying"])
def test_reset_leads_to_a_fresh_menu(before: str) -> None:
    game = game_in(before)
    game.status("pellet_collected:0", 40.5)
    assert words(game.reset(41.0), "command", "event", "state", "score", "round") == [
        *("command disable", "command reset_round", "event reset", "score 0", "round 1", "state menu"),
    ]
    assert game.tick(1000.0) == []
    assert (game.result, game.spawned, game.collected) == ("", 0, 0)


def test_base_speed_is_announced_in_the_menu() -> None:
    game = RoundController()
    for speed in (0.0, -0.1, math.nan, math.inf):
        assert ignored(game.base_clyde_speed(speed))
    assert game.clyde_speed == 0.25
    assert words(game.base_clyde_speed(0.4)) == ["clyde_speed 0.4"]
    game.start(0.0)
    assert game.base_clyde_speed(0.5) == []  # kept for later
    game.status("home_reached", 1.0)
    game.pellets_left([1], 8.0)
    assert "clyde_speed 0.5" in words(game.tick(9.0))


def test_caught_ghosts_count_once_and_in_order() -> None:
    game = running(power=POWER)
    assert ignored(game.status("ghost_caught:2:inky", 20.0))
    for number, ghost, score in ((1, "clyde", 20), (2, "inky", 60), (3, "clyde", 140)):
        word = f"ghost_caught:{number}:{ghost}"
        said = words(game.status(word, 21.0), "ghosts_caught", "score", "event")
        assert said == [f"ghosts_caught {number}", f"score {score}", f"event {ghost} caught"]
        assert ignored(game.status(word, 21.5))
    assert words(game.status("pellet_collected:0", 22.0), "score", "event") == ["score 145", "event power pellet"]
    game.status("ghost_caught:4:pinky", 23.0)
    assert game.score == 165
    assert "ghosts_caught 0" in words(game.reset(24.0), "ghosts_caught")


@given(st.lists(INPUTS, max_size=40))
def test_score_and_reports_are_consistent_for_any_inputs(inputs: list[str]) -> None:
    game = RoundController(power=POWER)
    shown: dict[str, object] = {}
    counted = streak = 0
    for step, word in enumerate(inputs):
        actions = act(game, word, 4.0 * step)
        for event in (str(a.value) for a in actions if a.kind == "event"):
            counted += {"pellet": 1, "power pellet": POWER.pellet_points}.get(event, 0)
            streak = 0 if event in ("power pellet", "reset") else streak
            if event == "clyde caught":
                points, streak = score_ghost(streak, POWER.ghost_points)
                counted += points
        counted = 0 if game.score == 0 else counted
        shown |= {a.kind: a.value for a in actions}
        assert game.score == counted
        assert 0 <= game.collected <= min(game.score, 4)
        assert game.state != "complete"
        for kind in ("state", "score", "round", "collected", "spawned", "ghosts_caught", "result"):
            assert kind not in shown or shown[kind] == getattr(game, kind)


# A node that was killed


@given(st.lists(INPUTS, max_size=25), st.lists(INPUTS, max_size=15), st.integers(-100, 1000))
def test_restored_game_continues_alike(before: list[str], after: list[str], away_s: int) -> None:
    game = RoundController(power=POWER)
    for step, word in enumerate(before):
        act(game, word, 2.0 * step)
    now = 2.0 * len(before)
    other = RoundController(power=POWER)
    said = other.restore(json.loads(json.dumps(game.snapshot(now))), now + away_s)
    assert other.snapshot(now + away_s) == game.snapshot(now)
    latched = [action for action in said if not action.kind.startswith("reset")]
    assert latched == game.announce()
    now += 5.0  # both have missed reports
    for step, word in enumerate(after):
        assert act(other, word, now + away_s + 2.0 * step) == act(game, word, now + 2.0 * step)


def test_only_interrupted_start_is_restored_with_a_reset() -> None:
    """Who knows whether the services were called before the show."""
    game = running()
    game.status("pellet_collected:3", 20.0)
    said = RoundController().restore(game.snapshot(21.0), 0.0)
    assert words(said, "command", "collected", "state") == ["command enable", "collected 1", "state running"]
    assert not [action for action in said if action.kind.startswith("reset")]
    game = RoundController()
    game.start(0.0)
    game.status("home_reached", 1.0)
    other = RoundController()
    said = other.restore(game.snapshot(7.0), 1000.0)
    assert words(said, "command", "state") == ["command disable", "state starting"]
    assert {a.kind for a in said} >= {"reset_pellets", "reset_clyde"}
    other.pellets_left([1], 1000.5)
    assert other.tick(1001.9) == []
    assert "state running" in words(other.tick(1002.0))


@pytest.mark.parametrize(
    "change",
    [
        *({"state": "complete"}, {"state": "menu"}, {"state": ["running"]}, {"state": "running"}, {"score": -1}),
        *({"score": True}, {"score": 1.0}, {"round": 0}, {"round": 10**9}, {"result": 3}, {"result": "x" * 201}),
        *({"base_speed_mps": 0.0}, {"base_speed_mps": math.nan}, {"base_speed_mps": "0.25"}, {"base_speed_mps": None}),
        *({"collected": [1, 1]}, {"collected": [-1]}, {"collected": ["1"]}, {"collected": None}, {"left": {"1": 2}}),
        *({"due_in_s": -1.0}, {"due_in_s": math.inf}, {"due_in_s": None}, {"after_home": ""}, {"home_failures": 0.5}),
        *({"still_shown": 3}, {"more": 1}, {"power": [1, 1]}, {"ghosts_caught": -1}, {"streak": "0"}),
    ],
    ids=str,
)
def test_bad_snapshot_is_refused_and_changes_nothing(change: dict[str, Any]) -> None:
    game = running()
    game.status("death_detected", 20.0)
    other = running(3)
    before = other.snapshot(9.0)
    with pytest.raises(ValueError, match=next(iter(change))):
        other.restore(game.snapshot(21.0) | change, 9.0)
    assert other.snapshot(9.0) == before
    short = game.snapshot(21.0)
    del short["score"]
    with pytest.raises(ValueError, match=r"snapshot: Object missing required field `score`"):
        other.restore(short, 9.0)


def test_collected_pellet_shown_twice_is_removed_again() -> None:
    game = running(3)
    game.status("pellet_collected:1", 20.0)
    assert game.pellets_left([0, 1, 2], 21.0) == []  # a report from before its removal
    assert game.pellets_left([0, 2], 22.0) == []
    assert game.pellets_left([0, 1, 2], 23.0) == []  # who shows them has been started anew
    assert game.pellets_left([0, 1, 2], 24.0) == [Action("remove", 1)]
    assert game.pellets_left([0, 2], 25.0) == []
    assert (game.spawned, game.collected) == (3, 1)
    game.status("death_detected", 30.0)
    game.reset(31.0)
    assert game.pellets_left([0, 1, 2], 31.1) == [Action("spawned", 3)]


def test_pellet_never_reported_does_not_count() -> None:
    game = running(2)
    assert ignored(game.status("pellet_collected:4711", 20.0))
    assert (game.score, game.collected, game.spawned) == (0, 0, 2)
    game.pellets_left([1], 20.0)  # overtakes the status
    assert not ignored(game.status("pellet_collected:0", 20.5))
    game.reset(21.0)
    game.start(22.0)
    game.pellets_left([5], 22.1)
    game.status("home_reached", 23.0)
    game.tick(40.0)
    assert ignored(game.status("pellet_collected:1", 41.0))


def test_pellets_gone_during_a_freeze_are_awaited() -> None:
    game = running(13)
    for second in range(2, 5):
        game.pellets_left(range(13), float(second))
    game.status("pellet_collected:0", 4.5)
    said = game.pellets_left([11, 12], 30.0)  # frozen for 25 s: what was reported meanwhile is lost
    said += game.pellets_left([12], 31.0)
    assert said == []  # the number of pellets is published once, and right
    assert (game.spawned, game.collected) == (13, 1)
    for pellet in (12, *range(1, 11)):  # the reports are repeated, in whatever order
        said += game.status(f"pellet_collected:{pellet}", 32.0)
        assert game.state == "running"
    assert "event win" in words(game.status("pellet_collected:11", 33.0))
    assert (game.score, game.result) == (13, "Complete - Score: 13")
    assert not words(said, "spawned")


@given(st.lists(st.sampled_from([[], [0, 1, 2], [1], [7, 8]]), max_size=12))
def test_pellet_reports_alone_never_end_a_round(reports: list[list[int]]) -> None:
    game = running(3)
    game.pellets_left(range(3), 10.0)
    for k, report in enumerate(reports):
        game.pellets_left(report, 11.0 + k)
        assert game.state == "running"
        assert game.spawned >= 3
    game.status("pellet_collected:0", 30.0)
    assert game.state == "running"
