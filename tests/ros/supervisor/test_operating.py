"""What an operator does: watch a game on a terminal of 80 columns, press keys, ask from another terminal, stop."""

from __future__ import annotations

import fcntl
import json
import os
import pty
import re
import signal
import socket
import struct
import subprocess
import sys
import termios
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from eval.campaign.schedule import part_of_map
from pacman_env.ros.supervisor.status_line import fitted

COMMAND = [sys.executable, "-m", "pacman_env.cli.main", "ros"]
COLUMNS = 80
PATIENCE_S = 300.0  # the first nodes may have to compile


class Terminal:
    """A command on a terminal of its own: what it shows, line after line, and keys."""

    def __init__(self, command: list[str]) -> None:
        self._master, slave = pty.openpty()
        fcntl.ioctl(slave, termios.TIOCSWINSZ, struct.pack("HHHH", 24, COLUMNS, 0, 0))
        environment = {name: value for name, value in os.environ.items() if name not in ("COLUMNS", "LINES")}
        self.process = subprocess.Popen(
            command,
            env=environment,
            stdin=slave,
            stdout=slave,
            stderr=slave,
            start_new_session=True,
            preexec_fn=lambda: fcntl.ioctl(0, termios.TIOCSCTTY, 0),  # as a shell does it
        )
        os.close(slave)
        self._shown = b""
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def _read(self) -> None:
        try:
            while block := os.read(self._master, 65536):
                self._shown += block
        except OSError:
            pass  # the other end is closed

    @property
    def lines(self) -> list[str]:
        """Everything shown, also what was written over."""
        return [line for line in re.split(r"\r\n|\r\x1b\[K|\n|\r", self._shown.decode()) if line.strip()]

    @property
    def too_long(self) -> list[str]:
        """Lines that do not fit, but for the one with the logs' path."""
        return [line for line in self.lines if len(line) >= COLUMNS and not line.startswith("logs in")]

    def press(self, key: str) -> None:
        os.write(self._master, key.encode())

    def wait_for(self, condition: Callable[[], bool], what: str) -> None:
        end = time.monotonic() + PATIENCE_S
        while not condition():
            shown = "\n".join(self.lines[-20:])
            assert self.process.poll() is None, f"ended while waiting for {what}:\n{shown}"
            assert time.monotonic() < end, f"waited for {what}:\n{shown}"
            time.sleep(0.05)

    def shows(self, pattern: str, since: int = 0) -> bool:
        return any(re.search(pattern, line) for line in self.lines[since:])

    def end(self) -> int:
        status = self.process.wait(PATIENCE_S)
        self._reader.join(5.0)
        return status


def ask(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*COMMAND, *words, "--sim"], check=False, capture_output=True, text=True, timeout=PATIENCE_S)


@pytest.fixture(scope="module")
def game(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Terminal]:
    logs = tmp_path_factory.mktemp("up") / "logs"
    words = ["--map", "house", "--policy", "nearest", "--sim", "--speed", "5", "--home", "0.5", "0", "1.5"]
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        port = one.getsockname()[1]
    terminal = Terminal([*COMMAND, "up", *words, "--web", str(port), "--logs", str(logs)])
    try:
        yield terminal
    finally:
        if terminal.process.poll() is None:
            terminal.process.send_signal(signal.SIGINT)
            terminal.process.wait(PATIENCE_S)


def test_the_line_says_what_is_awaited_and_fits_the_terminal(game: Terminal) -> None:
    game.wait_for(lambda: game.shows(r"^menu "), "the menu")
    assert game.shows(r"^starting: waiting for .*pellet_manager")
    assert game.shows(r"^starting: waiting for goal_selector")
    assert game.shows(r"^game on /robot_15; keys: s start, r reset, space stop, g go on, q quit$")
    assert game.too_long == []


def test_keys_start_and_reset_a_game_and_what_is_refused_is_said(game: Terminal) -> None:
    game.wait_for(lambda: game.shows(r"^menu "), "the menu")
    game.press("s")
    game.wait_for(lambda: game.shows(r"^(starting|running) +round 1"), "the round")
    since = len(game.lines)
    game.press("s")
    game.wait_for(lambda: game.shows(r"game/start: start: the game is in state", since), "the refusal")
    game.press("r")
    game.wait_for(lambda: game.shows(r"^menu ", since), "the menu again")


