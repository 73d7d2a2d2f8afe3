"""Processes kept alive and stopped in order; the nodes here are small modules without ROS."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from pacman_env.ros.supervisor import processes as module
from pacman_env.ros.supervisor.processes import Lost, ProcessGroup
from tests.waiting import PATIENCE_S, wait_for

ROOT = Path(__file__).resolve().parents[3]
GOOD = """
import signal, sys, time
def stop(number, frame):
    open(sys.argv[1], "a").write(__spec__.name.rpartition(".")[2] + "\\n")
    sys.exit(0)
signal.signal(signal.SIGTERM, stop)
print("ready", flush=True)
time.sleep(600)
"""
#: It ends only once both nodes of this kind have been asked to.
MEETS = GOOD.replace(
    "    open(sys",
    """    import pathlib
    own = __spec__.name.rpartition(".")[2]
    pathlib.Path(sys.argv[1] + own + ".asked").touch()
    while not all(pathlib.Path(f"{sys.argv[1]}{name}.asked").exists() for name in ("waits", "waits_too")):
        time.sleep(0.01)
    open(sys""",
)
#: It has a heartbeat, and ends by no signal that Python handles.
BEATS = """
import signal, sys, time
from pacman_env.ros import heartbeat
heartbeat.HANGS_S = 0
signal.signal(signal.SIGTERM, lambda number, frame: None)
heartbeat.HEART.beat(1)
print("ready", flush=True)
while sys.argv[0].endswith("beats.py"):
    heartbeat.HEART.beat()
    time.sleep(0.01)
time.sleep(600)
"""
REFUSES = "import sys; print('no such map', file=sys.stderr); sys.exit(2)"
NODES = {
    "first": GOOD,
    "second": GOOD,
    "waits": MEETS,
    "waits_too": MEETS,
    "refuses": REFUSES,
    "spare": REFUSES,
    "beats": BEATS,
    "hangs": BEATS,
    "dies": "raise RuntimeError('out of luck')",
    "twice": """
import os, pathlib, signal, sys
before = pathlib.Path(sys.argv[1] + ".twice")
if before.exists():
    print("[INFO] [1.0] [twice]: here again", flush=True)
    os._exit(3)
before.touch()
print("Fatal Python error: Segmentation fault", flush=True)
os.kill(os.getpid(), signal.SIGSEGV)
""",
    "says_place": "print('[FATAL] [1.0]: out of luck\\n[WARN] at:\\n  exit()\\n  ^^^^^^'); raise SystemExit(3)",
    "stubborn": "import signal, time; signal.signal(signal.SIGTERM, signal.SIG_IGN); print('ready', flush=True)\n"
    "time.sleep(600)",
}


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    package = tmp_path / "nodes"
    package.mkdir()
    (package / "__init__.py").touch()
    for name, source in NODES.items():
        (package / f"{name}.py").write_text(source)
    return tmp_path


@pytest.fixture
def said() -> list[str]:
    return []


@pytest.fixture
def environment(folder: Path) -> dict[str, str]:
    return {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(folder)])}


@pytest.fixture
def group(folder: Path, environment: dict[str, str], said: list[str]) -> Iterator[ProcessGroup]:
    command = lambda name: [f"nodes.{name}", str(folder / "order")]  # noqa: E731
    group = ProcessGroup(command, folder, environment, said.append, spare=("spare",))
    yield group
    group.stop()


def ready(group: ProcessGroup, *names: str) -> None:
    for name in names:
        wait_for(lambda name=name: group.reason_of_end(name).startswith("ready"), f"{name} ready")


def test_nodes_stop_in_order(group: ProcessGroup, folder: Path) -> None:
    """The two nodes between the first and the last end only when both have been asked to."""
    order = folder / "order"
    names = ("first", "waits", "waits_too", "second")
    for name in names:
        group.start(name)
    ready(group, *names)
    told: list[str] = []
    halt = lambda: told.append("".join(path.read_text() for path in [order] if path.exists()))  # noqa: E731
    assert group.stop(["second", "absent"], ["first"], halt) == []
    assert told[1:] == ["second\n"], "once more after its end"
    ended = order.read_text().split()
    assert (ended[0], set(ended[1:3]), ended[3:]) == ("second", {"waits", "waits_too"}, ["first"])


def test_node_that_ends_during_halt_is_named(group: ProcessGroup, folder: Path) -> None:
    group.start("first")
    ready(group, "first")
    named: list[list[str]] = []
    ended = (folder / "order").exists
    group.stop(["first"], halt=lambda: wait_for(ended, "the end"), waiting=lambda names: named.append(list(names)))
    assert named[0] == ["first"]


def test_stubborn_node_is_killed_and_named(group: ProcessGroup, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PATIENCE_S", 0.2)
    group.start("stubborn")
    ready(group, "stubborn")
    assert group.stop() == ["stubborn"]


def test_frozen_node_is_started_again(group: ProcessGroup, said: list[str]) -> None:
    group.start("beats")
    ready(group, "beats")
    first = group.ids()
    os.kill(first["beats"], signal.SIGSTOP)
    wait_for(lambda: group.restart() == ["beats"], "the freeze is seen")
    assert len(said) == 1
    assert "frozen" in said[0]
    wait_for(lambda: group.restart() == [] and group.ids().items() - first.items(), "another process")


def test_frozen_node_is_killed_after_halt(group: ProcessGroup, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PATIENCE_S", 10 * PATIENCE_S)
    group.start("beats")
    ready(group, "beats")
    group.restart()  # receives a heartbeat
    os.kill(number := group.ids()["beats"], signal.SIGSTOP)
    alive: list[bool] = []
    assert group.stop(["beats"], halt=lambda: alive.append(Path(f"/proc/{number}").exists())) == ["beats"]
    assert alive == [True, False]


def test_dead_node_is_started_again(group: ProcessGroup, said: list[str]) -> None:
    group.start("first")
    ready(group, "first")
    first = group.ids()
    os.kill(first["first"], signal.SIGKILL)
    wait_for(lambda: group.restart() == ["first"], "the death is seen")
    assert len(said) == 1
    assert "SIGKILL" in said[0]
    assert "ready" not in said[0], "no reason"
    wait_for(lambda: group.restart() == [] and group.ids().items() - first.items(), "started again")


def test_dying_node_is_given_up(group: ProcessGroup, said: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SLOW_START_S", 0.0)
    monkeypatch.setattr(module, "SOON_S", 10 * PATIENCE_S)
    group.start("dies")
    with pytest.raises(Lost, match="RuntimeError: out of luck") as lost:
        wait_for(lambda: group.restart() and False, "it is given up")
    assert not lost.value.refuses
    assert len(said) == module.MANY - 1


@pytest.mark.parametrize(
    ("name", "reasons"),
    [
        ("twice", ["Fatal Python error: Segmentation fault", ""]),  # only its first life ends with an error in its log
        ("says_place", ["[FATAL] [1.0]: out of luck"]),
    ],
)
def test_reason_of_end_is_error_of_same_life(
    group: ProcessGroup, folder: Path, said: list[str], name: str, reasons: list[str]
) -> None:
    group.start(name)
    for reason in reasons:
        wait_for(lambda: group.restart() == [name], "its end")
        assert (f"{reason} ({folder / f'{name}.log'})" if reason else "status 3, its log is") in said[-1]


@pytest.mark.parametrize("name", ["refuses", "spare"])
def test_refusing_node_is_not_started_again(group: ProcessGroup, said: list[str], name: str) -> None:
    group.start("first")
    ready(group, "first")
    group.start(name)
    if name == "refuses":
        with pytest.raises(Lost, match="no such map") as lost:
            wait_for(lambda: group.restart() and False, "it is given up")
        assert lost.value.refuses
    else:
        wait_for(lambda: group.restart() == [name], "its end")
    assert group.states()["first"] == ""
    assert "no such map" in group.states()[name]
    assert len(said) == (name == "spare")
    assert group.restart() == []


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells a process that its parent is gone")
@pytest.mark.parametrize("name", ["first", "hangs"])
def test_no_node_outlives_killed_parent(folder: Path, environment: dict[str, str], name: str) -> None:
    order = folder / "order"
    parent = f"""
import time
from pathlib import Path
from pacman_env.ros.supervisor.processes import ProcessGroup
import os
group = ProcessGroup(lambda name: ["nodes." + name, {str(order)!r}], Path({str(folder)!r}), dict(os.environ), print)
group.start({name!r})
print(group.ids()[{name!r}], flush=True)
time.sleep(600)
"""
    with subprocess.Popen([sys.executable, "-c", parent], env=environment, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        number, log = int(process.stdout.readline()), folder / f"{name}.log"
        wait_for(lambda: log.exists() and "ready" in log.read_text(), "the node runs")
        process.send_signal(signal.SIGKILL)
    wait_for(lambda: not Path(f"/proc/{number}").exists(), "the node has ended")
    assert order.exists() == (name == "first")
