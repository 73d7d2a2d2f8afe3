"""Other libraries' environments beside ours: what is measured, what is named as missing, and what is printed."""

import json
import subprocess
import sys
import zipfile
from pathlib import Path
from typing import Any

import pytest

import pacman_env
from benchmarks import peer_worker, peers
from benchmarks.peers import OURS, PEERS, PeerError, Worker, main, python_of, run, show

SHORT = ["--map", "loop", "--rounds", "2", "--seconds", "0.1"]


@pytest.fixture(scope="module")
def measured() -> dict[str, Any]:
    """Ours alone, really played."""
    return run([], None, "loop", 1, 0.1)


def test_environment_is_measured_with_1_and_64_games(measured: dict[str, Any]) -> None:
    assert [(row["library"], row["n"], row["threads"]) for row in measured["rows"]] == [(OURS, 1, 1), (OURS, 64, 1)]
    for row in measured["rows"]:
        assert row["decisions_per_s"] > 0
        assert row["simulated_s_per_s"] == pytest.approx(0.5 * row["decisions_per_s"])
        assert row["cores"] > 0
        assert row["version"] == pacman_env.__version__
    assert measured["failed"] == {}


@pytest.mark.daily
def test_worker_describes_and_measures_own_environment() -> None:
    worker = Worker(OURS, "loop")
    (task,) = worker.tasks
    assert task["description"].startswith("10 Chipmunk steps")
    assert list(worker.cases()) == [(0, 1, 1), (0, 64, 1)]
    assert worker.turn(0, 64, 1, 0.05)["decisions_per_s"] > 0
    with pytest.raises(ValueError, match="our own environment: IndexError: list index out of range"):
        worker.turn(1, 64, 1, 0.05)


def test_turn_counts_all_games_and_takes_one_step() -> None:
    steps: list[int] = []
    rate = peer_worker.turn(lambda: steps.append(1), 64, 0.0)["decisions_per_s"]
    assert len(steps) == 1
    assert rate >= 64


def test_ended_episode_is_reset_before_next_step() -> None:
    class Env:
        resets = 0

        def __init__(self) -> None:
            import gymnasium as gym

            self.action_space = gym.spaces.Discrete(3)
            self.actions: list[int] = []

        def reset(self, seed: int | None = None) -> None:
            self.resets += 1

        def step(self, action: int) -> tuple[int, float, bool, bool, dict[str, Any]]:
            self.actions.append(int(action))
            return 0, 0.0, len(self.actions) == 2, len(self.actions) == 4, {}

    first, second = Env(), Env()
    for env in (first, second):
        step = peer_worker.alone(env)
        for _ in range(5):
            step()
    assert first.resets == 3
    assert first.actions == second.actions


def test_missing_library_is_named_as_not_installed(monkeypatch: pytest.MonkeyPatch) -> None:
    for module in ("envpool", "vmas", "mpe2"):
        monkeypatch.setitem(sys.modules, module, None)
        with pytest.raises(ModuleNotFoundError) as caught:
            peer_worker.LIBRARIES[module]("loop")
        assert peer_worker.reason(caught.value) == f"{module} is not installed"
    assert peer_worker.reason(OSError("no\nmemory")) == "OSError: no memory"
    assert set(peer_worker.LIBRARIES) == {OURS, *PEERS}


class Fake(Worker):
    """Ours is fast; the first library cannot be imported, the second dies at 64 games, the third plays."""

    def __init__(self, name: str, map_source: str, python: Path | None = None) -> None:
        if name == "envpool":
            raise PeerError("envpool is not installed")
        self.name, self.version = name, "1.0"
        task = {"name": "Easy-v0", "simulated_s": 0.25, "description": "a bit", "sizes": [1, 64], "threaded": True}
        self.tasks = [task | {"threaded": False, "simulated_s": 0.5} if name == OURS else task]

    def turn(self, task: int, size: int, threads: int, seconds: float) -> dict[str, float]:
        if self.name == "vmas" and size == 64:
            raise PeerError("ended with status -9: no memory")
        return {"decisions_per_s": 2000.0 * size * (2 if self.name == OURS else threads), "cores": float(threads)}


