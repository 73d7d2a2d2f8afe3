"""The rule keeps what every policy promises, waits when it must, and wins more rounds than the scorer."""

from dataclasses import replace

import numpy as np
import pytest

from pacman_env.config import make_config
from pacman_env.episodes.rollout import episode_seeds, play
from pacman_env.game.ends import COMPLETE, RUNNING
from pacman_env.heuristics.lookahead import Lookahead
from pacman_env.levels.assets import map_assets
from pacman_env.observations.prediction import CAUGHT, encounters
from pacman_env.observations.situation import PELLET
from pacman_env.observations.situation_writer import situation_of
from pacman_env.sim.batch import GameBatch


def test_robot_speed_defaults_to_the_games() -> None:
    batch, fast = started(1), make_config(**{"robot.speed_mps": 0.3})
    situation, policy = situation_of(batch), Lookahead()
    policy.reset(np.ones(1, np.bool_), fast)
    np.testing.assert_array_equal(policy.scores(situation), Lookahead(robot_speed_mps=0.3).scores(situation))
    assert not np.array_equal(policy.scores(situation), Lookahead().scores(situation))


def started(n: int = 20, name: str = "loop", clyde_mps: float = 0.25) -> GameBatch:
    config = make_config("robot_0_15", **{"clyde.speed_mps": clyde_mps})
    batch = GameBatch(map_assets(name, config), config, n)
    batch.reset(np.arange(n), np.arange(n, dtype=np.uint64))
    return batch


def test_nearest_pellet_is_goal_without_danger() -> None:
    situation = situation_of(started())
    calm = replace(situation, clyde_speed=np.zeros(20), clyde=np.full((20, 2), 1e3))
    nearest = np.where(situation.kind == PELLET, situation.path_robot, np.inf).argmin(axis=1)
    np.testing.assert_array_equal(Lookahead().select(calm), nearest)
    pellets = situation.kind == PELLET
    far = replace(calm, path_robot=np.where(pellets, situation.path_robot + 60.0, 1.0))
    assert pellets[np.arange(20), Lookahead().select(far)].all()


def test_lookahead_waits_when_every_pellet_is_deadly() -> None:
    batch, brave = started(60, "house", 0.5), Lookahead(caught_soon_s=0.0, caught_s=0.0, approached_s=0.0)
    for _ in range(40):
        batch.step(brave.select(situation_of(batch)))
    situation = situation_of(batch)
    caught = encounters(situation, 0.256)[:, :, CAUGHT]
    pellets = situation.kind == PELLET
    deadly = replace(situation, mask=situation.mask & (~pellets | (caught > 0.5)))
    safe = np.where(deadly.mask & ~pellets, caught, 1.0).min(axis=1) < 0.1
    some = np.flatnonzero(safe & (deadly.mask & pellets).any(axis=1) & (batch.games["end"] == RUNNING))
    assert len(some) > 5
    assert not pellets[some, Lookahead().select(deadly)[some]].any()
    assert pellets[some, brave.select(deadly)[some]].all()


def test_pursued_goal_is_kept_within_the_margin() -> None:
    situation = situation_of(started())
    scores = Lookahead(keep_s=0.0).scores(situation)
    second = np.argsort(scores, axis=1)[:, -2]
    gap = np.sort(scores, axis=1)[:, -1] - np.sort(scores, axis=1)[:, -2]
    chosen = Lookahead(keep_s=2.0).select(replace(situation, current=second))
    np.testing.assert_array_equal((chosen == second)[np.abs(gap - 2.0) > 1e-6], (gap < 2.0)[np.abs(gap - 2.0) > 1e-6])


def test_lookahead_completes_more_rounds_than_clyde_aware() -> None:
    config = make_config(time_limit_s=400.0)
    assets, seeds = map_assets("loop", config), episode_seeds(1, 48)
    wins = [
        (play(assets, config, policy, seeds)[0]["end"] == COMPLETE).sum() for policy in ("lookahead", "clyde_aware")
    ]
    assert wins[0] >= wins[1] + 5


@pytest.mark.parametrize("parameters", [{"robot_speed_mps": 0.0}, {"wait_s": -1.0}, {"keep_s": float("nan")}])
def test_parameters_out_of_range_are_named(parameters: dict[str, float]) -> None:
    with pytest.raises(ValueError, match=next(iter(parameters))):
        Lookahead(**parameters)
