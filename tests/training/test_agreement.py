"""Torch, the exported file and the policy agree on situations met in games, of which there are ten thousand."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch")
pytest.importorskip("onnx")

import torch

from pacman_env.config import make_config
from pacman_env.game.execution import RUNNING
from pacman_env.policies.learned import LearnedPlanner
from pacman_env.sim.core.batch import GameBatch
from pacman_env.sim.maps.assets import map_assets
from pacman_env.sim.maps.level_source import GeneratedMaps
from pacman_env.sim.observation.planner_features import planner_features
from pacman_env.sim.observation.situation import Situation
from pacman_env.training.checkpoint import TorchPlanner
from tests.training.planners import FACTS, plain, random_network, random_planner

GAMES, TICKS, LOOKS = 100, 200, 50  # 100 games, looked at 50 times within 100 s, in each of two places
CONFIG = make_config()


def met(source: str) -> list[Situation]:
    """Situations of games in which goals are chosen at random, each for a while."""
    batch = GameBatch(
        GeneratedMaps(CONFIG, 0, 8) if source == "generated" else map_assets(source, CONFIG), CONFIG, GAMES
    )
    rng = np.random.default_rng(0)
    batch.reset(np.arange(GAMES), rng.integers(2**63, size=GAMES, dtype=np.uint64))
    situations = []
    for tick in range(TICKS):
        if tick % 10 == 0:
            choices = rng.integers(batch.candidates, size=GAMES)
        if tick % (TICKS // LOOKS) == 0:
            situations.append(batch.situation())
        batch.step(choices)
        ended = np.flatnonzero(batch.games["end"] != RUNNING)
        batch.reset(ended, rng.integers(2**63, size=len(ended), dtype=np.uint64))
    return situations


@pytest.mark.parametrize("source", ["house", "generated"])
def test_torch_and_exported_planner_agree_on_5000_situations(source: str, tmp_path: Path) -> None:
    network = random_network(3)
    planner = LearnedPlanner(random_planner(tmp_path, seed=3))
    in_torch = TorchPlanner("mine", network, FACTS.robot_speed_mps)
    situations = met(source)
    assert sum(map(len, situations)) == 5000
    spread = []
    for situation in situations:
        features = planner_features(situation, FACTS.robot_speed_mps)
        logits, values = planner.run(*features, situation.mask)
        tensors = [torch.tensor(array) for array in (*features, situation.mask)]
        for judge in (partial(plain, network), network):
            with torch.no_grad():
                expected = judge(*tensors)
            np.testing.assert_allclose(logits, expected[0].numpy(), atol=1e-5, rtol=1e-6)
            np.testing.assert_allclose(values, expected[1].numpy(), atol=1e-5, rtol=1e-6)
        scores = planner.scores(situation)
        np.testing.assert_allclose(scores, np.where(situation.mask, logits, -np.inf), atol=1e-5)
        np.testing.assert_allclose(scores, in_torch.scores(situation), atol=1e-5)
        spread.append(np.ptp(logits[situation.mask]))
    assert np.median(spread) > 0.1  # they are told apart