def test_table_shows_ratios_and_libraries_that_failed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(peers, "Worker", Fake)
    monkeypatch.setattr(peers, "CORES", 2)
    path = tmp_path / "out" / "peers.json"
    asked = ["envpool", "vmas", "mpe2", "mpe2"]
    assert main([*asked, "--rounds", "3", "--json", str(path)]) == 0
    said = capsys.readouterr().out
    figures = json.loads(path.read_text())
    assert said == show(figures) + "\n"
    rows = {(row["library"], row["n"], row["threads"]): row for row in figures["rows"]}
    ours, theirs = [(OURS, 1, 1), (OURS, 64, 1)], [("mpe2", 1, 1), ("mpe2", 64, 1), ("mpe2", 64, 2)]
    assert [*rows] == [*ours, ("vmas", 1, 1), *theirs]
    assert rows["mpe2", 64, 1]["ratio"] == 0.5
    assert rows["mpe2", 64, 2]["ratio_range"] == [1.0, 1.0]
    assert "ratio" not in rows[OURS, 64, 1]
    lines = said.splitlines()
    assert "| mpe2 Easy-v0 | 64 | 1 | 128,000 | 0.5 (0.5 to 0.5) | 32,000 | 1.00 |" in lines
    assert "- mpe2 1.0 Easy-v0: 0.25 s, a bit" in lines
    assert "- not measured: envpool: envpool is not installed" in lines
    assert "- not measured: vmas: ended with status -9: no memory" in lines
    assert "  (--venvs DIR installs them there)" in lines


@pytest.mark.parametrize(
    ("script", "limit_s", "message"),
    [
        ("import sys; sys.exit('out of luck')", 60.0, "ended with status 1: out of luck"),
        ("", 60.0, "ended with status 0"),
        ("import time; time.sleep(600)", 0.2, r"no answer within 0\.2 s"),
    ],
)
def test_dead_or_hanging_worker_is_reported(
    script: str, limit_s: float, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "script.py"
    path.write_text(script)
    monkeypatch.setattr(peers, "SCRIPT", path)
    monkeypatch.setattr(peers, "LIMIT_S", limit_s)
    with pytest.raises(PeerError, match=message):
        Worker("vmas", "loop")


def test_library_import_error_is_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In the worker's process; what the library prints is no answer."""
    (tmp_path / "mpe2.py").write_text("print('hello'); raise ImportError('mpe2 wants\\na display')")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    with pytest.raises(PeerError, match=r"^ImportError: mpe2 wants a display$"):
        Worker("mpe2", "loop")


def an_empty_wheel(folder: Path, name: str) -> None:
    """What pip installs as a package that has a version, and nothing else."""
    facts = {
        "METADATA": f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n",
        "WHEEL": "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n",
        "RECORD": "",
    }
    with zipfile.ZipFile(folder / f"{name}-1.0-py3-none-any.whl", "w") as wheel:
        for file, text in facts.items():
            wheel.writestr(f"{name}-1.0.dist-info/{file}", text)


def test_venv_is_reused_and_failed_installation_reported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With no index to ask, but a folder with one wheel."""
    monkeypatch.setenv("PIP_NO_INDEX", "1")
    monkeypatch.setenv("PIP_FIND_LINKS", str(tmp_path))
    monkeypatch.setitem(PEERS, "mpe2", ("mpe2==0.0.0",))
    with pytest.raises(
        PeerError, match=r"^cannot be installed: ERROR: No matching distribution found for mpe2==0.0.0$"
    ):
        python_of("mpe2", tmp_path)
    an_empty_wheel(tmp_path, "mpe2")
    monkeypatch.setitem(PEERS, "mpe2", ("mpe2==1.0",))
    python = python_of("mpe2", tmp_path)
    version = "import importlib.metadata; print(importlib.metadata.version('mpe2'))"
    assert subprocess.check_output([python, "-c", version], text=True) == "1.0\n"
    mark = python.with_name("mark")
    mark.touch()
    assert python_of("mpe2", tmp_path) == python
    assert mark.exists()
