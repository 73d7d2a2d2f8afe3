"""What an operator does: watch a game on a terminal of 80 columns, press keys, ask from another terminal, stop.

One real game, which began its first round by itself, serves most of these tests; each brings it to the
menu first. How the game ends by the key q is checked when the last of them is over.
"""

import contextlib
import io
import json
import os
import re
import signal
import socket
import sys
import urllib.request
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import pytest

from pacman_env.cli import main as cli
from pacman_env.ros import topics
from pacman_env.ros.game_nodes import GAME, LISTENERS, PAGE, SIMULATOR, WATCHER, GameSetup
from pacman_env.ros.supervisor.checks.check import OK
from pacman_env.ros.supervisor.doctor import doctor
from tests.ros.supervisor.terminal import COLUMNS, PATIENCE_S, Terminal
from tests.ros.system import Probe, System
from tests.web.pages import Page, decode

COMMAND = [sys.executable, "-m", "pacman_env.cli.main", "ros"]
SHOWS = ("--set", "show.start_s=1.0", "--set", "show.death_s=1.0")


@contextlib.contextmanager
def free_port() -> Iterator[int]:
    """A port that no other program is given meanwhile; the page can still be bound to it."""
    with socket.socket() as one:
        one.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)  # as the page's server has it
        one.bind(("127.0.0.1", 0))
        yield int(one.getsockname()[1])


@dataclass(frozen=True)
class Answer:
    """What a command printed, and its exit status."""

    status: int
    out: str
    err: str


def ask_plainly(*words: str) -> Answer:
    """A command of another operator: a participant of its own in the domain, made in the test's process."""
    out, err = io.StringIO(), io.StringIO()
    with mock.patch.dict(os.environ), contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = cli.main(["ros", *words])
    return Answer(status, out.getvalue(), err.getvalue())


def ask(*words: str) -> Answer:
    """About a simulated game."""
    return ask_plainly(*words, "--sim")


CHILD = b"pacman_env.ros.supervisor.child"


def pid_of(node: str) -> int | None:
    """A process of the game in this test's domain, found by its command line, which its policy's process shares."""
    domain = f"ROS_DOMAIN_ID={os.environ['ROS_DOMAIN_ID']}".encode()
    (module, *_) = GameSetup("house", web=1).command(node)
    found = []
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            with contextlib.suppress(OSError):  # it has just ended, or is another user's
                words = (folder / "cmdline").read_bytes().split(b"\0")
                if {module.encode(), CHILD} <= set(words) and domain in (folder / "environ").read_bytes().split(b"\0"):
                    found.append(int(folder.name))
    return min(found, default=None)


@dataclass(frozen=True)
class Game:
    """The game on its terminal, and a node of the test."""

    terminal: Terminal
    probe: Probe

    def wait_for(self, condition: Callable[[], Any], what: str) -> None:
        """Wait; messages are recorded meanwhile."""

        def holds() -> bool:
            self.probe.executor.spin_once(timeout_sec=0.0)
            return bool(condition())

        self.terminal.wait_for(holds, what)

    @property
    def link(self) -> str:
        """The page's address on the terminal."""
        shown = r"^page: (http://127\.0\.0\.1:\d+/) on this computer$"
        self.wait_for(lambda: self.terminal.shows(shown), "the page's address")
        (link,) = {found[1] for line in self.terminal.lines if (found := re.match(shown, line))}
        return link

    @property
    def stopped(self) -> bool:
        """Whether the goal selector is stopped by the operator."""
        return bool(json.loads(self.probe.values(topics.DIAGNOSTICS)[-1])["stopped"])

    def in_menu(self) -> None:
        """Break off what goes on, and wait for the menu."""
        assert ask("reset").status == 0
        self.wait_for(lambda: self.probe.values(topics.GAME_STATE)[-1:] == ["menu"], "the menu")
        self.wait_for(lambda: self.terminal.lines[-1].startswith("menu "), "the menu on the terminal")

    def begin_round(self) -> None:
        """Press the key, and wait for the round: after a reset it is the first one."""
        since = len(self.terminal.lines)
        self.terminal.press("s")
        self.wait_for(lambda: self.terminal.shows(r"^(starting|running) +round 1", since), "the round")


@pytest.fixture(scope="module")
def game(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Game]:
    folder = tmp_path_factory.mktemp("up")
    words = ["--map", "house", "--policy", "nearest", "--sim", "--home", "0.5", "0", "1.5", "--start"]
    with free_port() as port, System(folder) as system, Probe(system) as probe:
        probe.record(topics.GAME_STATE, topics.LIGHT_RING, topics.CMD_VEL, topics.DIAGNOSTICS, topics.PROCESSES)
        terminal = Terminal([*COMMAND, "up", *words, *SHOWS, "--web", str(port), "--logs", str(folder / "logs")])
        game = Game(terminal, probe)
        try:
            game.wait_for(lambda: terminal.shows(r"^running +round 1 "), "the round that begins by itself")
            assert terminal.shows(r"^starting(, compiling \(once\))?: waiting for ")
            assert terminal.shows(r"^game on /robot_15$")
            assert terminal.shows(r"^keys: s start, r reset, c continue, space stop, g release, q quit$")
            yield game
            quit_in_order(game)
        finally:
            if terminal.process.poll() is None:
                terminal.process.send_signal(signal.SIGINT)
                terminal.process.wait(PATIENCE_S)


