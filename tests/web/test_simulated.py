"""The simulated game of the page: a real one, in its thread."""

import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from typing import Any

import numpy as np
import pytest
from msgspec import UNSET

from pacman_env.web import page_messages as m
from pacman_env.web.frame import Frame
from pacman_env.web.game_interface import MOST_NEWS, News, Refused
from pacman_env.web.match import HARDEST
from pacman_env.web.orders import Orders
from pacman_env.web.played_round import PlayedRound
from pacman_env.web.rules import Rules
from pacman_env.web.server import WebServer
from pacman_env.web.simulated import SimulatedGame
from pacman_env.web.vocabulary import vocabulary
from tests.waiting import PATIENCE_S, wait_for
from tests.web.game_contract import GameContract, Play
from tests.web.pages import Page, decode, decode_all

QUICK = Rules(policy="clyde_aware", second="nearest", settings={"time_limit_s": 20.0})


class SimulatedPlay(Play):
    def __init__(self) -> None:
        self.page = SimulatedGame(Rules(policy="nearest", second="nearest", map="loop"), seed=3)
        self.handle(m.ClydeSpeed(mps=0.05))

    def round(self) -> None:
        """Begin a round in haste, and go on in real time."""
        self.menu()
        self.handle(m.Speed(times=50))
        self.handle(m.Start())
        self.wait(lambda: self.frame.state == "running", "the round")
        self.handle(m.Speed(times=1))
        self.wait(lambda: self.drives, "the robot to drive")


@pytest.fixture(scope="module")
def play() -> Iterator[SimulatedPlay]:
    play = SimulatedPlay()
    with closing(play.page):
        yield play


class TestSimulatedGameContract(GameContract):
    """The promises of every game."""


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


def begin(game: SimulatedGame) -> None:
    """Start a round, at a speed at which it lasts long enough to be seen."""
    game.handle("Ann", m.Speed(times=4))
    game.handle("Ann", m.Start())
    wait_for(lambda: frame(game).state == "running")
    game.handle("Ann", m.Speed(times=1))


def played(game: SimulatedGame, **setup: Any) -> dict[str, Any]:
    """A round to its end, and its summary."""
    if setup:
        game.handle("Ann", m.Setup(**setup))
    before = len(game.handle("Ann", m.Stories()))
    game.handle("Ann", m.Start())
    wait_for(lambda: len(game.handle("Ann", m.Stories())) > before)
    wait_for(lambda: frame(game).state == "menu")
    return game.handle("Ann", m.Stories())[0]


def test_round_passes_every_state_back_to_menu(game: SimulatedGame) -> None:
    assert frame(game).state == "menu"
    story = played(game, settings={})
    states = [one["state"] for one in game.news(0) if "state" in one]
    assert states[:4] == ["menu", "returning_home", "starting", "running"]
    ends = {"complete": ["complete", "returning_home", "menu"], "caught": ["dying", "returning_home", "menu"]}
    assert states[4:] == ends[story["result"]]
    events = [one["event"] for one in game.news(0) if "event" in one]
    assert events.count("pellet") == story["collected"]
    assert events[1] == "start", "the melody of a short show"
    if story["result"] == "complete":
        assert (frame(game).round, frame(game).score) == (2, story["collected"])
        assert game.scene().facts["clyde_speed_mps"] > 0.25


def test_setup_with_same_seed_repeats_round(game: SimulatedGame) -> None:
    first = played(game)
    again = game.handle("Bob", m.Setup(seed=first["seed"], finish=True))
    second = game.handle("Bob", m.Stories())[0]
    assert second["story"] == again["story"]
    keys = ("result", "collected", "time_s", "ticks", "parts", "decisions", "link")
    assert {key: second[key] for key in keys} == {key: first[key] for key in keys}


def test_recorded_round_contains_every_frame(game: SimulatedGame) -> None:
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


def test_pause_and_speed_change_the_simulated_time(game: SimulatedGame) -> None:
    begin(game)
    game.handle("Ann", m.Pause(on=True))
    held = frame(game)
    assert held.paused
    game.handle("Ann", m.Event(word="start"))
    wait_for(lambda: frame(game).number > held.number, "a later frame")
    assert frame(game).time_s == held.time_s
    game.handle("Ann", m.Speed(times=3))
    assert frame(game).speed == 3
    game.handle("Ann", m.Pause(on=False))
    wait_for(lambda: frame(game).time_s > held.time_s or frame(game).state != "running")
    game.reset_options()
    assert frame(game).speed == 50, "a newcomer alone gets the speed of the start"


