"""On a robot, through nothing but what it is told, search makes the simulator's choices."""

import numpy as np
import pytest

from pacman_env.game.execution import RUNNING
from pacman_env.heuristics.search.search import Search
from pacman_env.sim.core.batch import GameBatch
from pacman_env.sim.maps.assets import map_assets
from tests.sim.coarse.games import config_of
from tests.sim.observation.test_robot_view import Robot


@pytest.mark.parametrize("behaviour", ["chase", "arcade"])
def test_robot_chooses_what_the_simulator_chooses(behaviour: str) -> None:
    config = config_of(behaviour)
    batch = GameBatch(map_assets("house", config), config)
    batch.reset(np.array([0]), np.array([1], dtype=np.uint64))
    robot = Robot(batch)
    simulators, robots = Search(nodes=1000), Search(nodes=1000)
    for policy in (simulators, robots):
        policy.reset(np.ones(1, np.bool_), config)
    ticks = 0
    while batch.games[0]["end"] == RUNNING and ticks < 80:
        expected, seen = batch.situation(), robot.situation()
        choice = simulators.select(expected)
        np.testing.assert_array_equal(robots.select(seen), choice)
        np.testing.assert_array_equal(robots.scores(seen), simulators.scores(expected))
        batch.step(choice)
        ticks += 1
    assert ticks == 80
    assert batch.games[0]["collected"] > 0
