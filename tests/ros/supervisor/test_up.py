"""The command that runs a whole game: with a simulated robot, from the first process to the last."""

from __future__ import annotations

import io
import json
import os
import re
import signal
import sys
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("irobot_create_msgs")

from pacman_env import ros
from pacman_env.cli import main as cli
from pacman_env.ros import topics
from pacman_env.ros.supervisor import up as up_module
from pacman_env.ros.supervisor.game_nodes import GAME, SELECTOR, SIMULATOR, STOP_ORDER, GameSetup, module_of
from pacman_env.ros.supervisor.up import MEANINGS, NODE_LOST, LineWriter, environment

COMMAND = [sys.executable, "-m", "pacman_env.cli.main", "ros"]
PATIENCE_S = 240.0  # the first nodes may have to compile


def bring_up(system: Any, tmp_path: Path, *options: str) -> Any:
    command = [*COMMAND, "up", "--map", "house", "--sim", "--speed", "5"]
    return system.run("up", [*command, "--logs", str(tmp_path / "logs"), *options])


def pid_of(name: str) -> int | None:
    """The process of a node in this test's domain, found by its command line."""
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            try:
                words = (folder / "cmdline").read_bytes().split(b"\0")
                domain = f"ROS_DOMAIN_ID={os.environ['ROS_DOMAIN_ID']}".encode()
                if module_of(name).encode() in words and domain in (folder / "environ").read_bytes():
                    return int(folder.name)
            except OSError:
                continue  # it has just ended, or is another user's
    return None