def test_frame_time_never_decreases(game: SimulatedGame) -> None:
    begin(game)
    before = frame(game)
    game.handle("Ann", m.Speed(times=10))
    while (now := frame(game)).state == "running":
        assert now.time_s >= before.time_s - 1e-6
        assert now.number >= before.number
        if now.number == before.number:
            assert now.encode() == before.encode()
        before = now


def test_ghost_speed_is_kept_after_reset(game: SimulatedGame) -> None:
    game.handle("Ann", m.ClydeSpeed(mps=1.5))
    assert game.scene().facts["clyde_speed_mps"] == 1.5
    game.handle("Ann", m.Reset())
    assert game.scene().facts["clyde_speed_mps"] == 1.5


def test_person_sends_a_ghost_to_the_robot(game: SimulatedGame) -> None:
    game.handle("Ann", m.ClydeSpeed(mps=2.0))
    game.handle("Ann", m.Role(role="robot"))
    game.handle("Bob", m.Role(role="ghost-0"))
    home, _ = np.split(np.array(frame(game).true), [2])
    game.handle("Bob", m.Goal(x=500.0, y=0.0))
    assert np.isfinite(frame(game).ghost_goals).all(), "the nearest place that it can reach"
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


def test_person_plays_same_round_as_policy(game: SimulatedGame) -> None:
    game.handle("Ann", m.Role(role="robot"))
    begin(game)
    assert frame(game).baseline is not None
    assert game.handle("Bob", m.Role(role="ghost-0"))["words"] == "yours from the next round on"
    with pytest.raises(Refused, match="next round"):
        game.handle("Bob", m.Goal(follow=True))
    game.leave("Bob")
    game.handle("Ann", m.Goal(candidate=2))
    game.handle("Ann", m.Speed(times=50))
    wait_for(lambda: frame(game).state == "menu")
    story = game.handle("Ann", m.Stories())[0]
    assert story["player"] == "person"
    beside = game.handle("Ann", m.Stories())[0]["second"]
    assert beside["result"] in ("complete", "caught", "timeout")
    game.leave("Ann")
    alone = played(game, seed=story["seed"])
    assert (alone["result"], alone["collected"]) == (beside["result"], beside["collected"])


def test_person_has_three_lives_to_complete_levels(game: SimulatedGame) -> None:
    game.handle("Ann", m.Setup(ghosts=("chase",), clyde_mps=2.0, seed=5))
    game.handle("Ann", m.Role(role="robot"))
    game.handle("Ann", m.Goal(candidate=-1))
    left, seeds = [], set()
    for _ in range(3):
        left.append(frame(game).lives)
        story = played(game)
        assert story["result"] == "caught"
        seeds.add(story["seed"])
        assert frame(game).score == 0, "the score at the start of the level"
    assert (left, frame(game).lives) == ([3, 2, 1], 3)
    assert len(seeds) == 3, "a retry is another round"
    game.leave("Ann")
    assert frame(game).lives is UNSET


def test_next_round_starts_during_end_of_last(game: SimulatedGame) -> None:
    game.handle("Ann", m.Setup(ghosts=("chase",), clyde_mps=2.0, seed=5))
    game.handle("Ann", m.Role(role="robot"))
    game.handle("Ann", m.Goal(candidate=-1))
    for same in (False, True):
        game.handle("Ann", m.Start())
        wait_for(lambda: frame(game).state == "dying")
        game.handle("Ann", m.Start(same=same))
        assert frame(game).state in ("returning_home", "starting", "running")
        seed = game.handle("Ann", m.Stories())[0]["seed"]
        assert (game.scene().facts["seed"] == seed) == same
        wait_for(lambda: frame(game).state == "menu")


def test_person_has_no_harder_levels_than_third(game: SimulatedGame) -> None:
    game.handle("Ann", m.Setup(map="loop", ghosts=("wander",), clyde_mps=0.1, seed=5))
    game.handle("Ann", m.Role(role="robot"))
    speeds = []
    for number in range(1, HARDEST + 2):
        game._match._controller.round = number
        game._match.lay_out()
        speeds.append(game.scene().facts["clyde_speed_mps"])
    assert speeds == pytest.approx([0.1, 0.15, 0.2, 0.2])


