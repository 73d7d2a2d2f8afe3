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
    "done": "",
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
    wait_for(lambda: group.restart_frozen() == ["beats"], "the freeze is seen")
    assert said == ["beats is started again: it is frozen, no heartbeat for 2 s"]
    wait_for(lambda: group.restart_dead() == [] and group.ids().items() - first.items(), "another process")


def test_frozen_node_is_killed_after_halt(group: ProcessGroup, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "PATIENCE_S", 10 * PATIENCE_S)
    group.start("beats")
    ready(group, "beats")
    group.restart_frozen()  # receives a heartbeat
    os.kill(number := group.ids()["beats"], signal.SIGSTOP)
    alive: list[bool] = []
    assert group.stop(["beats"], halt=lambda: alive.append(Path(f"/proc/{number}").exists())) == ["beats"]
    assert alive == [True, False]


def test_dead_node_is_started_again_with_reason(group: ProcessGroup, folder: Path, said: list[str]) -> None:
    group.start("first")
    ready(group, "first")
    first = group.ids()
    os.kill(first["first"], signal.SIGKILL)
    wait_for(lambda: group.restart_dead() == ["first"], "the death is seen")
    assert said == [f"first was killed (SIGKILL), its log is {folder / 'first.log'}; again at once"], (
        "ready is no reason"
    )
    wait_for(lambda: group.restart_dead() == [] and group.ids().items() - first.items(), "started again")


def test_dying_node_is_given_up(group: ProcessGroup, said: list[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SLOW_START_S", 0.0)
    monkeypatch.setattr(module, "SOON_S", PATIENCE_S)
    group.start("dies")

    def tend_for_ever() -> None:
        wait_for(lambda: group.restart_dead() and False, "it is given up")

    with pytest.raises(
        Lost, match="dies died 5 times within 300 s, at last it ended with status 1: RuntimeError: out of luck"
    ):
        tend_for_ever()
    assert len(said) == 4


def test_reason_of_death_is_of_same_life(group: ProcessGroup, folder: Path, said: list[str]) -> None:
    """Its first life ends with an error in its log, the second with no word."""
    group.start("twice")
    wait_for(lambda: group.restart_dead() == ["twice"], "the first death")
    log = folder / "twice.log"
    assert said == [f"twice was killed (SIGSEGV): Fatal Python error: Segmentation fault ({log}); again at once"]
    wait_for(lambda: group.restart_dead() == ["twice"], "the second death")
    assert said[1:] == [f"twice ended with status 3, its log is {log}; again in 2 s"]


def test_reason_of_end_is_no_place(group: ProcessGroup, folder: Path, said: list[str]) -> None:
    group.start("says_place")
    wait_for(lambda: group.restart_dead() == ["says_place"], "its end")
    assert f"status 3: [FATAL] [1.0]: out of luck ({folder / 'says_place.log'})" in said[0]


def test_refusing_node_is_not_started_again(group: ProcessGroup, said: list[str]) -> None:
    group.start("refuses")
    with pytest.raises(Lost, match="refuses does not start: no such map"):
        wait_for(lambda: group.restart_dead() and False, "it is given up")
    assert said == []


def test_spare_node_is_given_up(group: ProcessGroup, folder: Path, said: list[str]) -> None:
    group.start("first")
    group.start("spare")
    ready(group, "first")
    wait_for(lambda: group.restart_dead() == ["spare"], "its end")
    assert said == [
        f"spare does not start: no such map ({folder / 'spare.log'}); it is given up, the other nodes continue"
    ]
    assert group.restart_dead() == []
    assert group.stop() == []


def test_finished_node_can_be_dismissed(group: ProcessGroup) -> None:
    group.start("done")
    wait_for(lambda: group.status("done") == 0, "done")
    group.remove("done")
    assert "done" not in group
    assert group.restart_dead() == []


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


def test_unresponsive_process_is_restarted_with_limits(
    group: ProcessGroup, said: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    group.start("stubborn")
    ready(group, "stubborn")
    first = group.ids()
    group.restart("stubborn", "no answer")
    assert (group.ids(), said) == (first, [])  # it has only just been started
    monkeypatch.setattr(module, "AT_REST_S", 0.0)
    monkeypatch.setattr(module, "SLOW_START_S", 0.0)
    for count in range(1, module.RESTARTS + 1):
        before = group.ids()
        group.restart("stubborn", "no answer")
        assert said.count("stubborn is started again: no answer") == count
        wait_for(lambda old=before: group.restart_dead() == [] and group.ids().items() - old.items(), "another process")
    assert not any("was killed" in line for line in said)  # one line says it all
    last = group.ids()
    for _ in range(2):
        group.restart("stubborn", "no answer")
    assert group.ids() == last
    assert said[-1] == "stubborn: 3 restarts did not help: no answer"
    assert sum("did not help" in line for line in said) == 1
    os.kill(last["stubborn"], signal.SIGKILL)
