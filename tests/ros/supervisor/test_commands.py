"""Commands of an operator without another game: rounds by themselves, interrupts at the start, bad domains, lines."""

from __future__ import annotations

import io
import re
import signal
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from pacman_env.cli import main as cli
from pacman_env.ros.supervisor.terminal import LineWriter, fitted
from tests.map_parts import part_of_map
from tests.ros.supervisor.terminal import PATIENCE_S, Terminal
from tests.ros.system import Probe

COMMAND = [sys.executable, "-m", "pacman_env.cli.main", "ros"]
SHOWS = ("--set", "show.start_s=1.0", "--set", "show.death_s=1.0")


def rounds_of(lines: list[str]) -> int:
    """How many rounds were begun from the menu."""
    states = [line.split()[0] for line in lines if re.match(r"\w+ +round ", line)]
    return sum(before == "menu" != after for before, after in pairwise(states))


@pytest.mark.daily
def test_simulated_game_plays_round_after_round(domain: int, tmp_path: Path) -> None:
    ground = str(part_of_map("loop", 3.0).save(tmp_path / "ground.yaml"))
    words = ["--map", ground, "--policy", "nearest", "--sim", "--lock-step", "--play-on", *SHOWS]
    terminal = Terminal([*COMMAND, "up", *words, "--set", "clyde.speed_mps=0.01", "--logs", str(tmp_path / "logs")])
    try:
        terminal.wait_for(lambda: rounds_of(terminal.lines) >= 3, "three rounds")
        assert terminal.shows(r"(Complete|Death) - Score: \d+")
        assert terminal.too_long == []
    finally:
        terminal.process.send_signal(signal.SIGINT)
        assert terminal.end() == 0


#: Prints when the command begins, when a module is first looked for, and when the command's own participant is there.
BEGUN = """
import sys
from pacman_env.cli.main import main

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == AWAITED:
            print("reached", flush=True)

AWAITED = sys.argv.pop(1)
sys.meta_path.insert(0, Finder())
try:
    print("begun", flush=True)
    sys.exit(main(sys.argv[1:]))
except KeyboardInterrupt as interrupt:
    if interrupt.__traceback__.tb_next is not None:  # else the command has not begun
        raise
"""
#: What is printed before the interrupt comes: the command has begun; ROS is being imported; the participant is being
#: made, which loads the libraries of its messages; the game is waited for.
MOMENTS = {
    "begun": ("", "begun"),
    "importing ROS": ("rclpy", "reached"),
    "joining": ("geometry_msgs.geometry_msgs_s__rosidl_typesupport_c", "reached"),
    "going on": ("", ""),
}


UP = ["up", "--map", "house", "--sim"]


@pytest.mark.parametrize(
    ("words", "moment"), [(UP, "begun"), (["status"], "importing ROS"), (UP, "joining"), (["status"], "going on")]
)
def test_ctrl_c_at_start_shows_no_traceback(probe: Probe, tmp_path: Path, words: list[str], moment: str) -> None:
    awaited, line = MOMENTS[moment]
    logs = ["--logs", str(tmp_path)] if words[0] == "up" else []
    command = [sys.executable, "-c", BEGUN, awaited, "ros", *words, *logs]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True) as process:
        assert process.stdout is not None
        if (words[0], moment) == ("status", "going on"):
            probe.wait_for(lambda: "pacman_up" in probe.node.get_node_names(), PATIENCE_S, "the command's participant")
        else:
            shown = []
            while not shown[-1:] or not shown[-1].startswith(line):
                shown.append(process.stdout.readline())
                assert shown[-1], f"ended before {line!r}: {shown}"
        process.send_signal(signal.SIGINT)
        try:
            out, _ = process.communicate(timeout=PATIENCE_S)
        finally:
            process.kill()
    assert "Traceback" not in out
    assert process.returncode in (0, 3, 130, -signal.SIGINT)


@pytest.mark.parametrize("text", ["abc"])
@pytest.mark.parametrize("words", [["up", "--map", "house"], ["start"], ["status"], ["record", "--out", "OUT"]])
def test_invalid_domain_is_refused_in_one_line(
    words: list[str],
    text: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = [str(tmp_path / "bag") if word == "OUT" else word for word in words]
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    assert cli.main(["ros", *words]) == 2
    assert capsys.readouterr() == (
        "",
        f"pacman-env ros {words[0]}: ROS_DOMAIN_ID {text!r}: must be a whole number, 0 to 232\n",
    )


@pytest.mark.parametrize(
    ("width", "line"), [(30, "state  score 1  pellets 2/3"), (14, "state  score 1"), (4, "sta…"), (12, "state")]
)
def test_line_leaves_out_what_does_not_fit(width: int, line: str) -> None:
    assert fitted(["state", "score 1", "pellets 2/3"], width) == line


class Screen(io.StringIO):
    """A terminal, as far as writing goes."""

    def isatty(self) -> bool:
        return True


def test_lines_are_broken_between_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    screen, path = Screen(), f"/home/{'a' * 50}/log"
    LineWriter(screen).print(f"pose jumped 3.1 m and 4 degrees, which odometry does not explain; log {path}")
    lines = screen.getvalue().removeprefix("\r\x1b[K").splitlines()
    assert lines == ["pose jumped 3.1 m and 4 degrees, which", "  odometry does not explain; log", f"  {path}"]
    screen = Screen()
    LineWriter(screen).print(command := "ros2 launch nav2_bringup bringup_launch.py namespace:=robot_15", whole=True)
    assert screen.getvalue() == f"\r\x1b[K{command}\n"
