"""Rounds of the simulator, event by event again on the robot's side: the same games."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pacman_env.config import make_config
from pacman_env.game.execution import COMPLETE, DEAD, RUNNING, TIMEOUT
from pacman_env.policies.registry import make_policy
from pacman_env.sim.core import kernels
from pacman_env.sim.core.batch import GameBatch
from pacman_env.sim.maps.assets import map_assets
from tests.one_game import RobotSide
from tests.test_one_game import EXACT, STEP_S

#: Of each policy; 500 take some minutes.
ROUNDS = int(os.environ.get("PACMAN_ENV_ROUNDS", "40"))


class Recorded:
    """What happened in N simulated games, by game: a list of events in order."""

    def __init__(self, batch: GameBatch, patch: pytest.MonkeyPatch) -> None:
        self.batch, self.events = batch, [[] for _ in range(batch.n)]  # type: list[Any]
        for name in ("decide", "apply_results", "check", "finish"):
            patch.setattr(kernels, name, self._wrap(name, getattr(kernels, name)))

    def _wrap(self, name: str, run: Any) -> Any:
        def wrapped(games: NDArray[Any], *rest: Any) -> Any:
            before = games.copy()
            result = run(games, *rest)
            for i in np.flatnonzero(before["end"] == RUNNING).tolist():
                self._note(name, i, before[i], games[i], rest)
            return result

        return wrapped

    def _note(self, name: str, i: int, before: Any, after: Any, rest: tuple[Any, ...]) -> None:
        step, pose = int(after["step"]), (float(after["x"] + after["error_x"]), float(after["y"] + after["error_y"]))
        pursued = int(after["pursued"])
        if name == "decide":
            self.events[i].append((step, "choose", int(rest[0][i]), pose, pursued))
        elif name == "apply_results":
            if before["nav_result"]:
                old = bool(before["nav_next"] >= 0)
                self.events[i].append((step, "result", (int(before["nav_result"]), old), pose, pursued))
        else:
            ghosts = [(float(x), float(y)) for x, y, _ in self.batch.obstacles[i]]
            self.events[i].append((step, "look", ghosts, pose, pursued))


def play_again(events: list[Any], config: Any, batch: GameBatch) -> RobotSide:
    """One recorded round on the robot's side, compared at every event."""
    assets = batch.assets
    robot = RobotSide(config, assets.goal_xy[: assets.pellets], assets.goal_xy[assets.pellets :])
    zero = robot.now
    for step, kind, value, at, pursued in events:
        robot.now = zero + step * STEP_S
        if kind == "choose":
            robot.executor.pose = at
            masked = value != batch.hold and (value in robot.executor.masked(robot.now))
            taken = value < assets.pellets and value not in robot.executor.left
            assert robot.choose(batch.hold if masked or taken else value)
            if robot.unanswered:
                robot.accept(robot.unanswered[-1])
        elif kind == "result":
            status, old = value
            numbers = [number for number in robot.live if number != robot.executor._current] if old else robot.live
            if numbers:
                robot.finish(numbers[-1], status, at)
        else:
            robot.look(at, value)
        if robot.end == RUNNING:
            assert robot.executor.pursued == pursued, (step, kind, value)
    return robot


@pytest.mark.parametrize(("policy", "ghosts"), [("clyde_aware", ("wander",)), ("nearest", ("arcade", "wander"))])
def test_recorded_rounds_are_the_same_games_on_the_robots_side(policy: str, ghosts: tuple[str, ...]) -> None:
    changes = {**EXACT, "clyde.ghosts": ghosts, "localization.perfect": False, "time_limit_s": 200.0}
    config = make_config("robot", **changes, **{"nav2.abort_rate": 0.05})
    n = ROUNDS
    batch = GameBatch(map_assets("house", config), config, n)
    chooser = make_policy(policy)
    chooser.reset(np.ones(n, np.bool_))
    with pytest.MonkeyPatch.context() as patch:
        recorded = Recorded(batch, patch)
        batch.reset(np.arange(n), np.arange(n, dtype=np.uint64))
        while (batch.games["end"] == RUNNING).any():
            batch.step(chooser.select(batch.situation()))
    ends = set()
    for i, events in enumerate(recorded.events):
        robot, game = play_again(events, config, batch), batch.games[i]
        end = int(game["end"])
        ends.add(end)
        assert robot.end == (RUNNING if end == TIMEOUT else end), i
        assert sorted(robot.executor.left) == np.flatnonzero(batch.alive[i]).tolist()
        assert (robot.referee.score if end == TIMEOUT else robot.score) == game["score"]
    assert {DEAD, COMPLETE} <= ends
