"""List the measurements behind the figures of the documentation: command, inputs and how the values are obtained."""

import csv
import hashlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pacman_env.envs.registration import IDS
from tools import scores
from tools.common import ROOT

Values = Any  # plain data, as JSON stores it
REAL_MAPS = (
    "irl_lab", "aws_small_house", "pacmanbot_house", "ipa_kitchen", "mh_amcl_lab",
    "irl_aws_house", "f1tenth_levine", "ecn_amphiE", "elsabot_upstairs", "ecn_batS",
)  # fmt: skip
_SHARED = Path(os.environ.get("PACMAN_ENV_SHARED") or ROOT.parent / "shared")  # real maps; not in the repository
_NAV2_ROUNDS = ROOT / "eval" / "nav2" / "rounds.csv"
_LEAGUE = ROOT / "docs" / "leaderboard.md"
_SUITE = "--suite brief --policies ppo lookahead clyde_aware nearest"
_NODES = ROOT / "eval" / "nodes.csv"

_ROUNDS = ("engine", "settings", "evaluation")
_FEATURES = ("features", "search")  # planner features play the coarse model of the search
_PLANNERS = (*_FEATURES, "planner", "policies")
_POLICIES = (*_ROUNDS, *_PLANNERS)
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
    """Return all measurements by name."""
    maps = [f"../shared/maps/{name}/map.yaml" for name in REAL_MAPS]
    table = "--policies ppo lookahead clyde_aware --clyde-speed 0.25 0.35 0.45 --episodes 100"
    errors = "--policies ppo clyde_aware --clyde-speed 0.25 0.45 --episodes 1000"
    robot_0_15 = "--preset robot_0_15 --policies ppo --clyde-speed 0.25 0.35 0.45 --episodes 100"
    speed = "benchmark --rounds 5 --seconds 2 --first-start --training"
    arcade = "--preset arcade --levels test --policies ppo nearest lookahead clyde_aware --episodes 400"
    found = {
        "compare": _compare("scripts/compare", 1),
        "real_maps": _each_map(f"pacman-env compare --map MAP {table}", 25),
        "real_maps_robot_0_15": _each_map(f"pacman-env compare --map MAP {robot_0_15}", 8),
        "arcade": _compare(f"pacman-env compare {arcade}", 3),
        "house": _compare("pacman-env compare --policies ppo clyde_aware --clyde-speed 0.25 0.45 --episodes 1000", 5),
        "causes": _text(f"pacman-env validation --map {maps[2]} --workers 2", 10, (*_ROUNDS, "policies")),
        "recorded_goals": _text(
            "pacman-env validation --recorded-goals eval/nav2/house eval/nav2/irl_aws_house eval/nav2/tb4_maze"
            " eval/nav2/pacmanbot_house --maps ../shared/maps --set robot.speed_mps=0.306",
            2,
            ("engine", "settings"),
        ),
        "lasting_errors": _compare(f"pacman-env compare {errors} --set localization.error_kept=0.93", 5),
        "power": Measurement(
            f"pacman-env compare {_POWER} --set power.pellets=4 --set clyde.ghosts=GHOSTS",
            _POLICIES,
            15,
            _power,
        ),
        "maskable_ppo": Measurement(
            "python docs/examples/clients/sb3_maskable_ppo.py --seed SEED --rounds 400 --test generated:test house",
            ("engine", "settings", *_FEATURES, "environments"),
            20,
            lambda _: _learned("--seed 0", "--seed 1", "--seed 2"),
        ),
        "leaderboard": Measurement(
            f"pacman-env compare {_SUITE} --map {' '.join(maps)} --resume --markdown docs/leaderboard.md",
            _POLICIES,
            80,
            lambda folder: _league(maps, folder),
        ),
        "nav2_rounds": Measurement(
            'python -m tools.nav2_rounds house --policy POLICY --nav2 "COMMAND" --out eval/nav2/rounds.csv',
            ("engine", "settings", *_PLANNERS),
            300,
            lambda _: _recorded(_NAV2_ROUNDS),
        ),
        "nodes": Measurement(
            "python -m tests.system.campaign.robot_rounds",
            ("engine", "settings", *_PLANNERS),
            60,
            lambda _: _recorded(_NODES),
        ),
        "speed": Measurement(
            f"pacman-env {speed}",
            ("engine", *_FEATURES, "environments", "compiler", "planner", "training"),
            12,
            lambda _: {**_json(speed, "--json"), "command": f"pacman-env {speed}"},
        ),
    }
    for env_id in IDS:
        name = scores.figure_of(env_id)
        found[name] = Measurement(
            f"scripts/figures {name}",
            (*_POLICIES, "environments"),
            1,
            lambda _, env_id=env_id: scores.score_id(env_id, 200),  # type: ignore[misc]
        )
    return found


