"""Rounds that the tests of the comparison share: few, on a shipped map, with the time limit kept short."""

import functools
import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pacman_env.config import Config, make_config
from pacman_env.episodes.rollout import EPISODE, episode_seeds, play
from pacman_env.evaluation.compare.__main__ import main
from pacman_env.evaluation.rounds.scenarios import Levels, Scenario, open_scenario
from pacman_env.game.ends import CAUGHT, CLEARED, COMPLETE, TIMEOUT
from pacman_env.policies.learned import PRETRAINED
from pacman_env.world.maps.occupancy import load_map

#: Two houses, each with room for a few rounds.
LEVELS = Levels("test", count=2)
LEVELS_CONFIG = make_config("robot", "robust", time_limit_s=40.0)
ENDLESS = make_config(
    "robot_0_15",
    "robust",
    **{"pellets.spacing_m": 3.0, "time_limit_s": 60.0, "endless": True, "execution.pickup_radius_m": 2.0},
)
CONFIG = make_config("robot", "as_built", **{"pellets.spacing_m": 3.0, "time_limit_s": 120.0})


@functools.cache
def played(policy: str, episodes: int = 12, batch_size: int = 64) -> tuple[NDArray, NDArray[np.float64]]:
    return play(open_scenario("house", CONFIG), CONFIG, policy, episode_seeds(5, episodes), batch_size=batch_size)


@functools.cache
def played_on(scenario: Scenario, config: Config, policy: str, batch_size: int = 64) -> NDArray:
    return play(open_scenario(scenario, config), config, policy, episode_seeds(5, 8), batch_size=batch_size)[0]


def played_on_levels(policy: str, batch_size: int = 64) -> NDArray:
    return played_on(LEVELS, LEVELS_CONFIG, policy, batch_size)


def played_endless(policy: str, batch_size: int = 64) -> NDArray:
    return played_on("house", ENDLESS, policy, batch_size)


def comparison(json_file: Path, *arguments: str) -> dict[str, Any]:
    """Return the file of a comparison of few, short rounds, without decision times and without its own name."""
    assert main(["--episodes", "8", "--spacing", "3", "--time-limit", "120", "--json", str(json_file), *arguments]) == 0
    return without_times(json_file)


def without_times(json_file: Path) -> dict[str, Any]:
    """Return the content of a comparison's file without decision times and without its own name."""
    result: dict[str, Any] = json.loads(json_file.read_text())
    result["rows"] = [{k: v for k, v in row.items() if not k.startswith("decision")} for row in result["rows"]]
    del result["arguments"]["json"]
    return result


def copy_planners(folder: Path) -> tuple[str, str]:
    """Copy the planners of robot and ghost, and a map, mine.yaml; return the planners' files."""
    load_map("loop").save(folder / "mine.yaml")
    for path, name in ((PRETRAINED, "own"), (PRETRAINED.with_name("clyde.onnx"), "ghost")):
        for suffix in (".onnx", ".json"):
            shutil.copy(path.with_suffix(suffix), folder / f"{name}{suffix}")
    return str(folder / "own.onnx"), str(folder / "ghost.onnx")


def records(ends: list[int], collected: list[int], spawned: int = 8) -> NDArray:
    """Records written by hand: 10 s, 20 s, ... long."""
    out = np.zeros(len(ends), dtype=EPISODE)
    out["seed"] = np.arange(len(ends))
    out["end"], out["collected"], out["spawned"] = ends, collected, spawned
    out["time_s"] = 10.0 * np.arange(1, len(ends) + 1)
    return out


FIVE = records([COMPLETE, COMPLETE, CLEARED, CAUGHT, TIMEOUT], [8, 8, 7, 2, 0])
OTHER_FIVE = records([COMPLETE, CAUGHT, CAUGHT, CAUGHT, CAUGHT], [8, 1, 1, 1, 1])
