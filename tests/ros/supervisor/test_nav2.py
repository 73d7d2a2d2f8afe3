"""A real Nav2 beside the simulated base: the command of others that `ros up` starts, watches and stops.

Nav2 itself is not installed here: a small process takes its place, which notes what it was given and how it ended.
"""

from __future__ import annotations

import json
import os
import shlex
import signal
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from pacman_env.cli import main as cli
from pacman_env.ros.supervisor import nav2
from pacman_env.ros.supervisor.game_nodes import NAV2_BRINGUP, NAV2_BY_HAND, GameSetup
from pacman_env.world.maps.occupancy import load_map
from tests.map_parts import part_of_map

ROOT = Path(__file__).resolve().parents[3]
PATIENCE_S = 240.0
COMMAND = [sys.executable, "-m", "pacman_env.cli.main", "ros", "up", "--map", "house", "--policy", "nearest"]
NOTING = """
import json, os, signal, sys, time
from pathlib import Path
folder = Path(sys.argv[1])
notes = folder / f"{os.getpid()}.json"
def end(number, frame):
    notes.write_text(json.dumps({"arguments": sys.argv[2:], "ended": number}))
    sys.exit(0)
signal.signal(signal.SIGINT, end)
signal.signal(signal.SIGTERM, end)
notes.write_text(json.dumps({"arguments": sys.argv[2:], "ended": None}))  # who reads this may end it
while True:
    time.sleep(1)
"""


@pytest.fixture
def noting(tmp_path: Path) -> str:
    """The command of the process in Nav2's place; ``notes`` reads what it has noted."""
    script = tmp_path / "noting.py"
    script.write_text(NOTING)
    (tmp_path / "notes").mkdir()
    return shlex.join([sys.executable, str(script), str(tmp_path / "notes")])


def notes(folder: Path) -> dict[int, dict[str, Any]]:
    """By process."""
    return {int(path.stem): json.loads(path.read_text() or "{}") for path in (folder / "notes").glob("*.json")}


@pytest.mark.daily
def test_nav2_is_started_restarted_and_stopped(system: Any, probe: Any, tmp_path: Path, noting: str) -> None:
    logs = tmp_path / "logs"
    words = [*COMMAND, "--sim", "--nav2", f"{noting} {{namespace}} {{map}} {{params}}", "--logs", str(logs)]
    up = system.run("up", words)
    probe.wait_for(lambda: notes(tmp_path), PATIENCE_S, "the process in Nav2's place")
    ((first, noted),) = notes(tmp_path).items()
    namespace, map_yaml, params = noted["arguments"]
    assert namespace == "robot_15"
    assert load_map(map_yaml).hash == load_map("house").hash
    given = yaml.safe_load(Path(params).read_text())
    assert {"amcl", "bt_navigator", "local_costmap", "planner_server"} <= given.keys()
    probe.wait_for(lambda: "waiting for the pose, from AMCL" in up.output, PATIENCE_S, "the wait for a pose")
    assert "-p navigation:=false -p localization:=false -p map_out:=false" in _command_line(up.popen.pid, "sim_robot")
    os.kill(first, signal.SIGKILL)
    probe.wait_for(lambda: len(notes(tmp_path)) == 2, PATIENCE_S, "a new one")
    assert "nav2 ended with status 137" in up.output
    assert up.popen.poll() is None
    up.send(signal.SIGINT)
    assert up.wait() == 0, up.output
    (second,) = notes(tmp_path).keys() - {first}
    assert notes(tmp_path)[second]["ended"] == signal.SIGINT
    assert not Path(f"/proc/{second}").exists()


def _command_line(parent: int, node: str) -> str:
    """Of a node that this process has started."""
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit() and (folder / "stat").exists():
            words = (folder / "cmdline").read_text().replace("\0", " ")
            if str(parent) in words.split() and f".{node} " in words:
                return words
    return ""


def test_killed_command_leaves_no_nav2_behind(system: Any, probe: Any, tmp_path: Path, noting: str) -> None:
    up = system.run("up", [*COMMAND, "--sim", "--nav2", noting, "--logs", str(tmp_path / "logs")])
    probe.wait_for(lambda: notes(tmp_path), PATIENCE_S, "the process in Nav2's place")
    up.popen.kill()
    up.popen.wait()
    system.processes.clear()
    (process,) = notes(tmp_path)
    probe.wait_for(lambda: notes(tmp_path)[process].get("ended"), PATIENCE_S, "its end")
    assert notes(tmp_path)[process]["ended"] == signal.SIGINT


