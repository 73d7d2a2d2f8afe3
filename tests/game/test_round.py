import json
import math
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pacman_env.config import PowerConfig, ShowConfig
from pacman_env.game.power import score_ghost
from pacman_env.game.round import Action, RoundController

POWER = PowerConfig(pellets=1)  # pellet 0, in all games with it
RESETS = [Action("pellets"), Action("reset_clyde")]
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
    if name == "remove":
        return game.remove(int(argument))
    if name == "speed":
        return game.base_clyde_speed(float(argument))
    if name in ("start", "reset", "tick"):
        actions: list[Action] = getattr(game, name)(now)
        return actions
    return game.status(word, now)


INPUTS = st.one_of(
    st.sampled_from(["start", "reset", "tick", "tick", "remove 0", "remove 3", "speed 0.5"]),
    st.sampled_from(["death_detected", "game_complete", "home_reached", "home_reached", "home_failed"]),
    st.integers(0, 3).map(lambda i: f"pellet_collected:{i}"),
    st.integers(1, 3).map(lambda i: f"ghost_caught:{i}:clyde"),
)

#: What brings a game into each of its states, one after the other.
STEPS = {
    "menu": (),
    "returning_home": ("start",),
    "starting": ("home_reached",),
    "running": ("tick",),
    "dying": ("death_detected",),
}


def new_game(
    pellets: int = 8, home_retries: int = ShowConfig.home_retries, power: PowerConfig | None = None
) -> RoundController:
    show = ShowConfig(home_retries=home_retries, home_retry_s=5.0)
    game = RoundController(show=show, power=power or PowerConfig())
    game.lay_out(range(pellets), range(game.power.pellets))
    return game


def game_in(wanted: str) -> RoundController:
    """A game in the state, 10 s after the one before, without a score."""
    game = new_game()
    for now, (state, inputs) in enumerate(STEPS.items()):
        for word in inputs:
            act(game, word, 10.0 * now)
        if state == wanted:
            break
    assert game.state == wanted
    return game


def running(pellets: int = 8, **options: Any) -> RoundController:
    game = new_game(pellets, **options)
    game.start(0.0)
    game.status("home_reached", 1.0)
    game.tick(1.0 + game.show.start_s)
    assert game.state == "running"
    return game


def ignored(actions: list[Action]) -> bool:
    return [a.kind for a in actions] == ["ignored"]


def test_a_start_follows_the_recorded_game() -> None:
    game = new_game()
    assert words(game.start(0.0), "command", "event", "spawned", "state") == [
        *("command disable", "command reset_round", "event reset", "spawned 8", "state menu"),
        *("command return_home", "state returning_home"),
    ]
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
    assert [a for a in home if a in RESETS] == RESETS
    assert game.left == {0, 1}


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


def test_round_without_pellets_never_starts() -> None:
    game = new_game(0)
    assert ignored(game.start(0.0))
    assert game.state == "menu"


def test_lost_pellet_leaves_end_to_executing_side() -> None:
    game = running(2)
    assert game.remove(0) == [Action("pellets")]
    assert game.remove(0) == []
    assert ignored(game.remove(4711))
    game.status("pellet_collected:1", 20.0)
    assert (game.state, game.left, game.spawned) == ("running", set(), 2)
    game.status("game_complete", 21.0)
    assert (game.result, game.score) == ("Complete - Score: 1", 1)


def test_pellet_counts_if_its_removal_comes_first() -> None:
    game = running(2)
    game.remove(0)
    assert words(game.status("pellet_collected:0", 20.0)) == ["collected 1", "score 1", "event pellet"]
    assert game.remove(0) == []
    assert "event win" in words(game.status("pellet_collected:1", 30.0))


def test_pellet_of_no_map_does_not_count() -> None:
    game = running(2)
    assert ignored(game.status("pellet_collected:4711", 20.0))
    assert (game.score, game.collected, game.spawned) == (0, 0, 2)
    game.reset(21.0)
    game.lay_out([5])
    game.start(22.0)
    game.status("home_reached", 23.0)
    game.tick(40.0)
    assert ignored(game.status("pellet_collected:1", 41.0))