_GHOSTS = ("chase", "arcade,chase", "arcade,chase,wander,wander")
_POWER = "--levels test --num-levels 100 --policies nearest clyde_aware lookahead ppo"


def _power(folder: Path) -> Values:
    """Return the rows of the same ghosts without power pellets and with four."""
    return [
        {**row, "ghosts": ghosts, "power_pellets": pellets}
        for ghosts in _GHOSTS
        for pellets in (0, 4)
        for row in _rows(f"compare {_POWER} --set power.pellets={pellets} --set clyde.ghosts={ghosts}", folder)
    ]


def _learned(*seeds: str) -> dict[str, list[str]]:
    """Return what the script of MaskablePPO prints about its rounds, for each seed."""
    script = [sys.executable, "docs/examples/clients/sb3_maskable_ppo.py", "--rounds", "400"]
    printed = {}
    for seed in seeds:
        command = [*script, *seed.split(), "--test", "generated:test", "house"]
        out = subprocess.run(command, cwd=ROOT, check=True, capture_output=True, text=True).stdout
        printed[seed] = [line for line in out.splitlines() if "rounds completed" in line or "difference" in line]
    return printed


def _league(maps: Sequence[str], folder: Path) -> dict[str, str]:
    """Write the league table; return the hash of its page."""
    words = f"compare {_SUITE} --map {' '.join(maps)} --workers 2 --resume --parts {folder} --markdown {_LEAGUE}"
    _written(words, "--json", ".json")
    _LEAGUE.write_text(_LEAGUE.read_text().replace(str(_SHARED), "../shared"))  # as a reader types it
    return league_hash()


def league_hash() -> dict[str, str]:
    """Return the hash of the page of the league table, which the command writes by itself."""
    return {"sha256": hashlib.sha256(_LEAGUE.read_bytes()).hexdigest()}


def _compare(command: str, minutes: float, inputs: tuple[str, ...] = _POLICIES) -> Measurement:
    words = command.replace("scripts/compare", "compare").removeprefix("pacman-env ")
    return Measurement(command, inputs, minutes, lambda folder: _rows(words, folder))


def _each_map(command: str, minutes: float) -> Measurement:
    words = command.removeprefix("pacman-env ")

    def measure(folder: Path) -> Values:
        return [
            row
            for name in REAL_MAPS
            for row in _rows(words.replace("MAP", f"../shared/maps/{name}/map.yaml"), folder / name)
        ]

    return Measurement(command, _POLICIES, minutes, measure)


def _text(command: str, minutes: float, inputs: tuple[str, ...]) -> Measurement:
    words = command.removeprefix("pacman-env ")
    return Measurement(command, inputs, minutes, lambda _: _written(words, "--markdown", ".md"))


def _rows(words: str, folder: Path) -> list[Mapping[str, Any]]:
    results = _json(f"{words} --workers 2 --resume --parts {folder}", "--json")
    kept: list[Mapping[str, Any]] = []
    for row in results["rows"]:
        kept.append({field: row[field] for field in _FIELDS if field in row} | {"ends": row["outcomes"]["end"]})
    return kept


def _json(words: str, option: str) -> Values:
    return json.loads(_written(words, option, ".json"))


def _written(words: str, option: str, suffix: str) -> str:
    """Run a command of ``pacman-env`` and return what it writes with an option."""
    arguments = [
        word.replace("../shared", str(_SHARED), 1) if word.startswith("../shared") else word for word in words.split()
    ]
    command = [sys.executable, "-m", "pacman_env.cli.main", *arguments]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, f"figure{suffix}")
        subprocess.run([*command, option, str(file)], cwd=ROOT, check=True)
        return file.read_text(encoding="utf-8")


def _recorded(file: Path) -> list[dict[str, str]]:
    """Return the rows of a recording that this machine may not be able to repeat."""
    with file.open(newline="", encoding="utf-8") as rows:
        return list(csv.DictReader(rows))
