"""Three constants of the rules, changed by ``settings`` alone, hold in the simulator and in the goal selector."""

from __future__ import annotations

import numpy as np
import pytest

from pacman_env.config import make_config, parse_settings
from pacman_env.game.execution import DEAD, SUCCEEDED
from tests.one_game import SimulatorSide
from tests.ros.selector_game import FAR_AWAY, QUICK, Game, number_at

PICKUP_M, DEATH_M, SUCCESS_M = 0.7, 0.2, 0.9  # at these distances something else happens than under the defaults
SETTINGS = ["execution.pickup_radius_m=0.8", "execution.death_radius_m=0.15", "execution.success_margin_m=0.8"]


def in_the_simulator(settings: list[str]) -> tuple[bool, bool, bool]:
    """Whether a pellet is collected, the robot caught, and a success counted at those distances."""
    config = make_config("robot", **parse_settings(settings))
    side = SimulatorSide(config, np.array([[0.0, 0.0], [5.0, 0.0], [9.0, 9.0]]), np.array([[3.0, 3.0]]))
    side.at(10, (PICKUP_M, 0.0))
    side.check()
    collected = not side.alive[0, 0]
    side.at(20, (5.0 + SUCCESS_M, 0.0))
    side.choose(1)
    side.accept()
    side.result(SUCCEEDED)
    counted = not side.alive[0, 1]
    side.at(30, (7.0, 7.0), ghost=(7.0 + DEATH_M, 7.0))
    side.check()
    return collected, side.seen()["end"] == DEAD, counted


def test_settings_change_rules_in_simulator() -> None:
    assert in_the_simulator([]) == (False, True, False)
    assert in_the_simulator(SETTINGS) == (True, False, True)


def test_settings_change_rules_in_goal_selector(game: Game) -> None:
    game.start(settings=[*QUICK, *SETTINGS])
    game.begin()
    first = game.running_goal(1)
    game.stand(first.x - PICKUP_M, first.y)
    game.status(f"pellet_collected:{number_at(first)}")

    second = game.running_goal(2)
    x = second.x + SUCCESS_M
    game.stand(x, second.y)
    game.condition(lambda c: c["pose"][0] == pytest.approx(x), "the pose")
    game.succeed(second)
    game.status(f"pellet_collected:{number_at(second)}")

    game.clyde(x + DEATH_M, second.y)
    game.condition(lambda c: c["clyde"][0] == pytest.approx(x + DEATH_M), "Clyde")
    assert "death_detected" not in game.statuses()
    game.clyde(*FAR_AWAY)
    game.session.advance(0.2)
    game.clyde(x + 0.1, second.y)
    game.status("death_detected")
