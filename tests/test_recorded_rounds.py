"""Rounds of the simulator, event by event again on the robot's side: the same games."""

import os
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pacman_env.config import Config, make_config
from pacman_env.game.ends import CAUGHT, COMPLETE, RUNNING, TIMEOUT
from pacman_env.levels.assets import map_assets
from pacman_env.observations.situation_writer import situation_of
from pacman_env.policies.registry import make_policy
from pacman_env.sim.batch import GameBatch
from pacman_env.world.navigation.navigator import ABORTED, SUCCEEDED
from tests.one_game import RobotSide
from tests.physics_steps import watch
from tests.test_one_game import EXACT, STEP_S

#: Of each policy; 500 take some minutes.
ROUNDS = int(os.environ.get("PACMAN_ENV_ROUNDS", "40"))


class Recorded:
    """What happened in N simulated games, by game: a list of events in order.

    What is pursued after an event is None where another event came before the next physics step.
    """

    def __init__(self, batch: GameBatch) -> None:
        self.batch, self.events = batch, [[] for _ in range(batch.n)]  # type: list[Any]
        self._check_steps = round(batch.config.execution.check_period_s / STEP_S)
        watch(batch, self._look)
        self._play = batch._play
        batch._play = self._record_tick  # type: ignore[method-assign]

    def _record_tick(self) -> None:
        self._substep = 0
        self._remember()
        self._play()
        for i in self._running:
            if self.batch.games["tick"][i] > self._before["tick"][i]:
                g = self.batch.games[i]
                self._note(i, (int(g["step"]), "check", None), self.batch.obstacles[i], int(g["pursued"]))

    def _remember(self) -> None:
        self._before, self._ghosts = self.batch.games.copy(), self.batch.obstacles.copy()
        self._running = np.flatnonzero(self._before["end"] == RUNNING).tolist()

    def _look(self) -> None:
        k = self._substep
        for i in self._running:
            before, after = self._before[i], self.batch.games[i]
            moved = after["step"] > before["step"]
            if not moved and after["end"] == RUNNING:
                continue  # asleep
            ended = int(after["nav_last"]) if moved and after["nav_last_step"] == before["step"] else 0
            ended = ended if ended in (SUCCEEDED, ABORTED) else 0
            step, pursued = int(before["step"]), None if ended else int(after["pursued"])
            if k == 0:
                self._note(i, (step, "choose", int(self.batch.arrays["choices"][i])), self._ghosts[i], pursued)
            elif k % self._check_steps == 0:
                self._note(i, (step, "check", None), self._ghosts[i], pursued)
            if ended:
                result = ended, bool(after["nav_next"] >= 0)
                self._note(i, (step + 1, "result", result), self.batch.obstacles[i], int(after["pursued"]))
        self._remember()
        self._substep += 1

    def _note(self, i: int, event: tuple[Any, ...], ghosts: NDArray[np.float64], pursued: int | None) -> None:
        g = self.batch.games[i]
        pose = float(g["x"] + g["error_x"]), float(g["y"] + g["error_y"])
        if self.batch.config.execution.pose_source == "amcl" and event[1] != "result":
            pose = float(g["amcl_x"]), float(g["amcl_y"])
        self.events[i].append((*event, [(float(x), float(y)) for x, y, *_ in ghosts], pose, pursued))


def play_again(events: list[Any], config: Config, batch: GameBatch) -> RobotSide:
    """One recorded round on the robot's side, compared at every event."""
    assets = batch.assets
    power = np.flatnonzero(assets.power_pellets(config.power.pellets)).tolist()
    robot = RobotSide(config, assets.goal_xy[: assets.pellets], assets.goal_xy[assets.pellets :], power)
    zero = robot.now
    for step, kind, value, ghosts, at, pursued in events:
        robot.now = zero + step * STEP_S
        if kind == "choose":
            robot.executor.pose = at
            masked = value != batch.hold and (value in robot.executor.round.masked(robot.now))
            taken = value < assets.pellets and value not in robot.executor.round.left
            assert robot.choose(batch.hold if masked or taken else value)
            if robot.unanswered:
                robot.accept(robot.unanswered[-1])
        elif kind == "result":
            status, old = value
            numbers = [number for number in robot.live if number != robot.executor.sent.current] if old else robot.live
            if numbers:
                robot.finish(numbers[-1], status, at)
        else:
            robot.check(at, ghosts)
        if robot.end == RUNNING and pursued is not None:
            assert robot.executor.sent.pursued == pursued, (step, kind, value)
    return robot


@pytest.mark.parametrize(
    ("policy", "ghosts", "power"),
    [("clyde_aware", ("wander",), 0), ("nearest", ("arcade", "wander"), 0), ("nearest", ("chase", "wander"), 9)],
)
def test_robot_replays_recorded_rounds_as_same_games(policy: str, ghosts: tuple[str, ...], power: int) -> None:
    changes = {**EXACT, "clyde.ghosts": ghosts, "localization.perfect": False, "time_limit_s": 200.0}
    changes |= {"power.pellets": power, "power.speed_factor": 0.2}
    config = make_config("robot", **changes, **{"nav2.abort_rate": 0.05})
    n = ROUNDS
    batch = GameBatch(map_assets("house", config), config, n)
    chooser = make_policy(policy)
    chooser.reset(np.ones(n, np.bool_), config)
    recorded = Recorded(batch)
    batch.reset(np.arange(n), np.arange(n, dtype=np.uint64))
    while (batch.games["end"] == RUNNING).any():
        batch.step(chooser.select(situation_of(batch)))
    ends, caught = set(), 0
    for i, events in enumerate(recorded.events):
        robot, game = play_again(events, config, batch), batch.games[i]
        end = int(game["end"])
        ends.add(end)
        assert robot.end == (RUNNING if end == TIMEOUT else end), i
        assert sorted(robot.executor.round.left) == np.flatnonzero(batch.alive[i]).tolist()
        assert (robot.referee.score if end == TIMEOUT else robot.score) == game["score"]
        assert robot.referee.ghosts_caught == game["caught"]
        caught += game["caught"]
    assert {CAUGHT, COMPLETE} <= ends
    assert (caught > 0) == (power > 0)