def test_another_terminal_starts_and_resets_the_game_and_says_how_it_stands(game: Terminal) -> None:
    game.wait_for(lambda: game.shows(r"^menu "), "the menu")
    ask("reset")
    started = ask("start")
    assert (started.returncode, started.stderr) == (0, "")
    assert "the game is in state 'returning_home'" in started.stdout
    again = ask("start")
    assert again.returncode == 1
    assert "start: the game is in state" in again.stdout
    text = ask("status")
    assert text.returncode == 0
    assert re.search(r"^policy +nearest$", text.stdout, re.MULTILINE)
    facts = json.loads(ask("status", "--json").stdout)
    assert facts["namespace"] == "/robot_15"
    assert facts["goal_selector"]["home"] == [0.5, 0.0, 1.5]
    assert {"game_controller", "goal_selector", "sim_robot"} <= set(facts["nodes"])
    assert ask("reset").returncode == 0


def test_the_space_bar_stops_the_robot_until_g_and_so_does_another_terminal(game: Terminal) -> None:
    game.wait_for(lambda: game.shows(r"^menu "), "the menu")
    game.press("s")
    game.wait_for(lambda: game.shows(r"^(starting|running) +round 1"), "the round")
    since = len(game.lines)
    game.press(" ")
    game.wait_for(lambda: game.shows(r"^\w+ +round 1.*STOPPED", since), "the stop")
    assert "until 'pacman-env ros release'" in ask("status").stdout
    since = len(game.lines)
    game.press("g")
    game.wait_for(lambda: game.shows(r"^released$", since), "the release")
    obeying = ("game_controller", "game_event_mapper", "goal_selector", "pacman_page")

    def all_obey() -> bool:
        """It names those who have answered by then: on a busy machine not all at once."""
        stopped = ask("stop")
        assert (stopped.returncode, stopped.stderr) == (0, "")
        return all(name in stopped.stdout for name in obeying)

    def stands() -> bool:
        return bool(json.loads(ask("status", "--json").stdout)["goal_selector"]["stopped"])

    game.wait_for(all_obey, "all to obey")
    game.wait_for(stands, "the goal selector to say so")
    released = ask("release")
    assert released.returncode == 0
    assert released.stdout.startswith("released: ")
    game.wait_for(lambda: not stands(), "the goal selector to go on")
    assert ask("release").stdout == "nothing was stopped\n"
    assert ask("reset").returncode == 0


def test_the_page_is_there_and_comes_back_when_it_was_killed(game: Terminal) -> None:
    game.wait_for(lambda: game.shows(r"^page: http://127\.0\.0\.1:\d+/ on this computer$"), "the page's address")
    (line,) = {line for line in game.lines if line.startswith("page: ")}
    link = line.split()[1]

    def there() -> bool:
        try:
            with urllib.request.urlopen(f"{link}health", timeout=5) as answer:
                return bool(json.load(answer)["ok"])
        except OSError:
            return False

    game.wait_for(there, "the page")
    os.kill(pid_of("operator_page", game), signal.SIGKILL)
    game.wait_for(lambda: game.shows(r"^operator_page ended with status -9"), "its death")
    game.wait_for(there, "the page to be back")


def test_a_second_game_in_the_namespace_is_refused_by_the_names_of_the_first(game: Terminal) -> None:
    game.wait_for(lambda: game.shows(r"^menu "), "the menu")
    second = ask("up", "--map", "house", "--policy", "nearest")
    assert second.returncode == 2
    assert "a game is in /robot_15 already: " in second.stderr
    assert f"game_controller (process {pid_of('game_controller', game)} on " in second.stderr
    third = ask("up", "--map", "house", "--policy", "nearest", "--namespace", "robot_16")
    assert third.returncode == 2
    assert "another clock runs in this ROS domain: /robot_15/sim_robot (/clock)" in third.stderr
    assert game.process.poll() is None


