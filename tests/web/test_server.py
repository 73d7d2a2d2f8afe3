"""The server over real sockets: what is answered, in which order, and who may do what."""

import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx
import pytest
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import connect

from pacman_env.web import page_messages, roles, sessions
from pacman_env.web.access import Tokens
from pacman_env.web.game_interface import Refused
from pacman_env.web.page_messages import Message
from pacman_env.web.server import WebServer
from tests.waiting import PATIENCE_S, wait_for
from tests.web.pages import Page, at, decode, upload, viewer_url
from tests.web.scripted_game import ScriptedGame
from tests.web.test_page_messages import RIGHT

ROOT = Path(__file__).resolve().parents[2]


class SlowGame(ScriptedGame):
    """A game whose ``start``, and the stop of the first guest, take until ``go_on`` is set."""

    def __init__(self) -> None:
        super().__init__()
        self.begun, self.go_on = threading.Event(), threading.Event()

    def handle(self, person: str, message: Message) -> Any:
        super().handle(person, message)
        if isinstance(message, page_messages.Start):
            self.begun.set()
            assert self.go_on.wait(PATIENCE_S)
        return {"did": type(message).__name__}

    def stop(self, person: str) -> None:
        super().stop(person)
        if person == "guest-1" and not self.begun.is_set():
            assert self.go_on.wait(PATIENCE_S)

    def begin(self, page: Page) -> None:
        """Start on a page, which does not end before ``go_on``."""
        page.send("start")
        assert self.begun.wait(PATIENCE_S)


def test_new_page_receives_scene_and_steady_frames(game: ScriptedGame, server: WebServer) -> None:
    with Page(server) as page:
        assert page.hello["access"] == "operator"
        assert page.hello["source"] == "simulator"
        assert page.hello["choices"] == {"maps": ["house"]}
        while len(page.frames) < 20:
            page.read()
        assert [text["kind"] for text in page.texts] == ["hello", "scene", "people"]
        assert page.texts[1]["home"] == [0.0, 0.0, None]  # JSON has no NaN
        looks = game.polled_at[:]
        assert len(looks) <= 20 * (looks[-1] - looks[0]) + 2
        numbers = [decode(frame).number for _, frame in page.frames]
        assert numbers == sorted(set(numbers))  # none twice: there are no more than looks


def test_message_is_carried_out_and_answered(serve: Callable[..., WebServer]) -> None:
    game = ScriptedGame(lambda person, message: {"nan": float("nan"), "by": person})
    with Page(serve(game)) as page:
        answer = page.ask("start")
        assert answer == {"kind": "answer", "id": 1, "ok": True, "words": "", "data": {"nan": None, "by": page.name}}
        assert game.handled == [(page.name, page_messages.Start(id=1))]
        assert page.ask("ping")["ok"]
        assert page.people(operator=page.name)["viewers"] == 1


def test_refusal_is_answered_with_reason(server: WebServer) -> None:
    with Page(server) as page:
        assert page.ask("place_clyde", x=1, y=2)["words"] == "not in the menu"
        page.send("place_clyde", x=1, y=2, id=0)
        assert page.wait("refused")["words"] == "not in the menu"
        page.socket.send(b'{"do":"start"}')
        assert "not bytes" in page.wait("refused")["words"]


def test_error_of_the_game_is_logged_once(
    game: ScriptedGame, server: WebServer, web: httpx.Client, lines: list[str]
) -> None:
    with Page(server) as page:
        game.fails = {"handle", "stop", "frame", "watch", "add_map", "leave"}
        for _ in range(3):
            assert page.ask("start")["words"] == "internal error"
            assert page.ask("stop")["words"] == "internal error"
        wait_for(lambda: any("frame is broken" in line for line in lines))
        assert not upload(web, server.url, yaml="x").json()["ok"]
        game.fails = set()
        assert page.ask("start")["ok"]
        seen = len(page.frames)
        while len(page.frames) == seen:
            page.read()
    assert len(lines) == 4
    assert all("is broken" in line and "\n" not in line for line in lines)


