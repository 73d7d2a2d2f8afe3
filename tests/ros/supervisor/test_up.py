"""What the command that runs a whole game refuses, writes and returns; what it does is for ``test_operating.py``."""

import io
import os
import sys
from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from pacman_env import ros
from pacman_env.cli import main as cli
from pacman_env.files import install_command
from pacman_env.ros import topics
from pacman_env.ros.game_nodes import GAME, LISTENERS, ORIGINAL, OURS, SIMULATOR, GameSetup
from pacman_env.ros.process import StopSignals
from pacman_env.ros.supervisor import console
from pacman_env.ros.supervisor import up as up_module
from pacman_env.ros.supervisor.console import RoundRequests
from pacman_env.ros.supervisor.game_lock import GameLock
from pacman_env.ros.supervisor.status_line import StatusLine
from pacman_env.ros.supervisor.terminal import LineWriter
from pacman_env.ros.supervisor.up import NODE_LOST, UpOptions
from tests.ros import session

PATIENCE_S = 240.0  # the first nodes may have to compile
#: One node cannot be started; the others are processes that have begun, compute nothing beside it and end with their
#: parent.
BROKEN = """
import os, sys, time
if any(word.endswith("watcher") for word in sys.orig_argv):
    sys.exit("no eyes")
if "pacman_env.ros.supervisor.child" in sys.orig_argv:
    parent = sys.orig_argv[sys.orig_argv.index("pacman_env.ros.supervisor.child") + 1]
    while os.getppid() == int(parent):
        time.sleep(0.2)
    sys.exit()
"""


@pytest.fixture
def broken_game(tmp_path: Path) -> list[str]:
    """The command of a game that ends soon."""
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / "sitecustomize.py").write_text(BROKEN)
    code = (
        "import sys; from pacman_env.ros.supervisor import processes; "
        "processes.SLOW_START_S, processes.SOON_S = 0.0, 300.0; "
        "from pacman_env.cli.main import main; sys.exit(main(sys.argv[1:]))"
    )
    words = ["ros", "up", "--map", "house", "--policy", "nearest", "--sim", "--logs", str(tmp_path / "logs")]
    environment = f"PYTHONPATH={broken}{os.pathsep}{os.environ.get('PYTHONPATH', '')}"
    return ["env", environment, sys.executable, "-c", code, *words]


def test_lost_node_ends_game_with_reason(system: Any, broken_game: list[str]) -> None:
    up = system.run("up", broken_game)
    assert up.wait(PATIENCE_S) == NODE_LOST, up.output
    assert "no eyes" in up.output
    system.processes.clear()


class EndsOther(LineWriter):
    """Ends another game as soon as it is said to be waited for."""

    def __init__(self, end: Callable[[], None]) -> None:
        super().__init__(io.StringIO())
        self.shown, self._end = "", end

    def show(self, line: Callable[[bool], str], at_once: bool = False) -> None:
        if not self.shown:
            self._end()
        self.shown = line(False)


