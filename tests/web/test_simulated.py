"""The simulated game of the page: a real one, in its thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from pacman_env.web import messages as m
from pacman_env.web.frame import Frame
from pacman_env.web.game import Refused
from pacman_env.web.rules import Choices, Rules
from pacman_env.web.simulated import SimulatedGame
from pacman_env.web.vocabulary import vocabulary
from tests.waiting import PATIENCE_S, wait_for
from tests.web.frames import decode_all

QUICK = Rules(policy="clyde_aware", second="nearest", settings={"time_limit_s": 20.0})


@pytest.fixture
def game() -> Iterator[SimulatedGame]:
    game = SimulatedGame(QUICK, seed=3, speed=50)
    wait_for(lambda: game.frame() is not None)
    yield game
    game.close()


def frame(game: SimulatedGame) -> Frame:
    now = game.frame()
    assert now is not None
    return now


def played(game: SimulatedGame, **setup: Any) -> dict[str, Any]:
    """A round to its end, and its summary."""
    if setup:
        game.handle("Ann", m.Setup(**setup))
    before = len(game.handle("Ann", m.Stories()))
    game.handle("Ann", m.Start())
    wait_for(lambda: len(game.handle("Ann", m.Stories())) > before)
    wait_for(lambda: frame(game).state == "menu")
    return game.handle("Ann", m.Stories())[0]


def test_a_round_goes_from_menu_to_menu_as_the_referee_has_it(game: SimulatedGame) -> None:
    assert frame(game).state == "menu"
    story = played(game, settings={})
    states = [one["state"] for one in game.news(0) if "state" in one]
    assert states[:4] == ["menu", "returning_home", "starting", "running"]
    ends = {
        "complete": ["complete", "returning_home", "menu"],
        "caught": ["dying", "returning_home", "menu"],
    }
    assert states[4:] == ends[story["result"]]
    events = [one["event"] for one in game.news(0) if "event" in one]
    assert events.count("pellet") == story["collected"]
    assert events[1] == "start theatrical"
    if story["result"] == "complete":
        assert (frame(game).round, frame(game).score) == (2, story["collected"])
        assert game.scene().facts["clyde_speed_mps"] > 0.25
    with pytest.raises(Refused, match="unknown event"):
        game.handle("Ann", m.Event(word="birthday"))


def test_a_link_brings_the_same_round_back(game: SimulatedGame) -> None:
    first = played(game)
    again = game.handle("Bob", m.Setup(seed=first["seed"], finish=True))
    second = game.handle("Bob", m.Stories())[0]
    assert second["story"] == again["story"]
    keys = ("result", "collected", "time_s", "ticks", "parts", "decisions", "link")
    assert {key: second[key] for key in keys} == {key: first[key] for key in keys}


def test_a_story_is_a_list_of_frames(game: SimulatedGame) -> None:
    number = game.handle("Ann", m.Setup(finish=True))["story"]
    facts = game.handle("Ann", m.Stories())[0]
    data = game.story(number)
    assert data is not None
    frames = decode_all(data)
    assert len(frames) == facts["ticks"] + 1
    assert frames[-1].over
    assert frames[-1].time_s == pytest.approx(facts["time_s"], abs=0.01)
    assert game.story(99) is None
    why = game.handle("Ann", m.Why(story=number, tick=3))
    assert set(why["chosen"]) == {"clyde_aware", "nearest"}
    for bad in (m.Why(story=99, tick=0), m.Why(story=number, tick=10**6)):
        with pytest.raises(Refused):
            game.handle("Ann", bad)


def test_stop_holds_at_once_until_the_release(game: SimulatedGame) -> None:
    game.handle("Ann", m.Speed(times=1))  # a round that lasts long enough to be seen
    game.handle("Ann", m.Start())
    wait_for(lambda: frame(game).state == "running" and frame(game).time_s > 1)
    game.stop("Eve")
    stood = frame(game)  # the first one
    assert stood.stopped
    assert stood.velocity == (0.0, 0.0)
    time.sleep(0.3)
    assert (frame(game).true, frame(game).time_s) == (stood.true, stood.time_s)
    game.release("Ann")
    wait_for(lambda: frame(game).time_s > stood.time_s + 1)


def test_stop_does_not_wait_for_what_takes_long(game: SimulatedGame, monkeypatch: pytest.MonkeyPatch) -> None:
    prepare, begun, go_on = Choices.prepare, threading.Event(), threading.Event()

    def slow(self: Choices, *arguments: Any) -> Any:
        begun.set()
        assert go_on.wait(PATIENCE_S)
        return prepare(self, *arguments)

    monkeypatch.setattr(Choices, "prepare", slow)
    asking = threading.Thread(target=lambda: game.handle("Ann", m.Setup(map="maze")))
    asking.start()
    assert begun.wait(PATIENCE_S)
    game.stop("Eve")
    assert frame(game).stopped
    go_on.set()
    asking.join()


def test_pause_and_speed_hold_and_hasten_the_simulated_time(game: SimulatedGame) -> None:
    game.handle("Ann", m.Speed(times=1))  # a round that lasts long enough to be seen
    game.handle("Ann", m.Start())
    wait_for(lambda: frame(game).state == "running")
    game.handle("Ann", m.Pause(on=True))
    held = frame(game)
    time.sleep(0.2)
    assert held.paused
    assert frame(game).time_s == held.time_s
    game.handle("Ann", m.Speed(times=3))
    assert frame(game).speed == 3
    game.handle("Ann", m.Pause(on=False))
    wait_for(lambda: frame(game).time_s > held.time_s or frame(game).state != "running")


def test_newcomer_gets_the_default_speed(game: SimulatedGame) -> None:
    game.handle("Ann", m.Speed(times=2))
    game.greet()
    assert frame(game).speed == 50


def test_time_never_goes_back_within_a_round_and_frames_are_numbered_by_what_they_show(game: SimulatedGame) -> None:
    game.handle("Ann", m.Speed(times=1))  # a round that lasts long enough to be seen
    game.handle("Ann", m.Start())
    wait_for(lambda: frame(game).state == "running")
    before = frame(game)
    game.handle("Ann", m.Speed(times=10))
    while (now := frame(game)).state == "running":
        assert now.time_s >= before.time_s - 1e-6
        assert now.number >= before.number
        if now.number == before.number:
            assert now.encode() == before.encode()
        before = now


def test_clyde_is_placed_in_the_menu_alone(game: SimulatedGame) -> None:
    game.handle("Ann", m.PlaceClyde(x=3.0, y=1.0))
    assert np.hypot(*(frame(game).ghosts[0] - (3.0, 1.0))) < 1.0
    assert game.scene().facts["link"] == ""
    with pytest.raises(Refused, match="no ghost 2"):
        game.handle("Ann", m.PlaceClyde(x=0.0, y=0.0, ghost=2))
    game.handle("Ann", m.Speed(times=1))  # a round that lasts long enough to be seen
    game.handle("Ann", m.Start())
    wait_for(lambda: frame(game).state == "running")
    with pytest.raises(Refused, match="in the menu"):
        game.handle("Ann", m.PlaceClyde(x=0.0, y=0.0))


def test_clydes_speed_is_that_of_the_next_round(game: SimulatedGame) -> None:
    game.handle("Ann", m.ClydeSpeed(mps=1.5))
    assert game.scene().facts["clyde_speed_mps"] == 1.5
    game.handle("Ann", m.Reset())
    assert game.scene().facts["clyde_speed_mps"] == 1.5


def test_a_setup_that_cannot_be_played_leaves_everything_as_it_was(game: SimulatedGame) -> None:
    before = game.scene()
    for bad in (m.Setup(map="nowhere"), m.Setup(settings={"pellets.spacing_m": 500.0}), m.Setup(level=3)):
        with pytest.raises(Refused):
            game.handle("Ann", bad)
    assert game.scene() == before
    assert played(game)["map"] == "house"


def test_roles_are_taken_one_person_each_and_free_when_he_is_gone(game: SimulatedGame) -> None:
    game.handle("Ann", m.Setup(ghosts=("wander", "wander")))
    game.handle("Ann", m.Role(role="robot"))
    game.handle("Bob", m.Role(role="ghost-1"))
    for person, role in (("Bob", "robot"), ("Ann", "ghost-2")):
        with pytest.raises(Refused):
            game.handle(person, m.Role(role=role))  # type: ignore[arg-type]
    with pytest.raises(Refused, match="choose a role"):
        game.handle("Eve", m.Goal(candidate=1))
    with pytest.raises(Refused, match="not yours"):
        game.handle("Bob", m.Drive(v=0.1, omega=0.0))
    with pytest.raises(Refused, match="there are 0 to"):
        game.handle("Ann", m.Goal(candidate=1000))
    with pytest.raises(Refused, match="within 1 m"):
        game.handle("Ann", m.Goal(x=500.0, y=0.0))
    game.leave("Ann")
    game.handle("Bob", m.Role(role="robot"))


def test_person_sends_ghost_anywhere_and_catches_the_robot(game: SimulatedGame) -> None:
    game.handle("Ann", m.ClydeSpeed(mps=2.0))
    game.handle("Ann", m.Role(role="robot"))
    game.handle("Bob", m.Role(role="ghost-0"))
    home, _ = np.split(np.array(frame(game).true), [2])
    with pytest.raises(Refused, match="can reach"):
        game.handle("Bob", m.Goal(x=500.0, y=0.0))
    game.handle("Bob", m.Goal(candidate=0))
    pellet = game.scene().facts["pellets"][0]
    assert frame(game).ghost_goals[0] == pytest.approx(pellet, abs=0.5)
    game.handle("Bob", m.Goal(candidate=-1))
    assert np.isnan(frame(game).ghost_goals).all()
    game.handle("Bob", m.Goal(follow=True))
    assert frame(game).ghost_goals[0] == pytest.approx(home)
    game.handle("Ann", m.Start())
    wait_for(lambda: game.handle("Ann", m.Stories()))
    story = game.handle("Ann", m.Stories())[0]
    assert (story["result"], story["catcher"], story["ghosts_played"]) == ("caught", 0, [0])
    assert story["link"] == ""


def test_ghost_taken_in_a_round_obeys_from_the_next(game: SimulatedGame) -> None:
    game.handle("Ann", m.Speed(times=1))
    game.handle("Ann", m.Start())
    wait_for(lambda: frame(game).state == "running")
    assert game.handle("Bob", m.Role(role="ghost-0"))["words"]
    with pytest.raises(Refused, match="next round"):
        game.handle("Bob", m.Goal(follow=True))


def test_a_person_plays_a_round_beside_the_policy_and_both_results_are_shown(game: SimulatedGame) -> None:
    game.handle("Ann", m.Role(role="robot"))
    game.handle("Ann", m.Speed(times=1))  # a round that lasts long enough to be seen
    game.handle("Ann", m.Start())
    wait_for(lambda: frame(game).state == "running")
    assert frame(game).baseline is not None
    game.handle("Ann", m.Goal(candidate=2))
    game.handle("Ann", m.Speed(times=50))
    wait_for(lambda: frame(game).state == "menu")
    story = game.handle("Ann", m.Stories())[0]
    assert story["player"] == "person"
    assert story["link"] == ""
    beside = game.handle("Ann", m.Stories())[0]["second"]
    assert beside["result"] in ("complete", "caught", "timeout")
    game.leave("Ann")
    alone = played(game, seed=story["seed"])
    assert (alone["result"], alone["collected"]) == (beside["result"], beside["collected"])


def test_a_robot_driven_by_hand_stands_without_further_messages(game: SimulatedGame) -> None:
    game.handle("Ann", m.Setup(settings={}))
    game.handle("Ann", m.Speed(times=1))
    game.handle("Ann", m.Role(role="robot"))
    game.handle("Ann", m.Start())
    wait_for(lambda: frame(game).state == "running")
    home = frame(game).true
    assert home is not None

    def turned() -> bool:
        game.handle("Ann", m.Drive(v=0.0, omega=1.5))
        now = frame(game)
        return (now.true is not None and abs(now.true[2] - home[2]) > 0.5) or now.state != "running"

    wait_for(turned)
    wait_for(lambda: frame(game).velocity == (0.0, 0.0))


def test_every_event_is_shown_by_the_ring_and_sounds_by_their_notes(game: SimulatedGame) -> None:
    words = vocabulary()
    for word in words["events"]:
        number = game.news(0)[-1]["number"]
        game.handle("Ann", m.Event(word=word))
        shown = game.news(number)
        assert shown[0]["event"] == word
        assert {"light": words["events"][word]["light"]} in [{"light": n.get("light")} for n in shown]
        ring = frame(game).ring
        assert (ring is None) == (words["events"][word]["light"] == "off")
    for notes in words["sounds"].values():
        assert all(20 < hz < 5000 and 0 < seconds < 2 for hz, seconds in notes)


def test_motions_turn_the_robot_only_when_armed(game: SimulatedGame) -> None:
    home = frame(game).true
    assert home is not None
    game.handle("Ann", m.Event(word="death"))
    time.sleep(0.1)
    assert frame(game).true == home
    game.handle("Ann", m.Arm(on=True))
    game.handle("Ann", m.Event(word="start theatrical"))
    wait_for(lambda: (now := frame(game).true) is not None and abs(now[2] - home[2]) > 0.1)


def test_lidar_and_terms_are_there_while_they_are_watched(game: SimulatedGame) -> None:
    assert len(frame(game).scan) == 0
    game.watch(why=True, lidar=True)
    scan = frame(game).scan
    assert len(scan) == 180
    assert np.nanmin(scan) > 0.1
    game.handle("Ann", m.Start())
    wait_for(lambda: any("why" in one for one in game.news(0)))
    game.watch(why=False, lidar=False)
    assert len(frame(game).scan) == 0


def test_the_readiness_list_describes_the_round(game: SimulatedGame) -> None:
    assert {one["name"] for one in game.handle("Ann", m.Ready())} == {"simulator", "map", "configuration"}


def test_a_game_that_has_ended_refuses_requests() -> None:
    game = SimulatedGame(QUICK)
    game.close()
    with pytest.raises(Refused, match="has ended"):
        game.handle("Ann", m.Start())


def test_rules_that_cannot_be_chosen_are_refused_at_the_start() -> None:
    with pytest.raises(Refused, match="nowhere"):
        SimulatedGame(Rules(map="nowhere"))
