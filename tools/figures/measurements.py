"""List the measurements behind the figures of the documentation: command, inputs and how the values are obtained."""

import hashlib
import json
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pacman_env.envs.registration import IDS
from tools import scores
from tools.common import ROOT

Values = Any  # plain data, as JSON stores it
_LEAGUE = ROOT / "docs" / "leaderboard.md"
_GIVEN_MAPS = (
    "`--map slam` plays on the [ten maps made by SLAM](maps.md#maps-made-by-slam) that `scripts/slam_maps` fetches."
)
_SUITE = "--suite brief --map slam --policies ppo lookahead clyde_aware nearest"

_FEATURES = ("features", "search")  # planner features play the coarse model of the search
_POLICIES = ("engine", "settings", "evaluation", *_FEATURES, "planner", "policies")
_FIELDS = (
    "map", "policy", "clyde_speed", "kind", "episodes", "levels", "pellets", "pellets_least", "completion_rate",
    "completion_ci", "all_but_one_rate", "all_but_one_ci", "pellets_mean", "ghosts_caught_mean", "death_rate",
    "timeout_rate", "cleared_rate", "time_mean_s", "win_time_mean_s", "paired_difference", "paired_ci",
    "decision_ms_p50", "decision_ms_p99",
)  # fmt: skip


@dataclass(frozen=True)
class Measurement:
    """One command, and the values that pages show of its results."""

    command: str  # as a reader types it, in the clone
    inputs: tuple[str, ...]  # names of tools.figures.inputs; the figure is stale when one has changed
    minutes: float  # on two cores
    measure: Callable[[Path], Values]  # takes a folder that keeps played rounds


def measurements() -> dict[str, Measurement]:
    return {
        "compare": _compare("scripts/compare", 1),
        "house": _compare("pacman-env compare --policies ppo clyde_aware --clyde-speed 0.25 0.45 --episodes 1000", 5),
        "maskable_ppo": Measurement(
            "python docs/examples/clients/sb3_maskable_ppo.py --seed SEED --rounds 400 --test generated:test house",
            ("engine", "settings", *_FEATURES, "environments"),
            20,
            lambda _: {f"--seed {seed}": _learned(seed) for seed in range(3)},
        ),
        "leaderboard": Measurement(
            f"pacman-env compare {_SUITE} --resume --markdown docs/leaderboard.md",
            _POLICIES,
            80,
            _league,
        ),
        "speed": Measurement(
            "python -m benchmarks.versions --seconds 2",
            ("engine", *_FEATURES, "environments", "compiler", "planner", "training"),
            12,
            lambda _: _results("benchmarks.versions", "--seconds 2"),
        ),
        **{scores.figure_of(env_id): _scores(env_id) for env_id in IDS},
    }


def _scores(env_id: str) -> Measurement:
    command = f"scripts/figures {scores.figure_of(env_id)}"
    return Measurement(command, (*_POLICIES, "environments"), 1, lambda _: scores.score_id(env_id, 200))


def _learned(seed: int) -> list[str]:
    """Return what the script of MaskablePPO prints about its rounds."""
    words = f"docs/examples/clients/sb3_maskable_ppo.py --rounds 400 --seed {seed} --test generated:test house"
    command = [sys.executable, *words.split()]
    printed = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
    return [line for line in printed.splitlines() if "rounds completed" in line or "difference" in line]


def _league(folder: Path) -> dict[str, str]:
    """Write the league table; return the hash of its page."""
    _compared(f"{_SUITE} --markdown {_LEAGUE}", folder)
    _LEAGUE.write_text(_LEAGUE.read_text().replace("\n\n## Summary", f"\n\n{_GIVEN_MAPS}\n\n## Summary"))
    return league_hash()


def league_hash() -> dict[str, str]:
    """Return the hash of the page of the league table, which the command writes by itself."""
    return {"sha256": hashlib.sha256(_LEAGUE.read_bytes()).hexdigest()}


def _compare(command: str, minutes: float) -> Measurement:
    options = command.partition("compare")[2]
    return Measurement(command, _POLICIES, minutes, lambda folder: list(map(_kept, _compared(options, folder)["rows"])))


def _kept(row: Mapping[str, Any]) -> dict[str, Any]:
    return {field: row[field] for field in _FIELDS if field in row} | {"ends": row["outcomes"]["end"]}


def _compared(options: str, folder: Path) -> Values:
    return _results("pacman_env.cli.main", f"compare {options} --workers 2 --resume --parts {folder}")


def _results(module: str, words: str) -> Values:
    """Run a module and return what it writes with the option ``--json``."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "figure.json")
        subprocess.run([sys.executable, "-m", module, *words.split(), "--json", str(file)], cwd=ROOT, check=True)
        return json.loads(file.read_text(encoding="utf-8"))
