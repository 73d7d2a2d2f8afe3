"""Other libraries' environments beside ours: what is measured, what is named as missing, and what is printed."""

import json
from pathlib import Path
from typing import Any

import pytest

import pacman_env
from benchmarks import peer_worker, peers
from benchmarks.peers import OURS, PeerError, Worker, main, run, show

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
