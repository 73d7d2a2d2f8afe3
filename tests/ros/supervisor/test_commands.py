"""Commands of an operator without another game: rounds by themselves, interrupts at the start, lines."""

import io
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from pacman_env.ros.supervisor import terminal as terminal_module
from pacman_env.ros.supervisor.terminal import LineWriter, fitted
from tests.map_parts import part_of_map
from tests.ros.supervisor.terminal import PATIENCE_S, Terminal
from tests.ros.system import Probe

COMMAND = [sys.executable, "-m", "pacman_env.cli.main", "ros"]
QUICK = ("--set", "show.start_s=0", "--set", "clyde.speed_mps=0")


@pytest.mark.parametrize("most", [["--rounds", "2"], pytest.param(["--play-on"], marks=pytest.mark.daily)])
def test_simulated_game_plays_round_after_round(domain: int, tmp_path: Path, most: list[str]) -> None:
    ground = str(part_of_map("loop", 3.0).save(tmp_path / "ground.yaml"))
    words = ["--map", ground, "--policy", "nearest", "--sim", "--speed", "10", *most, *QUICK]
    terminal = Terminal([*COMMAND, "up", *words, "--logs", str(tmp_path / "logs")])
    if "--play-on" in most:
        terminal.wait_for(lambda: terminal.shows(r"running +round 3"), "three rounds")
        terminal.process.send_signal(signal.SIGINT)
    assert terminal.end() == 0
    assert terminal.shows(r"(Complete|Death) - Score: \d+")
    assert terminal.shows("2 rounds played: ") == ("--rounds" in most)
    assert terminal.too_long == []


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
    "joining": ("std_msgs.std_msgs_s__rosidl_typesupport_c", "reached"),
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


@pytest.mark.parametrize(
    ("width", "line"), [(30, "state  score 1  pellets 2/3"), (14, "state  score 1"), (4, "sta…"), (12, "state")]
)
def test_line_leaves_out_what_does_not_fit(width: int, line: str) -> None:
    assert fitted(["state", "score 1", "pellets 2/3"], width) == line


class Screen(io.StringIO):
    """A terminal, as far as writing goes."""

    def isatty(self) -> bool:
        return True


def test_lines_overwrite_each_other_on_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(terminal_module, "LINE_S", 0.0)
    plain, screen = io.StringIO(), Screen()
    for writer in (LineWriter(plain), LineWriter(screen)):
        for number, state in enumerate(["menu", "menu", "running"]):
            writer.show(lambda with_age, number=number, state=state: f"{state} {number}" if with_age else state)
    LineWriter(plain).print("stopping")
    assert plain.getvalue() == "menu 0\nrunning 2\nstopping\n"
    assert screen.getvalue().count("\r") == 3
    assert "\n" not in screen.getvalue()


def test_lines_are_broken_between_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "40")
    screen, path = Screen(), f"/home/{'a' * 50}/log"
    LineWriter(screen).print(f"pose jumped 3.1 m and 4 degrees, which odometry does not explain; log {path}")
    lines = screen.getvalue().removeprefix("\r\x1b[K").splitlines()
    assert lines == ["pose jumped 3.1 m and 4 degrees, which", "  odometry does not explain; log", f"  {path}"]
    screen = Screen()
    LineWriter(screen).print(command := "ros2 launch nav2_bringup bringup_launch.py namespace:=robot_15", whole=True)
    assert screen.getvalue() == f"\r\x1b[K{command}\n"
