"""Threads share the games and nothing else; that their games are those of one: ``test_pacmanbot_vector.py``."""

import math
from typing import Any

import numpy as np
import pytest

from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv
from pacman_env.game.ghosts import Behaviour
from tests.envs.helpers import same

N = 14


def _homesick(view, parameters):  # type: ignore[no-untyped-def]
    if math.hypot(view.robot_x, view.robot_y) > parameters[0]:
        raise LookupError("the robot has gone")
    return view.robot_x, view.robot_y


HOMESICK = Behaviour("homesick", _homesick, (0.6,))


@pytest.mark.parametrize(
    ("threads", "ghosts"), [(1, [f"{__name__}:HOMESICK"]), (7, ["chase", "nearest", f"{__name__}:HOMESICK"])]
)
def test_error_of_ghost_function_is_raised(threads: int, ghosts: list[Any]) -> None:
    settings = {"clyde.speed_mps": 0.0, "execution.death_radius_m": 1e-6}
    env, fresh = (PacManBotVectorEnv(N, num_threads=n, ghosts=ghosts, settings=settings) for n in (threads, 1))
    env.reset(seed=0)
    chosen = np.full(N, env.batch.hold)
    chosen[9] = np.where(env.situation.mask[9], env.situation.path_robot[9], 0.0).argmax()  # one robot leaves home

    def step_often() -> None:
        for _ in range(60):
            env.step(chosen)

    with pytest.raises(LookupError, match="the robot has gone"):
        step_often()
    assert same(env.reset(seed=4), fresh.reset(seed=4))
    for _ in range(5):
        assert same(env.step(np.full(N, env.batch.hold)), fresh.step(np.full(N, env.batch.hold)))


def test_threads_do_not_outnumber_games() -> None:
    assert [PacManBotVectorEnv(n, num_threads=7).batch.threads.number for n in (1, 3, 9)] == [1, 3, 7]
    assert PacManBotVectorEnv(1, num_threads=0).batch.threads.number == 1
