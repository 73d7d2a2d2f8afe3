"""Processes kept alive and stopped in order; the nodes here are small modules without ROS."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from pacman_env.ros.supervisor import processes as crew_module
from pacman_env.ros.supervisor.processes import Crew, Lost

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
NODES = {
    "first": GOOD,
    "second": GOOD,
    "third": GOOD,
    "done": "",
    "refuses": "import sys; print('refuses: no such map', file=sys.stderr); sys.exit(2)",
    "dies": "raise RuntimeError('out of luck')",
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
def crew(folder: Path, said: list[str]) -> Iterator[Crew]:
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(folder)])}
    crew = Crew(folder, environment, said.append, module_of="nodes.{}".format)
    yield crew
    crew.stop()


def wait_for(condition: Callable[[], object], what: str) -> None:
    end = time.monotonic() + 120.0
    while not condition():
        assert time.monotonic() < end, f"waited in vain: {what}"
        time.sleep(0.02)


def ready(crew: Crew, *names: str) -> None:
    for name in names:
        wait_for(lambda name=name: crew.last_words(name).startswith("ready"), f"{name} ready")


def test_nodes_stop_one_after_another_the_named_ones_first_then_the_last_started(crew: Crew, folder: Path) -> None:
    order = folder / "order"
    for name in ("first", "second", "third"):
        crew.start(name, [str(order)])
    ready(crew, "first", "second", "third")
    between: list[str] = []
    assert crew.stop(["second", "absent"], between.append) == []
    assert order.read_text().split() == between == ["second", "third", "first"]


def test_a_node_that_ignores_the_end_is_killed_and_named(crew: Crew, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(crew_module, "PATIENCE_S", 0.2)
    crew.start("stubborn")
    ready(crew, "stubborn")
    assert crew.stop() == ["stubborn"]


def test_a_dead_node_is_started_again_and_its_reason_is_said(crew: Crew, folder: Path, said: list[str]) -> None:
    crew.start("first", [str(folder / "order")])
    ready(crew, "first")
    process = crew._members["first"].process
    assert process is not None
    process.kill()
    wait_for(lambda: crew.tend() == ["first"], "the death is seen")
    assert "first ended with status -9: ready" in said[0]
    wait_for(lambda: crew.tend() == [] and crew._members["first"].process is not None, "started again")
    assert crew._members["first"].process is not process


def test_a_node_that_keeps_dying_is_given_up_with_its_last_words(
    crew: Crew, said: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(crew_module, "SLOW_START_S", 0.0)
    crew.start("dies")

    def tend_for_ever() -> None:
        wait_for(lambda: crew.tend() and False, "it is given up")

    with pytest.raises(Lost, match="dies died 5 times within 60 s: RuntimeError: out of luck"):
        tend_for_ever()
    assert len(said) == 4


def test_a_node_that_refuses_its_arguments_is_not_started_again(crew: Crew, said: list[str]) -> None:
    crew.start("refuses")
    with pytest.raises(Lost, match="refuses does not start: refuses: no such map"):
        wait_for(lambda: crew.tend() and False, "it is given up")
    assert said == []


def test_a_node_whose_work_is_done_can_be_dismissed(crew: Crew) -> None:
    crew.start("done")
    wait_for(lambda: crew.status("done") == 0, "done")
    crew.dismiss("done")
    assert "done" not in crew
    assert crew.tend() == []


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux tells a process that its parent is gone")
def test_no_node_outlives_a_killed_parent(folder: Path) -> None:
    order = folder / "order"
    parent = f"""
import time
from pathlib import Path
from pacman_env.ros.supervisor.processes import Crew
import os
crew = Crew(Path({str(folder)!r}), dict(os.environ), print, module_of=lambda name: "nodes." + name)
crew.start("first", [{str(order)!r}])
time.sleep(600)
"""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), str(folder)])}
    with subprocess.Popen([sys.executable, "-c", parent], env=environment) as process:
        log = folder / "first.log"
        wait_for(lambda: log.exists() and "ready" in log.read_text(), "the node runs")
        process.send_signal(signal.SIGKILL)
    wait_for(order.exists, "the node has ended")