def test_prepared_round_is_shown_as_demo(game: SimulatedGame) -> None:
    seed, facts = game.scene().facts["seed"], game.scene().facts
    data = game.story(0)
    assert data is not None
    frames = decode_all(data)
    assert {one.revision for one in frames} == {game.scene().revision}
    assert (frame(game).state, game.scene().facts) == ("menu", facts)
    assert not game.handle("Ann", m.Stories())
    assert played(game)["seed"] == seed
    own = game.story(1)
    assert own is not None
    assert [one.true for one in decode_all(own)] == [one.true for one in frames]


def test_moment_is_played_again_from_link(game: SimulatedGame) -> None:
    game.handle("Ann", m.Role(role="robot"))
    begin(game)
    game.handle("Ann", m.Goal(candidate=2))
    game.handle("Ann", m.Speed(times=50))
    wait_for(lambda: frame(game).state == "menu")
    story = game.handle("Ann", m.Stories())[0]
    data = game.story(story["story"])
    assert data is not None
    then = decode_all(data)[30]
    game.handle("Ann", m.Setup(seed=story["seed"], moves=story["moves"], until=30))
    assert (frame(game).state, frame(game).time_s, frame(game).true) == ("menu", then.time_s, then.true)
    begin(game)
    game.handle("Ann", m.Speed(times=50))
    wait_for(lambda: frame(game).state == "menu")
    again = game.handle("Ann", m.Stories())[0]
    assert (again["seed"], again["player"]) == (story["seed"], "person")
    assert again["second"] == story["second"]


def test_driven_robot_stops_without_further_messages(game: SimulatedGame) -> None:
    game.handle("Ann", m.Role(role="robot"))
    begin(game)
    home = frame(game).true
    assert home is not None

    def turned() -> bool:
        game.handle("Ann", m.Drive(v=0.0, omega=1.5))
        now = frame(game)
        return (now.true is not None and abs(now.true[2] - home[2]) > 0.5) or now.state != "running"

    wait_for(turned)
    wait_for(lambda: frame(game).velocity == (0.0, 0.0))


def test_readiness_list_describes_the_round(game: SimulatedGame) -> None:
    assert {one["name"] for one in game.handle("Ann", m.Ready())} == {"simulator", "map", "configuration"}


def test_ended_game_refuses_requests() -> None:
    game = SimulatedGame(QUICK)
    game.close()
    with pytest.raises(Refused, match="has ended"):
        game.handle("Ann", m.Start())


def test_unknown_map_is_refused_at_the_start() -> None:
    with pytest.raises(Refused, match="nowhere"):
        SimulatedGame(Rules(map="nowhere"))


def test_every_event_shows_its_light(game: SimulatedGame) -> None:
    for word, feedback in vocabulary()["events"].items():
        number = game.news(0)[-1]["number"]
        game.handle("Ann", m.Event(word=word))
        shown = game.news(number)
        assert shown[0]["event"] == word
        assert feedback["light"] in [news.get("light") for news in shown]
        assert (frame(game).ring is None) == (feedback["light"] == "off")


def test_server_shows_the_game_during_a_setup(
    serve: Callable[..., WebServer], game: SimulatedGame, monkeypatch: pytest.MonkeyPatch
) -> None:
    step, begun, go_on = PlayedRound.step, threading.Event(), threading.Event()

    def slow(self: PlayedRound, orders: Orders) -> None:
        begun.set()
        assert go_on.wait(PATIENCE_S)
        step(self, orders)

    monkeypatch.setattr(PlayedRound, "step", slow)
    server = serve(game)
    with Page(server) as one, Page(server) as other:
        finished = one.send("setup", map="loop", seed=3, finish=True)
        assert begun.wait(PATIENCE_S)
        assert other.ask("ping")["ok"]
        assert other.ask("stop")["ok"]
        while not (other.frames and decode(other.frames[-1][1]).stopped):
            other.read()
        go_on.set()
        assert one.wait("answer", lambda text: text["id"] == finished)["ok"]
        assert [text["map"]["name"] for text in one.texts if text["kind"] == "scene"][-1] == "loop"


def test_news_keeps_only_the_newest_reason() -> None:
    news = News()
    for number in range(MOST_NEWS):
        news.add(why={"goal": number})
        news.add(words=str(number))
    last = news.after(0)
    assert len(last) == MOST_NEWS
    assert sum("why" in one for one in last) == 1
    assert last[-1]["number"] == 2 * MOST_NEWS
    assert [one["words"] for one in news.after(2 * MOST_NEWS - 2) if "words" in one] == [str(MOST_NEWS - 1)]