def quit_in_order(game: Game) -> None:
    """Press q: what moves the robot ends first, the ring is given back, and every process is gone."""
    terminal, probe = game.terminal, game.probe
    game.in_menu()
    probe.clear()
    terminal.press("q")
    probe.wait_for(lambda: terminal.process.poll() is not None, PATIENCE_S, "the end")
    assert terminal.end() == 0, terminal.lines[-20:]
    assert not probe.messages(topics.LIGHT_RING)[-1].override_system
    last = probe.messages(topics.CMD_VEL)[-1].twist
    assert (last.linear.x, last.angular.z) == (0.0, 0.0)
    for name in (SIMULATOR, WATCHER, GAME, PAGE):
        assert pid_of(name) is None, name
    stopped = [line for line in terminal.lines if re.match(r"stopping \w+_\w+|stopping watcher", line)]
    assert re.match(r"stopping pacman_game +\d", stopped[0])
    assert re.match("stopping (sim_robot|watcher)", stopped[-1])
    assert any("operator_page" in line for line in stopped[1:-1])
    assert terminal.lines[-1] == "stopped"
    assert terminal.too_long == []
    nobody = ask("status", "--wait", "1")
    assert (nobody.status, nobody.err.count("\n")) == (3, 1)
    assert "no game in /robot_15" in nobody.err


def test_keys_start_and_reset_game(game: Game) -> None:
    terminal = game.terminal
    game.in_menu()
    game.begin_round()
    since = len(terminal.lines)
    shown = r"^running +round 1 +score \d+ +pellets \d+/13 +pose [\d.]+ s ago +nearest"
    game.wait_for(lambda: terminal.shows(shown, since), "the round on the terminal")
    terminal.press("s")
    game.wait_for(lambda: terminal.shows(r"game/start: start: the game is in state", since), "the refusal")
    terminal.press("r")
    game.wait_for(lambda: terminal.shows(r"^menu ", since), "the menu again")


def test_others_start_and_reset_game(game: Game) -> None:
    game.in_menu()
    started = ask("start")
    assert (started.status, started.err) == (0, "")
    assert started.out == "a round begins: the robot drives home first\n"
    again = ask("start")
    assert again.status == 1
    assert "start: the game is in state" in again.out
    answer = ask("status", "--json", "--wait", str(PATIENCE_S))
    facts = json.loads(answer.out)
    assert answer.status == 0, facts
    assert facts["absent"] == facts["pending"] == {"nodes": [], "values": []}
    assert facts["nodes"] == sorted([SIMULATOR, GAME, *LISTENERS])
    del facts["processes"]  # of `ros up`, which may be discovered last
    assert None not in facts.values()
    assert facts["namespace"] == "/robot_15"
    assert facts["goal_selector"]["home"] == [0.5, 0.0, 1.5]
    assert ask("reset").status == 0


def test_stop_holds_robot_until_release(game: Game) -> None:
    terminal = game.terminal
    game.in_menu()
    game.begin_round()
    since = len(terminal.lines)
    terminal.press(" ")
    game.wait_for(lambda: terminal.shows(r"^\w+ +round .*STOPPED", since), "the stop")
    assert "until 'pacman-env ros release'" in ask("status").out
    since = len(terminal.lines)
    terminal.press("g")
    game.wait_for(lambda: terminal.shows(r"^released$", since), "the release")
    obeying = (GAME, "game_event_mapper", "pacman_page")

    def all_obey() -> bool:
        """It names those who have answered by then, and says by its status if one is missing that drives."""
        stopped = ask("stop")
        assert stopped.err == ""
        assert stopped.status in (0, 1)
        return stopped.status == 0 and all(name in stopped.out for name in obeying)

    game.wait_for(all_obey, "all to obey")
    game.wait_for(lambda: game.stopped, "the game to say so")
    released = ask("release")
    assert released.status == 0
    assert released.out.startswith("released; received by ")
    game.wait_for(lambda: not game.stopped, "the game to go on")
    assert ask("release").out == "nothing was stopped\n"


