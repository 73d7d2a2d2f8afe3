"""A real Nav2 beside the simulated base: the command of others that `ros up` starts, watches and stops.

Nav2 itself is not installed here: a small process takes its place, which notes what it was given and how it ended.
"""

import json
import os
import shlex
import signal
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from pacman_env.ros.game_nodes import NAV2_BRINGUP, GameSetup
from pacman_env.ros.supervisor import nav2
from pacman_env.world.maps.occupancy import load_map

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
    return {int(path.stem): json.loads(path.read_text() or "{}") for path in (folder / "notes").glob("*.json")}


def test_nav2_is_started_again_and_ends_with_killed_command(
    system: Any, probe: Any, tmp_path: Path, noting: str
) -> None:
    words = [*COMMAND, "--sim", "--nav2", f"{noting} {{namespace}} {{map}} {{params}}"]
    up = system.run("up", [*words, "--logs", str(tmp_path / "logs")])
    probe.wait_for(lambda: notes(tmp_path), PATIENCE_S, "the process in Nav2's place")
    ((first, noted),) = notes(tmp_path).items()
    namespace, map_yaml, params = noted["arguments"]
    assert namespace == "robot_15"
    assert load_map(map_yaml).hash == load_map("house").hash
    given = yaml.safe_load(Path(params).read_text())
    assert {"amcl", "bt_navigator", "local_costmap", "planner_server"} <= given.keys()
    probe.wait_for(lambda: "waiting for the pose, from AMCL" in up.output, PATIENCE_S, "the wait for a pose")
    os.kill(first, signal.SIGKILL)
    probe.wait_for(lambda: len(notes(tmp_path)) == 2, PATIENCE_S, "a new one")
    assert "nav2 ended with status 137" in up.output
    up.popen.kill()
    up.popen.wait()
    system.processes.clear()
    (second,) = notes(tmp_path).keys() - {first}
    probe.wait_for(lambda: notes(tmp_path)[second].get("ended"), PATIENCE_S, "its end")
    assert notes(tmp_path)[second]["ended"] == signal.SIGINT


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
        ({"nav2": "no-such-command", "sim": True}, "the command no-such-command is not found"),
        ({"nav2": "ls {colour}", "sim": True}, "no command"),
        ({"nav2": "ls 'half", "sim": True}, "no command"),
        ({"nav2": " ", "sim": True}, "no command"),
    ],
)
def test_invalid_nav2_is_refused_with_reason(given: dict[str, Any], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        nav2.check(GameSetup("house", **given))
