"""The server over the real simulator: what one person asks keeps nobody waiting."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator

import httpx
import pytest

from pacman_env.web.frame import Frame
from pacman_env.web.match import Match
from pacman_env.web.played_round import PlayedRound
from pacman_env.web.server import WebServer
from pacman_env.web.simulated import SimulatedGame
from tests.waiting import PATIENCE_S, wait_for
from tests.web.frames import decode, decode_all
from tests.web.pages import Page, at


@pytest.fixture
def game() -> Iterator[SimulatedGame]:
    game = SimulatedGame(seed=1)
    wait_for(lambda: game.frame() is not None)
    yield game
    game.close()


def shown(page: Page, is_it: Callable[[Frame], bool]) -> Frame:
    """The last frame if it is as wanted, else the next that is."""
    while not page.frames or not is_it(decode(page.frames[-1][1])):
        page.read()
    return decode(page.frames[-1][1])


def test_a_round_is_set_up_begun_seen_and_stopped(
    serve: Callable[..., WebServer], game: SimulatedGame, web: httpx.Client
) -> None:
    server = serve(game)
    with Page(server) as page:
        assert page.ask("setup", map="loop", seed=5, policy="nearest")["ok"]
        assert page.ask("start")["ok"]
        begun = shown(page, lambda frame: frame.state != "menu")
        scene = [text for text in page.texts if text["kind"] == "scene"][-1]
        assert scene["map"]["name"] == "loop"
        assert begun.revision == scene["revision"]
        assert web.get(at(server.url, scene["map"]["url"])).content.startswith(b"\x89PNG")
        assert page.ask("stop")["ok"]
        shown(page, lambda frame: frame.stopped)
        assert page.ask("release")["ok"]
        shown(page, lambda frame: not frame.stopped)


def test_a_round_that_is_finished_at_once_keeps_no_other_page_waiting(
    serve: Callable[..., WebServer], game: SimulatedGame, web: httpx.Client, monkeypatch: pytest.MonkeyPatch
) -> None:
    record, begun, go_on = Match._record, threading.Event(), threading.Event()

    def slow(self: Match, played: PlayedRound) -> None:
        begun.set()
        assert go_on.wait(PATIENCE_S)
        record(self, played)

    monkeypatch.setattr(Match, "_record", slow)
    server = serve(game)
    with Page(server) as one, Page(server) as other:
        finished = one.send("setup", map="house", seed=3, finish=True)
        assert begun.wait(PATIENCE_S)
        assert other.ask("ping")["ok"]
        go_on.set()
        story = one.wait("answer", lambda text: text["id"] == finished)["data"]["story"]
        frames = web.get(at(server.url, f"story/{story}.json")).content
        assert decode_all(frames)[0].time_s == 0.0


def test_a_file_that_is_no_map_is_refused_with_the_checkers_words(
    serve: Callable[..., WebServer], game: SimulatedGame, web: httpx.Client
) -> None:
    server = serve(game)
    answer = web.post(at(server.url, "map"), json={"name": "mine", "yaml": "image: mine.pgm", "image": "UDUK"})
    assert answer.status_code == 200
    assert not answer.json()["ok"]
    assert answer.json()["words"]
