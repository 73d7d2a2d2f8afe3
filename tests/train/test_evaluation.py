"""Rounds of a network in training are those of the comparison, whatever the batch they are played in."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("sb3_contrib")
pytest.importorskip("onnx")

from eval.episodes import episode_seeds, play
from pacman_env.config import make_config
from pacman_env.policies.registry import make_policy
from pacman_env.sim.assets import map_assets
from pacman_env.sim.generated import GeneratedMaps
from pacman_env.sim.records import COMPLETE
from pacman_env.sim.sources import FixedMap
from tests.envs.helpers import QUICK
from tests.train.planners import random_network
from tests.train.test_arguments import tiny
from train.checkpoint import TorchPlanner
from train.evaluation import completed
from train.games import VALIDATION_LEVEL, game_config

CONFIG = make_config(**{**QUICK, "time_limit_s": 60.0})


def test_rounds_are_those_of_the_comparison_beyond_one_batch_too() -> None:
    assets, seeds = map_assets("house", CONFIG), episode_seeds(0, 150)
    records, _ = play(assets, CONFIG, "nearest", seeds)
    found = completed(make_policy("nearest"), FixedMap(assets, CONFIG), CONFIG, seeds)
    np.testing.assert_array_equal(found, records["end"] == COMPLETE)
    assert 0 < found.sum() < 150


def test_a_rounds_result_is_its_seeds_alone() -> None:
    config = game_config(tiny())
    planner = TorchPlanner("mine", random_network(1, width=8), config.robot.speed_mps)
    seeds = episode_seeds(3, 12)
    results = [
        completed(planner, GeneratedMaps(config, VALIDATION_LEVEL, 8), config, some)
        for some in (seeds, seeds[::-1].copy(), seeds[:5])
    ]
    np.testing.assert_array_equal(results[0], results[1][::-1])
    np.testing.assert_array_equal(results[0][:5], results[2])