def test_page_connects_as_soon_as_game_works(serve: Callable[..., WebServer], lines: list[str]) -> None:
    game = ScriptedGame()
    game.fails = {"choices"}
    server = serve(game)

    def mend() -> None:
        wait_for(lambda: lines)
        game.fails = set()

    threading.Thread(target=mend).start()
    with Page(server) as page:
        assert page.hello["choices"] == {"maps": ["house"]}
    assert len(lines) == 1


def test_messages_keep_their_order_per_person(serve: Callable[..., WebServer]) -> None:
    game = SlowGame()
    server = serve(game)
    with Page(server) as one, Page(server) as other:
        game.begin(one)
        last = [one.send("clyde_speed", mps=k / 10) for k in range(1, 20)][-1]
        assert other.ask("stories")["data"] == {"did": "Stories"}
        assert [type(message) for _, message in game.handled] == [page_messages.Start, page_messages.Stories]
        game.go_on.set()
        one.wait("answer", lambda text: text["id"] == last)
        speeds = [message.mps for _, message in game.handled if isinstance(message, page_messages.ClydeSpeed)]
        assert speeds == [k / 10 for k in range(1, 20)]


def test_stop_overtakes_flood_that_is_refused(serve: Callable[..., WebServer], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sessions, "MOST_TEXTS", 8)
    game = SlowGame()
    with Page(serve(game)) as page:
        game.begin(page)
        for _ in range(200):  # more than may wait, and more than the rate
            page.send("clyde_speed", mps=1.0)
        page.send("stop")
        wait_for(lambda: ("stop", page.name) in game.calls)
        assert [type(message) for _, message in game.handled] == [page_messages.Start], "the others still wait"
        for words in ("too many requests", "some are ignored"):
            while not any(words in text.get("words", "") for text in page.texts):
                page.read()
        game.go_on.set()


def test_release_does_not_undo_a_later_stop(serve: Callable[..., WebServer]) -> None:
    game = SlowGame()
    with Page(serve(game)) as page:
        game.begin(page)
        release = page.send("release")
        assert page.ask("stop")["ok"]
        game.go_on.set()
        assert page.wait("answer", lambda text: text["id"] == release)["words"] == "stopped again meanwhile"
        assert ("release", page.name) not in game.calls
        assert page.ask("release")["ok"]
        assert ("release", page.name) in game.calls


def test_repeated_stops_are_merged_and_each_is_answered(serve: Callable[..., WebServer]) -> None:
    game = SlowGame()
    server = serve(game)
    with Page(server) as page, Page(server) as other:
        first = page.send("stop")
        for _ in range(1000):
            page.socket.send('{"do":"stop"}')
        assert page.ask("ping")["ok"], "all have arrived"
        assert other.ask("stop")["ok"], "the first of the other person is still being done"
        last = page.send("stop")
        game.go_on.set()
        for number in (first, last):
            page.wait("answer", lambda text, number=number: text["id"] == number)  # type: ignore[misc]
        assert sum(call[0] == "stop" for call in game.calls) <= 4


# who may do what


def test_viewer_may_stop_and_ask_only(serve: Callable[..., WebServer]) -> None:
    game = ScriptedGame()
    server = serve(game, tokens=Tokens.new())
    with Page(viewer_url(server)) as page:
        assert page.hello["access"] == "viewer"
        answers = {word: page.ask(word, **fields) for word, fields in RIGHT.items()}
        allowed = {"stop", "watch", "why", "stories", "ready", "ping"}
        assert {word for word, answer in answers.items() if answer["ok"]} == allowed
        assert answers["start"]["words"] == "your link is view only; STOP still works"
        assert {type(message) for _, message in game.handled} <= set(page_messages.FOR_ALL)
        assert ("stop", page.name) in game.calls


def test_control_belongs_to_one_person_until_given(game: ScriptedGame, server: WebServer) -> None:
    with Page(server) as one, Page(server) as other:
        assert one.ask("start")["ok"]
        refused = other.ask("start")
        assert (refused["ok"], refused["words"]) == (False, f"{one.name} has control: ask for it")
        assert other.ask("stop")["ok"]
        assert not other.ask("release")["ok"]
        assert other.ask("control", what="ask")["ok"]
        one.people(operator=one.name, asking=[other.name])
        assert one.ask("control", what="give")["ok"]
        other.people(operator=other.name, asking=[])
        assert other.ask("release")["ok"]
        assert not one.ask("start")["ok"]