def test_stubborn_command_is_killed_with_its_children(system: Any, probe: Any, tmp_path: Path) -> None:
    stubborn = (
        "import signal, time; signal.signal(signal.SIGINT, signal.SIG_IGN); print('here', flush=True); time.sleep(600)"
    )
    script = f"{shlex.quote(sys.executable)} -c {shlex.quote(stubborn)} & wait; wait"
    wrapped = "from pacman_env.ros.supervisor import foreign; import sys; foreign.END_S = 0.5; sys.exit(foreign.main())"
    process = system.run("foreign", [sys.executable, "-c", wrapped, "bash", "-c", script])
    probe.wait_for(lambda: "here" in process.output, PATIENCE_S, "what it has started")
    group = [p for p in Path("/proc").iterdir() if p.name.isdigit() and stubborn in _words(p)]
    assert group
    process.send(signal.SIGTERM)
    assert process.wait() == 0
    assert not [p for p in group if stubborn in _words(p)]


def _words(process: Path) -> str:
    try:
        return (process / "cmdline").read_text()
    except OSError:
        return ""


def test_exit_status_is_that_of_foreign_command(system: Any) -> None:
    module = [sys.executable, "-m", "pacman_env.ros.supervisor.foreign"]
    assert system.run("foreign", [*module, "bash", "-c", "exit 7"]).wait() == 7
    assert system.run("foreign", [*module, "bash", "-c", "kill -9 $$"]).wait() == 137
    absent = system.run("foreign", [*module, "no-such-command"])
    assert absent.wait() == 2
    assert "no-such-command: No such file or directory" in absent.output
    system.processes.clear()


def test_missing_nav2_is_named_before_start(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    logs = tmp_path / "logs"
    words = ["ros", "up", "--map", "house", "--policy", "nearest", "--logs", str(logs), "--sim", "--nav2"]
    assert cli.main(words) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "ros2 and nav2_bringup not found" in line
    assert "sudo apt install ros-jazzy-navigation2 ros-jazzy-nav2-bringup" in line
    assert not logs.exists()


def test_nav2_launch_file_gets_its_arguments(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    index = tmp_path / "share" / "ament_index" / "resource_index" / "packages"
    index.mkdir(parents=True)
    (index / "nav2_bringup").touch()
    (tmp_path / "ros2").write_text("#!/bin/sh\n")
    (tmp_path / "ros2").chmod(0o755)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path))
    monkeypatch.setenv("PATH", str(tmp_path))
    setup = GameSetup("house", sim=True, nav2=NAV2_BRINGUP)
    nav2.check(setup)
    _, *words = nav2.command(setup, tmp_path)
    assert words == [
        *("ros2", "launch", "nav2_bringup", "bringup_launch.py", "namespace:=robot_15", "use_namespace:=True"),
        *(f"map:={ROOT / 'maps' / 'house.yaml'}", f"params_file:={tmp_path / 'nav2.yaml'}", "use_sim_time:=True"),
        "use_composition:=False",
    ]
    _, *words = nav2.command(GameSetup("house", namespace="/", sim=True, nav2=NAV2_BRINGUP), tmp_path)
    assert words[4:6] == ["namespace:=", "use_namespace:=False"]


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"nav2": NAV2_BRINGUP}, "only with a simulated robot"),
        ({"nav2": NAV2_BRINGUP, "sim": True, "lock_step": True}, "not in lock-step"),
        ({"nav2": "no-such-command", "sim": True}, "the command no-such-command is not found"),
        ({"nav2": "ls {colour}", "sim": True}, "no command"),
        ({"nav2": "ls 'half", "sim": True}, "no command"),
        ({"nav2": " ", "sim": True}, "no command"),
    ],
)
def test_invalid_nav2_is_refused_with_reason(given: dict[str, Any], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        nav2.check(GameSetup("house", **given))


@pytest.mark.daily
def test_nav2_started_by_hand_is_awaited(system: Any, probe: Any, tmp_path: Path) -> None:
    up = system.run("up", [*COMMAND, "--sim", "--nav2", NAV2_BY_HAND, "--logs", str(tmp_path / "logs")])
    probe.wait_for(lambda: "waiting for the pose, from AMCL" in up.output, PATIENCE_S, "the wait for a pose")
    assert "start Nav2: ros2 launch nav2_bringup bringup_launch.py namespace:=robot_15 use_namespace:=True" in up.output
    assert (tmp_path / "logs" / "nav2.yaml").is_file()
    up.send(signal.SIGINT)
    assert up.wait() == 0, up.output


def test_requested_round_is_played_and_command_ends(system: Any, tmp_path: Path) -> None:
    ground = str(part_of_map("loop", 3.0).save(tmp_path / "ground.yaml"))
    words = [ground if word == "house" else word for word in COMMAND]
    words += ["--sim", "--lock-step", "--seed", "3", "--logs", str(tmp_path / "logs"), "--rounds", "1"]
    up = system.run("up", [*words, "--set", "show.start_s=0", "--set", "clyde.speed_mps=0"])
    assert up.wait(PATIENCE_S) == 0, up.output
    assert "1 round played: " in up.output


def test_automatic_rounds_need_simulated_robot(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["ros", "up", "--map", "house", "--policy", "nearest", "--rounds", "1"]) == 2
    assert "--play-on, --rounds: only with --sim" in capsys.readouterr().err