def test_stop_by_page_outlives_it_until_it_is_back(game: Game) -> None:
    terminal, link = game.terminal, game.link
    game.in_menu()

    def there() -> bool:
        try:
            with urllib.request.urlopen(f"{link}health", timeout=5) as answer:
                return bool(json.load(answer)["ok"])
        except OSError:
            return False

    game.wait_for(there, "the page")
    with Page(link) as page:
        assert page.hello["source"] == "ros"
        scene = page.wait("scene", lambda text: bool(text["map"]))
        with urllib.request.urlopen(link + scene["map"]["url"], timeout=PATIENCE_S) as picture:
            assert picture.read(8).startswith(b"\x89PNG")
        game.begin_round()
        assert page.ask("stop")["ok"]
        game.wait_for(lambda: game.stopped, "the stop")
    killed = {name: pid_of(name) for name in (PAGE, GAME)}
    for name, pid in killed.items():
        assert pid is not None, name
        os.kill(pid, signal.SIGKILL)
    for name, pid in killed.items():
        game.wait_for(lambda name=name: terminal.shows(rf"^{name} was killed \(SIGKILL\)"), f"the death of {name}")  # type: ignore[misc]
        game.wait_for(lambda name=name, pid=pid: pid_of(name) not in (None, pid), f"{name} to be started again")  # type: ignore[misc]
    game.wait_for(there, "the page to be back")
    game.probe.answered_by("/robot_15/pacman_game", anew=True)
    assert game.stopped
    with Page(link) as page:
        while not (page.frames and decode(page.frames[-1][1]).stopped):
            page.read()
        assert page.ask("release")["ok"]
    game.wait_for(lambda: not game.stopped, "the release")


def test_readiness_list_of_page_is_that_of_doctor(game: Game) -> None:
    game.in_menu()
    wanted = ("domain", "base", "map", "pose", "Nav2", "game's nodes", "configuration", "STOP")
    with Page(game.link) as page:

        def ready() -> bool:
            """A look has its limits of time: on a busy machine another one may be needed."""
            rows = {row["name"]: row for row in page.ask("ready")["data"]}
            assert all(row["remedy"] for row in rows.values() if row["state"] == "bad")
            return all(rows[name]["state"] == "ok" for name in wanted)

        game.wait_for(ready, "all to be well")


@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGSTOP], ids=lambda number: number.name)
@pytest.mark.parametrize("name", [WATCHER, SIMULATOR, GAME])
def test_game_continues_after_loss_of_process(game: Game, name: str, number: int) -> None:
    game.in_menu()
    game.begin_round()
    pid, probe = pid_of(name), game.probe
    assert pid is not None
    before = {one: pid_of(one) for one in (WATCHER, SIMULATOR, GAME)}
    probe.clear(topics.PROCESSES)
    os.kill(pid, number)
    game.wait_for(lambda: probe.on(topics.PROCESSES), "the event")
    assert json.loads(probe.values(topics.PROCESSES)[0])["event"].startswith(f"{name} ")
    game.wait_for(lambda: pid_of(name) not in (None, pid), "another process")
    since = len(game.terminal.lines)
    game.wait_for(lambda: game.terminal.shows(r"^running +round \d+ .*nearest", since), "the round")
    assert {one: pid_of(one) for one in before if one != name} == {one: before[one] for one in before if one != name}


def test_doctor_finds_whole_game_ready(game: Game, domain: int) -> None:
    game.in_menu()
    texts = [""]

    def ready() -> bool:
        """On a busy machine a transform can be late: then another look is needed."""
        out = io.StringIO()
        with mock.patch.dict(os.environ):
            status = doctor("robot_15", domain, "house", sim=True, wait_s=PATIENCE_S, out=out)
        texts.append(out.getvalue())
        return status == 0

    game.wait_for(ready, "all to be well")
    text = texts[-1]
    marks = {line[4:20].strip(): line[:4].strip() for line in text.splitlines()[1:-1] if line[:4].strip()}
    assert {check for check, mark in marks.items() if mark != OK} - {"game", "clyde_trail"} == {
        *("dock", "battery", "Nav2's nodes")
    }, text
    assert "all 5 are there" in text
    assert "0.0 % differ from house" in text
    assert "menu, policy nearest" in text
    assert max(len(line) for line in text.splitlines()) <= COLUMNS


def test_second_game_is_refused_by_nodes_of_first(game: Game, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pacman_env.ros.supervisor.up.GOING_S", 0.5)  # nobody stops the first
    game.in_menu()

    def refused_by_audio_node() -> re.Match[str] | None:
        second = ask("up", "--map", "house", "--policy", "nearest")
        assert second.status == 2
        return re.search(r"a game is in /robot_15 already: audio_node \(process \d+ on \S+, since ", second.err)

    # On a busy machine the second game may end before it has heard every node of the first.
    game.wait_for(refused_by_audio_node, "the refusal")
    third = ask("up", "--map", "house", "--policy", "nearest", "--namespace", "robot_16")
    assert third.status == 2
    # By discovery, or by the lock of the first if a busy machine discovers it late.
    assert re.search(r"another clock runs in this ROS domain: (/robot_15/sim_robot|another ros up)", third.err)
    assert game.terminal.process.poll() is None
