from __future__ import annotations

import gc

import numpy as np
import pytest

import tests.system.memory
from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv
from pacman_env.world.navigation.physics import Spaces
from tests.system.memory import PARTS, Watch, digest, main, make_and_close, spaces_alive


@pytest.mark.daily
def test_short_run_reports_all_parts(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--short"]) == 0
    lines = capsys.readouterr().out.splitlines()
    for part in PARTS:
        summary = [line for line in lines if line.startswith(part)]
        assert len(summary) >= 3
        assert "since the first tenth" in summary[-1]


def test_spaces_alive_counts_existing_physics_spaces() -> None:
    gc.collect()
    before = spaces_alive()
    spaces = Spaces(3, radius_m=0.2, mass_kg=1.0, step_s=0.05)
    for k in range(5):
        spaces.provide(k, np.array([[float(k), 0.0, 1.0, 1.0]]))
        assert spaces_alive() == before + min(k + 1, 4)  # one for each robot, one for a level: another's goes
    del spaces
    assert spaces_alive() == before


def test_growing_memory_is_reported_as_fault(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    sizes = iter([100.0] * 10 + [116.5] * 50)
    monkeypatch.setattr(tests.system.memory, "resident_mib", lambda: next(sizes))
    assert main(["decisions", "--decisions", "10000"]) == 1
    assert capsys.readouterr().out.splitlines()[-1].startswith("decisions: 116.5 MiB after ")


def test_different_results_are_reported_as_fault(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(tests.system.memory, "digest", lambda threads: f"{min(threads, 2)}" * 64)
    assert main(["runs", "--runs", "2"]) == 1
    assert "run 0 of 7 threads gave 222222222222, one thread 111111111111" in capsys.readouterr().out


def test_remaining_threads_are_reported_as_fault(monkeypatch: pytest.MonkeyPatch) -> None:
    kept: list[PacManBotVectorEnv] = []
    monkeypatch.setattr(PacManBotVectorEnv, "close", lambda env: kept.append(env))
    with pytest.raises(tests.system.memory.Fault, match="threads are left of what is gone"):
        make_and_close(1)


def test_digest_depends_on_runs_but_not_threads() -> None:
    assert digest(1, 3) == digest(3, 3) != digest(1, 4)


def test_last_measurement_is_always_taken() -> None:
    watch = Watch("runs", 3, quiet=True)
    for done in range(1, 4):
        watch.measure(done)
    assert watch.base_mib > 0