@pytest.mark.skipif(sys.platform != "linux", reason="looks for processes in /proc")
def test_a_game_is_brought_up_recorded_kept_up_ended_in_order_and_replayed(
    system: Any, probe: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = tmp_path / "game"
    recorder = system.run("record", [*COMMAND, "record", "--out", str(bag), "--sim"])
    up = bring_up(system, tmp_path, "--policy", "nearest", "--start")
    probe.record(topics.GAME_STATE, topics.GAME_STATUS, topics.LIGHT_RING, topics.CMD_VEL)
    probe.wait_for(
        lambda: any(word.startswith("pellet_collected") for word in probe.values(topics.GAME_STATUS)),
        PATIENCE_S,
        "a pellet",
    )
    lights = pid_of("game_light_node")
    assert lights is not None
    os.kill(lights, signal.SIGKILL)
    probe.wait_for(lambda: "game_light_node ended with status -9" in up.output, what="its death is seen")
    probe.wait_for(lambda: pid_of("game_light_node"), what="it is started again")
    probe.wait_for(lambda: "game_light_node" in probe.node.get_node_names(), what="it is there again")
    assert recorder.stop() == 0, recorder.output
    probe.forget()
    up.send(signal.SIGINT)
    probe.wait_for(lambda: up.popen.poll() is not None, PATIENCE_S, "the end")
    assert up.wait() == 0, up.output
    assert not probe.messages(topics.LIGHT_RING)[-1].override_system  # the ring is the base's own again
    last = probe.messages(topics.CMD_VEL)[-1].twist
    assert (last.linear.x, last.angular.z) == (0.0, 0.0)
    assert re.search(r"^running +round 1 +score \d+ +pellets \d+/13 +pose [\d.]+ s ago +nearest", up.output, re.M)
    for name in (SIMULATOR, *GAME, SELECTOR):
        assert pid_of(name) is None, name

    assert cli.main(["ros", "replay", str(bag), "--map", "house", "--policy", "nearest", "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["statuses"]["pellet_collected"] >= 1
    assert report["same"] >= 0.8 * report["decisions"] > 3  # the same policy, with what its robot knew
    assert report["robot"]["speed"][1] < 0.31


def test_what_moves_the_robot_stops_first_then_the_lights() -> None:
    assert STOP_ORDER[:3] == (SELECTOR, "game_event_mapper", "game_light_node")


def test_a_node_that_cannot_be_kept_alive_ends_the_game_with_its_reason(system: Any, tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / "sitecustomize.py").write_text(
        "import sys\nif any(word.endswith('audio_node') for word in sys.orig_argv): sys.exit('no ears')\n"
    )
    code = (
        "import sys; from pacman_env.ros.supervisor import processes; processes.SLOW_START_S = 0.0; "
        "from pacman_env.cli.main import main; sys.exit(main(sys.argv[1:]))"
    )
    words = ["ros", "up", "--map", "house", "--policy", "nearest", "--sim", "--logs", str(tmp_path / "logs")]
    environment = f"PYTHONPATH={broken}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"
    up = system.run("up", ["env", environment, sys.executable, "-c", code, *words])
    assert up.wait(PATIENCE_S) == NODE_LOST, up.output
    assert "audio_node died 5 times within 60 s" in up.output
    system.processes.clear()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--map", "nowhere"], "nowhere: neither a YAML file"),
        (["--map", "house", "--policy", "brave"], "unknown policy 'brave'"),
        (["--map", "house", "--namespace", "15"], "namespace '15'"),
        (["--map", "house", "--speed", "2"], "only a simulated robot"),
        (["--map", "house", "--sim", "--speed", "11"], "speed 11: must be 1 to 10"),
        (["--map", "house", "--play-on"], "only with --sim"),
        (["--map", "house", "--preset", "lunar"], "unknown preset 'lunar'"),
        (["--map", "house", "--set", "clyde.speed_mps=fast"], "clyde.speed_mps = 'fast': must be a finite number"),
        (["--map", "house", "--set", "clyde.sped=1"], "unknown configuration field 'clyde.sped'"),
    ],
)
def test_what_cannot_be_played_is_one_line_before_anything_starts(
    capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:
    assert cli.main(["ros", "up", *arguments]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert words in err
    assert err.count("\n") == 1


def test_a_home_is_three_finite_numbers() -> None:
    assert GameSetup("house", home=(1.0, 2.0, 0.5)).parameters(SELECTOR)["home"] == [1.0, 2.0, 0.5]
    with pytest.raises(ValueError, match="home"):
        GameSetup("house", home=(1.0, 2.0, float("inf")))


def test_without_ros_the_command_says_what_to_install(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(ros, "supervisor", ros.supervisor)  # is put back: the command imports another one
    for name in [name for name in sys.modules if name.startswith("pacman_env.ros.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "rclpy", None)  # as if it were not there
    assert cli.main(["ros", "up", "--map", "house"]) == 2
    err = capsys.readouterr().err
    assert err.count("\n") == 1
    assert "/opt/ros/jazzy/setup.bash" in err
    assert "pacman_env[ros]" in err


def test_a_simulated_game_stays_on_this_machine() -> None:
    assert environment(GameSetup("house", sim=True), 7)["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
    assert "ROS_AUTOMATIC_DISCOVERY_RANGE" not in environment(GameSetup("house"), None)
    assert environment(GameSetup("house"), 7)["ROS_DOMAIN_ID"] == "7"


def test_lines_are_written_when_something_changes_and_over_one_another_on_a_terminal(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(up_module, "LINE_S", 0.0)
    plain = io.StringIO()
    writer = LineWriter(plain)
    for number, state in enumerate(["menu", "menu", "running"]):
        writer.show(lambda with_age, number=number, state=state: f"{state} {number}" if with_age else state)
    writer.say("stopping")
    assert plain.getvalue() == "menu 0\nrunning 2\nstopping\n"

    class Terminal(io.StringIO):
        def isatty(self) -> bool:
            return True

    terminal = Terminal()
    writer = LineWriter(terminal)
    for number in range(3):
        writer.show(lambda with_age, number=number: f"menu {number}")
    assert terminal.getvalue().count("\r") == 3
    assert "\n" not in terminal.getvalue()


def test_every_exit_status_has_a_meaning() -> None:
    assert sorted(MEANINGS) == [0, 2, 3, 4, 5]