@pytest.mark.parametrize("cause", ["time", "menu", "time while the game fails"])
def test_control_is_free_after_page_has_left(
    game: ScriptedGame, server: WebServer, lines: list[str], monkeypatch: pytest.MonkeyPatch, cause: str
) -> None:
    monkeypatch.setattr(roles, "KEPT_S", 600.0)
    with Page(server) as other:
        with Page(server) as one:
            one.ask("control", what="take")
            one.ask("role", role="robot")
            other.people(operator=one.name)
        wait_for(lambda: ("leave", one.name) in game.calls)  # what it drives stands at once, long before
        assert not other.ask("start")["ok"]
        if cause == "menu":
            game.state = "menu"
            other.people(operator=None)
        else:
            game.fails = {"frame"} if "fails" in cause else set()
            monkeypatch.setattr(roles, "KEPT_S", 0.0)
            wait_for(lambda: any("did not come back" in line for line in lines))
        assert other.ask("start")["ok"]
        assert other.ask("role", role="robot")["ok"]


def test_people_tell_that_operator_is_away(server: WebServer) -> None:
    with Page(server) as other:
        with Page(server) as one:
            one.ask("control", what="take")
            other.people(operator=one.name, away=False)
        assert other.people(away=True)["operator"] == one.name
        with Page(server, again=one.hello["again"]):
            other.people(operator=one.name, away=False)