def test_ending_game_is_waited_for(domain: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(up_module, "GOING_S", PATIENCE_S)
    setup, stop = GameSetup("house", sim=True), StopSignals()
    place = setup.namespace, domain, setup.sim
    with session.nodes(tmp_path, alone=False) as nodes:
        nodes.start(GAME, map_yaml="house", policy="nearest")
        with StatusLine(setup.namespace, setup.sim) as status_line, GameLock(*place) as lock, GameLock(*place) as other:
            monkeypatch.setattr(up_module, "SIM_DISCOVERY_S", PATIENCE_S)
            writer = EndsOther(nodes.close)
            up_module.wait_for_other_games(status_line, lock, writer, stop)
            assert "another game in /robot_15" in writer.shown
            lock.__exit__()

            monkeypatch.setattr(up_module, "SIM_DISCOVERY_S", 0.0)
            assert other.acquire() == ""  # of a game whose nodes are not there yet, or not any more
            writer = EndsOther(other.__exit__)
            up_module.wait_for_other_games(status_line, lock, writer, stop)
            assert "another game in /robot_15" in writer.shown
            monkeypatch.setattr(up_module, "GOING_S", 0.0)
            with pytest.raises(ValueError, match="/robot_15"):
                up_module.wait_for_other_games(status_line, other, writer, stop)


UP = ["up", "--map", "house", "--policy", "nearest"]
BAD_DOMAIN = {"ROS_DOMAIN_ID": "abc"}, "ROS_DOMAIN_ID 'abc': must be a whole number, 0 to 232"
OTHER_MIDDLEWARE = {"RMW_IMPLEMENTATION": "rmw_cyclonedds_cpp"}, "rmw_cyclonedds_cpp is not installed: unset it"
NO_NAV2 = {"PATH": "/nowhere"}, "ros2 and nav2_bringup not found"


@pytest.mark.parametrize(
    ("command", "environment", "words"),
    [
        (["up", "--map", "nowhere"], {}, "nowhere: neither a YAML file"),
        ([*UP, "--selector", "mine"], {}, "selector 'mine'"),
        ([*UP, "--params-file", "nowhere.yaml"], {}, "nowhere.yaml"),
        ([*UP, "--speed", "2"], {}, "only a simulated robot"),
        ([*UP, "--sim", "--speed", "11"], {}, "speed 11: must be 1 to 10"),
        ([*UP, "--play-on"], {}, "only with --sim"),
        ([*UP, "--set", "clyde.sped=1"], {}, "unknown configuration field 'clyde.sped'"),
        ([*UP, "--sim", "--nav2"], *NO_NAV2),
        (UP, *BAD_DOMAIN),
        (["start"], *BAD_DOMAIN),
        (["status"], *BAD_DOMAIN),
        (["record", "--out", "bag"], *BAD_DOMAIN),
        (UP, *OTHER_MIDDLEWARE),
        (["status"], *OTHER_MIDDLEWARE),
        (["doctor"], *OTHER_MIDDLEWARE),
    ],
)
def test_invalid_command_is_refused_in_one_line(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    command: list[str],
    environment: dict[str, str],
    words: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.delenv("AMENT_PREFIX_PATH", raising=False)
    for name, value in environment.items():
        monkeypatch.setenv(name, value)
    logs = ["--logs", str(tmp_path / "logs")] if command[0] == "up" else []
    assert cli.main(["ros", *command, *logs]) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert words in err
    assert err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_command_without_ros_names_installation(
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
    assert install_command("ros") in err


@pytest.mark.parametrize(
    ("sim", "words"), [(True, "the simulated robot's pose"), (False, "docs/robot/first_game.md, step 5")]
)
def test_only_real_pose_is_awaited_with_page_step(domain: int, tmp_path: Path, sim: bool, words: str) -> None:
    setup = GameSetup("house", sim=sim)
    with StatusLine(setup.namespace, setup.sim) as status_line:
        status_line.game.processes |= {(name, (0.0, "", 0)): {} for name in (SIMULATOR, GAME, *LISTENERS)}
        status_line.game.condition = {"active": True, "nav2": True}
        options = UpOptions(logs=tmp_path)
        game = up_module.GameProcesses(
            setup, options, status_line, LineWriter(io.StringIO()), StopSignals()
        )  # nothing is started
        assert words in game.awaited()
        assert ("step" in game.awaited()) != sim
        game.processes.stop()


def test_log_folders_of_domains_differ(monkeypatch: pytest.MonkeyPatch) -> None:
    names = []
    for domain in ("0", "7"):
        monkeypatch.setenv("ROS_DOMAIN_ID", domain)
        names.append(up_module.log_folder("/robot_15").name)
    assert names == ["robot_15", "robot_15-7"]


def test_each_event_of_processes_is_published(tmp_path: Path) -> None:
    events: list[str] = []
    status_line: Any = SimpleNamespace(publish_processes=lambda states, event, number: events.append(event))
    writer = LineWriter(io.StringIO())
    game = up_module.GameProcesses(GameSetup("house"), UpOptions(logs=tmp_path), status_line, writer, StopSignals())
    for event in ("one has died", "two has died"):  # in one look at the processes
        game.processes.report(event)
    game.processes.stop()
    assert events == ["one has died", "two has died"]


REFUSAL = "start: no pose yet"


def answers(*answered: bool | None) -> tuple[list[topics.Service], Callable[[topics.Service], Future[Any]]]:
    """Return the services called so far, and a referee that accepts (True), refuses or does not answer (None) them."""
    called: list[topics.Service] = []

    def call(service: topics.Service) -> Future[Any]:
        accepts = answered[min(len(called), len(answered) - 1)]
        called.append(service)
        answer: Future[Any] = Future()
        if accepts is not None:
            answer.set_result(SimpleNamespace(success=accepts or service is topics.RESET_GAME, message=REFUSAL))
        return answer

    return called, call


@pytest.mark.parametrize(
    ("answered", "ready", "selector", "wanted", "calls", "said"),
    [
        ((False, False, True), True, OURS, [topics.START_GAME], 3, ""),  # a restarted game does not know the pose yet
        ((False,), False, OURS, [topics.START_GAME], 1, f"game/start: {REFUSAL}\n"),
        ((False,), True, ORIGINAL, [topics.START_GAME], 1, f"game/start: {REFUSAL}\n"),  # it may come much later
        ((None, True), True, OURS, [topics.START_GAME], 2, ""),  # a killed referee never answers
        # The reset stands.
        ((False,), True, OURS, [topics.START_GAME, topics.RESET_GAME], 2, f"game/start: {REFUSAL}\n"),
    ],
)
def test_rounds_repeat_start_until_it_is_answered(
    monkeypatch: pytest.MonkeyPatch,
    answered: tuple[bool | None, ...],
    ready: bool,
    selector: str,
    wanted: list[topics.Service],
    calls: int,
    said: str,
) -> None:
    monkeypatch.setattr(console, "ANSWER_S", 0.0)
    called, call = answers(*answered)
    out = io.StringIO()
    game = SimpleNamespace(condition={"selector": selector})
    there = SimpleNamespace(state="menu", ready=ready, call=call, game=game)
    rounds = RoundRequests(there, LineWriter(out))  # type: ignore[arg-type]
    rounds.wanted += wanted
    for _ in range(5):
        rounds.call_services()
    assert (len(called), rounds.wanted, rounds.answers) == (calls, [], [])
    assert out.getvalue() == said