def pid_of(node: str, game: Terminal) -> int:
    """The process of a node of this game."""
    children = subprocess.check_output(["ps", "-ww", "-o", "pid=,args=", "--ppid", str(game.process.pid)], text=True)
    (line,) = [line for line in children.splitlines() if f".{node} " in line]
    return int(line.split()[0])


def test_the_key_q_stops_everything_and_says_what_is_being_stopped(game: Terminal) -> None:
    game.wait_for(lambda: game.shows(r"^menu "), "the menu")
    game.press("q")
    assert game.end() == 0
    assert game.shows(r"^stopping goal_selector, then \d+ more")
    stopped = [line.split()[1].rstrip(",") for line in game.lines if line.startswith("stopping ") and "_" in line]
    assert stopped[:3] == ["goal_selector", "game_event_mapper", "game_light_node"]
    assert {"operator_page", "sim_robot"} <= set(stopped)
    assert game.lines[-1] == "stopped"
    nobody = ask("status", "--wait", "1")
    assert nobody.returncode == 3
    assert nobody.stderr.count("\n") == 1
    assert "no game in /robot_15" in nobody.stderr


BEGUN = """
import sys
from pacman_env.cli.main import main
try:
    print("begun", flush=True)
    sys.exit(main(sys.argv[1:]))
except KeyboardInterrupt as interrupt:
    if interrupt.__traceback__.tb_next is not None:  # else the command has not begun
        raise
"""


def test_a_simulated_game_plays_round_after_round_where_it_is_asked_to(domain: int, tmp_path: Path) -> None:
    ground = str(part_of_map("loop", 3.0).save(tmp_path / "ground.yaml"))
    words = ["--map", ground, "--policy", "nearest", "--sim", "--speed", "10", "--play-on"]
    terminal = Terminal([*COMMAND, "up", *words, "--set", "clyde.speed_mps=0.01", "--logs", str(tmp_path / "logs")])
    try:
        for number in (1, 2, 3):
            terminal.wait_for(lambda n=number: terminal.shows(rf"^running +round {n}"), f"round {number}")  # type: ignore[misc]
        assert terminal.shows(r"Complete - Score: 3")
        assert terminal.too_long == []
    finally:
        terminal.process.send_signal(signal.SIGINT)
        assert terminal.end() == 0


@pytest.mark.parametrize("after_s", [0.0, 0.3, 1.0, 3.0])
@pytest.mark.parametrize("words", [["up", "--map", "house", "--sim"], ["status"]], ids=lambda words: words[0])
def test_ctrl_c_in_the_first_seconds_is_no_traceback(
    domain: int, tmp_path: Path, words: list[str], after_s: float
) -> None:
    logs = ["--logs", str(tmp_path)] if words[0] == "up" else []
    command = [sys.executable, "-c", BEGUN, "ros", *words, *logs]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == "begun\n"  # before, it is Python's start
        time.sleep(after_s)
        process.send_signal(signal.SIGINT)
        try:
            out, _ = process.communicate(timeout=PATIENCE_S)
        finally:
            process.kill()
    assert "Traceback" not in out
    assert process.returncode in (0, 3, 130, -signal.SIGINT)


@pytest.mark.parametrize("text", ["abc", "500"])
@pytest.mark.parametrize("words", [["up", "--map", "house"], ["start"], ["status"], ["record", "--out", "OUT"]])
def test_a_bad_domain_is_one_line(words: list[str], text: str, tmp_path: Path) -> None:
    words = [str(tmp_path / "bag") if word == "OUT" else word for word in words]
    environment = {**os.environ, "ROS_DOMAIN_ID": text}
    done = subprocess.run(
        [*COMMAND, *words], check=False, capture_output=True, text=True, env=environment, timeout=PATIENCE_S
    )
    assert done.returncode == 2
    assert done.stderr == f"pacman-env: ROS_DOMAIN_ID {text!r}: must be a whole number, 0 to 232\n"
    assert done.stdout == ""


@pytest.mark.parametrize(
    ("width", "line"), [(30, "state  score 1  pellets 2/3"), (14, "state  score 1"), (4, "sta…"), (12, "state")]
)
def test_a_line_leaves_out_what_does_not_fit(width: int, line: str) -> None:
    assert fitted(["state", "score 1", "pellets 2/3"], width) == line