def test_failed_way_home_is_retried_then_reported_fault_9() -> None:
    game = new_game(home_retries=2)
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
    game = new_game(home_retries=1)
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
    assert (game.result, len(game.left), game.collected) == ("", 8, 0)


def test_base_speed_is_announced_in_the_menu() -> None:
    game = new_game()
    for speed in (0.0, -0.1, math.nan, math.inf):
        assert ignored(game.base_clyde_speed(speed))
    assert game.clyde_speed == 0.25
    assert words(game.base_clyde_speed(0.4)) == ["clyde_speed 0.4"]
    game.start(0.0)
    assert game.base_clyde_speed(0.5) == []  # kept for later
    game.status("home_reached", 1.0)
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
    game = new_game(4, power=POWER)
    left = set(game.left)  # as shown last
    shown: dict[str, object] = {}
    counted = streak = 0
    for step, word in enumerate(inputs):
        state = game.state
        actions = act(game, word, 4.0 * step)
        assert game.state == state or not word.startswith("remove")
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
        assert game.spawned == 4
        left = set(game.left) if Action("pellets") in actions else left
        assert game.left == left <= game.pellets - game.taken
        assert game.state != "complete"
        for kind in ("state", "score", "round", "collected", "spawned", "ghosts_caught", "result"):
            assert kind not in shown or shown[kind] == getattr(game, kind)


# A process that was killed


@given(st.lists(INPUTS, max_size=25), st.lists(INPUTS, max_size=15), st.integers(-100, 1000))
def test_restored_game_continues_alike(before: list[str], after: list[str], away_s: int) -> None:
    game, other = new_game(4, power=POWER), new_game(4, power=POWER)
    for step, word in enumerate(before):
        act(game, word, 2.0 * step)
    now = 2.0 * len(before)
    said = other.restore(json.loads(json.dumps(game.snapshot(now))), now + away_s)
    assert other.snapshot(now + away_s) == game.snapshot(now)
    assert [action for action in said if action not in RESETS] == game.announce()
    for step, word in enumerate(after):
        assert act(other, word, now + away_s + 2.0 * step) == act(game, word, now + 2.0 * step)


def test_only_interrupted_start_is_restored_with_a_reset() -> None:
    game = running()
    game.status("pellet_collected:3", 20.0)
    said = new_game().restore(game.snapshot(21.0), 0.0)
    assert words(said, "command", "collected", "state") == ["command enable", "collected 1", "state running"]
    assert not [action for action in said if action in RESETS]
    game, other = game_in("starting"), new_game()
    said = other.restore(game.snapshot(26.0), 1000.0)
    assert words(said, "command", "state") == ["command disable", "state starting"]
    assert [action for action in said if action in RESETS] == RESETS
    assert other.tick(1001.9) == []
    assert "state running" in words(other.tick(1002.0))


@pytest.mark.parametrize(
    "change",
    [
        *({"state": "complete"}, {"state": "menu"}, {"state": ["running"]}, {"state": "running"}, {"score": -1}),
        *({"score": True}, {"score": 1.0}, {"round": 0}, {"round": 10**9}, {"result": 3}, {"result": "x" * 201}),
        *({"base_speed_mps": 0.0}, {"base_speed_mps": math.nan}, {"base_speed_mps": "0.25"}, {"base_speed_mps": None}),
        *({"collected": [4711]}, {"collected": [-1]}, {"collected": ["1"]}, {"collected": None}, {"left": {"1": 2}}),
        *({"left": [4711]}, {"left": [0], "collected": [0]}),
        *({"due_in_s": -1.0}, {"due_in_s": math.inf}, {"due_in_s": None}, {"after_home": ""}, {"home_failures": 0.5}),
        *({"more": 1}, {"ghosts_caught": -1}, {"streak": "0"}),
    ],
    ids=str,
)
def test_bad_snapshot_is_refused_and_changes_nothing(change: dict[str, Any]) -> None:
    game = running()
    game.status("death_detected", 20.0)
    other = running()
    before = other.snapshot(9.0)
    with pytest.raises(ValueError, match=next(iter(change))):
        other.restore(game.snapshot(21.0) | change, 9.0)
    assert other.snapshot(9.0) == before
    short = game.snapshot(21.0)
    del short["score"]
    with pytest.raises(ValueError, match="score"):
        other.restore(short, 9.0)
