"""Two versions are compared round by round; checkouts here are small ones that say at once how fast they are."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from benchmarks import versions
from benchmarks.versions import ROOT, benchmark_module, main, measure, ratios
from pacman_env.evaluation import benchmark as throughput

#: A throughput benchmark that takes the real one's options and says what it was called with.
BENCHMARK = """
import argparse, json, os
from pathlib import Path
parser = argparse.ArgumentParser()
for name in ("--map", "--rounds", "--seconds", "--json"):
    parser.add_argument(name)
given = parser.parse_args()
assert Path(__file__).is_relative_to(Path.cwd()) and os.environ["PYTHONPATH"] == str(Path.cwd())
with open("calls", "a") as calls:
    print(given.map, given.seconds, file=calls)
Path(given.json).write_text(json.dumps({figures}))
"""


def figures(one: float, many: float, bare: float) -> dict[str, Any]:
    rates = {"1": one, "64": many, "1024": many}
    return {
        "decisions_per_s": rates,
        "bare_ratio_64": bare,
        "generated_decisions_per_s_64": one + many,
        "map": "loop",
        "version": "0.9",
    }


def checkout(folder: Path, module: str, said: dict[str, Any]) -> Path:
    file = folder / f"{module.replace('.', '/')}.py"
    file.parent.mkdir(parents=True)
    file.write_text(BENCHMARK.replace("{figures}", repr(said)))
    return folder


def test_ratios_are_of_figures_measured_one_after_the_other() -> None:
    here, there = [figures(10, 200, 0.4), figures(30, 100, 0.2)], [figures(20, 100, 0.4), figures(30, 200, 0.4)]
    assert ratios(here, there) == {
        "N = 1": [0.5, 1.0],
        "N = 64": [2.0, 0.5],
        "N = 1024": [2.0, 0.5],
        "generated houses": [1.75, 13 / 23],
        "ratio to bare at 64": [1.0, 0.5],
    }


@pytest.mark.parametrize("layout", ["eval/benchmark.py", "eval/benchmarks/throughput.py"])
def test_versions_of_either_layout_are_known(layout: str, tmp_path: Path) -> None:
    (tmp_path / layout).parent.mkdir(parents=True)
    (tmp_path / layout).touch()
    assert benchmark_module(tmp_path) == layout.removesuffix(".py").replace("/", ".")


@pytest.mark.parametrize("module", ["eval.benchmark", "pacman_env.evaluation.benchmark"])
def test_versions_are_measured_in_turns_in_processes_of_their_own(
    module: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    here = checkout(tmp_path / "here", "pacman_env.evaluation.benchmark", figures(10, 100, 0.3))
    there = checkout(tmp_path / "there", module, figures(20, 50, 0.3))
    monkeypatch.setattr(versions, "ROOT", here)
    assert main([str(there), "--map", "loop", "--rounds", "2", "--seconds", "0.5"]) == 0
    for folder in (here, there):
        assert (folder / "calls").read_text().splitlines() == ["loop 0.1", "loop 0.5", "loop 0.5"]  # first warmed up
    out = capsys.readouterr().out
    for words in ("map loop: version", "N = 1: 0.50", "N = 64: 2.00", "N = 1024: 2.00", "generated houses: 1.57"):
        assert words in out


def test_this_versions_benchmark_takes_what_it_is_asked_and_gives_what_is_compared(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def run(args: list[str], **options: Any) -> subprocess.CompletedProcess[str]:
        assert args[1:3] == ["-m", throughput.__name__]
        return subprocess.CompletedProcess(args, throughput.main(args[3:]), "", "")

    figures = {
        "map": "loop",
        "wall_segments": 4,
        "version": "0.9",
        "decisions_per_s": {"1": 1.0, "64": 64.0, "1024": 1024.0},
        "threads": {"1": 1024.0, "2": 2048.0},
        "houses_64": 32.0,
        "houses_64_ratio": 0.5,
        "new_house_per_episode": 1.0,
        "features_64": 16.0,
        "bare_decisions_per_s_64": 128.0,
        "bare_ratio_64": 0.5,
        "bare_ratio_64_range": [0.5, 0.5],
        "event_decisions_per_s_64": 32.0,
        "event_simulated_s_per_s_64": 64.0,
        "tick_simulated_s_per_s_64": 32.0,
        "make_again_ms": 1.0,
        "new_level_ms": 1.0,
        "generated_decisions_per_s_64": 1.0,
    }
    monkeypatch.setattr(versions.subprocess, "run", run)
    monkeypatch.setattr(
        throughput, "run", lambda map_source, rounds, seconds: figures | {"asked": [map_source, seconds]}
    )
    measured = measure(ROOT, "loop", 0.25)
    assert measured == json.loads(json.dumps(figures)) | {"asked": ["loop", 0.25]}
    assert set(ratios([measured], [measured])) == {
        "N = 1",
        "N = 64",
        "N = 1024",
        "generated houses",
        "a new house per episode",
        "64 houses",
        "planner's features",
        "by events",
        "2 threads at 1,024",
        "ratio to bare at 64",
    }


@pytest.mark.parametrize(
    ("arguments", "message"),
    [(["{folder}"], "no checkout"), ([str(ROOT), "--map", "nowhere", "--seconds", "0.01"], "nowhere")],
)
def test_what_cannot_be_compared_is_refused(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([a.format(folder=tmp_path) for a in arguments]) == 2
    assert message in capsys.readouterr().err