def test_newcomer_finds_control_free_in_menu(
    game: ScriptedGame, server: WebServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(roles, "KEPT_S", 600.0)
    with Page(server) as one:
        one.ask("control", what="take")
        one.people(operator=one.name)
    wait_for(lambda: ("leave", one.name) in game.calls)
    game.state = "menu"
    with Page(server) as other:
        assert other.people()["operator"] is None


def test_hello_has_new_run_after_restart(serve: Callable[..., WebServer]) -> None:
    first, second = serve(ScriptedGame()), serve(ScriptedGame())
    runs = []
    for server in (first, first, second):
        with Page(server) as page:
            runs.append(page.hello["run"])
    assert runs[0] == runs[1] != runs[2]


def test_options_are_reset_only_if_page_is_unused(game: ScriptedGame, server: WebServer) -> None:
    with Page(server) as one, Page(server) as two:
        assert game.calls.count(("reset_options",)) == 1
    wait_for(lambda: {("leave", one.name), ("leave", two.name)} <= set(game.calls))
    with Page(server, again=one.hello["again"]) as back:
        assert back.name == one.name
        assert game.calls.count(("reset_options",)) == 1
    wait_for(lambda: game.calls.count(("leave", one.name)) == 2)
    with Page(server):
        assert game.calls.count(("reset_options",)) == 2


def test_page_regains_name_control_role_on_return(game: ScriptedGame, server: WebServer) -> None:
    with Page(server) as one:
        one.ask("control", what="take")
        one.ask("role", role="ghost-1")
    wait_for(lambda: ("leave", one.name) in game.calls)
    with Page(server, again=one.hello["again"]) as back, Page(server, again=one.hello["again"]) as thief:
        assert back.name == one.name
        assert thief.name != one.name  # a key is good once
        roles = thief.people(operator=one.name)["roles"]
        assert roles["ghost-1"] == one.name
        wait_for(lambda: game.handled.count((one.name, page_messages.Role(role="ghost-1"))) == 1)
        assert back.ask("start")["ok"]


def test_page_returning_early_replaces_its_old_connection(game: ScriptedGame, server: WebServer) -> None:
    with Page(server) as one:
        one.ask("control", what="take")
        with Page(server, again=one.hello["again"]) as back:
            assert back.name == one.name
            assert "reconnected" in one.wait("bye")["words"]
            assert back.ask("start")["ok"]
            back.people(viewers=1)


def test_role_accepts_messages_of_its_person_only(game: ScriptedGame, server: WebServer) -> None:
    with Page(server) as one, Page(server) as other:
        assert one.ask("goal", candidate=1)["words"] == "choose a role in the tab Play first"
        assert one.ask("role", role="robot")["ok"]
        assert other.ask("role", role="robot")["words"] == f"{one.name} has the role robot"
        assert other.ask("role", role="ghost-0")["ok"]
        assert other.ask("drive", v=1, omega=0)["words"] == "choose the robot's role in the tab Play first"
        assert one.ask("drive", v=1, omega=0)["ok"]
        assert other.ask("goal", x=1, y=2)["ok"]
        assert one.ask("role", role="none")["ok"]
        assert other.ask("role", role="robot")["ok"]
        other.people(roles={role: other.name if role == "robot" else None for role in roles.ROLES})


def test_role_is_kept_when_another_is_refused(serve: Callable[..., WebServer]) -> None:
    def handle(person: str, message: Message) -> None:
        if isinstance(message, page_messages.Role) and message.role == "ghost-3":
            raise Refused("there are 3 ghosts")

    with Page(serve(ScriptedGame(handle))) as page:
        assert page.ask("role", role="robot")["ok"]
        assert page.ask("role", role="ghost-3")["words"] == "there are 3 ghosts"
        assert page.ask("drive", v=1, omega=0)["ok"]  # he has the one he had


def test_robot_role_needs_control_of_real_robot(serve: Callable[..., WebServer]) -> None:
    game = ScriptedGame(source="ros")
    server = serve(game)
    with Page(server) as one, Page(server) as other:
        assert one.ask("role", role="robot")["ok"]
        one.people(operator=one.name)
        assert not other.ask("role", role="robot")["ok"]
        other.ask("control", what="ask")
        assert one.ask("control", what="give")["ok"]
        assert not one.ask("drive", v=0.1, omega=0)["ok"]
        assert other.ask("role", role="robot")["ok"]
        assert (one.name, page_messages.Role(role="none")) in game.handled


# beginning and end


def test_server_announces_its_end_and_closes_idle_connections(server: WebServer) -> None:
    with Page(server) as page, socket.create_connection(("127.0.0.1", server.port)) as idle:
        closing = threading.Thread(target=server.close)
        closing.start()
        assert page.wait("bye")["words"] == "the server ends"
        with pytest.raises(ConnectionClosed) as closed:
            page.listen(page.patience_s)
        assert closed.value.rcvd is not None
        assert closed.value.rcvd.code == 1001
        assert idle.recv(100) == b""
        closing.join(PATIENCE_S)


def test_address_is_refused_with_the_reason(serve: Callable[..., WebServer]) -> None:
    taken = serve(ScriptedGame()).port
    for host, port, words in (
        ("127.0.0.1", taken, f"port {taken} of 127.0.0.1 is in use"),
        ("no-such-name.invalid", 0, "no-such-name.invalid: no such address"),
        ("192.0.2.1", 0, "192.0.2.1 is not an address of this computer"),
    ):
        with pytest.raises(OSError, match=words):
            WebServer(ScriptedGame(), host, port).start()


def test_server_listens_on_ipv6(serve: Callable[..., WebServer], web: httpx.Client) -> None:
    try:
        server = serve(ScriptedGame(), host="::1")
    except OSError:
        pytest.skip("no IPv6 here")
    assert server.url == f"http://[::1]:{server.port}/"
    with Page(server) as page:
        assert page.ask("start")["ok"]


#: A game that never returns from a request. The main thread receives SIGTERM, another one SIGINT.
SERVES = """
import signal, threading
from pacman_env.web.server import serve
from tests.web.scripted_game import ScriptedGame
game = ScriptedGame(lambda person, message: threading.Event().wait())
serve(game, port=0, opened=lambda url: signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT}))
print("ended", flush=True)
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_signal_ends_the_server_while_busy(number: signal.Signals) -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    with subprocess.Popen(
        [sys.executable, "-c", SERVES], stdout=subprocess.PIPE, text=True, env=environment
    ) as process:
        assert process.stdout is not None
        url = process.stdout.readline().split()[2]
        options = {"compression": None, "max_queue": 1, "close_timeout": 0.1}
        with connect(at(url, "ws"), **options) as busy, connect(at(url, "ws"), **options):
            busy.send('{"do":"start","id":1}')
            while 'operator":"guest' not in str(busy.recv(timeout=PATIENCE_S)):
                pass
            process.send_signal(number)
            assert process.stdout.read() == "ended\n"
            assert process.wait(PATIENCE_S) == 0
