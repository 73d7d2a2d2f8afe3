"""The simulator and the robot play by the same rules: the same events lead to the same game on both sides."""

import os

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pacman_env.config import make_config
from pacman_env.game.ends import RUNNING
from pacman_env.game.execution import ABORTED, CANCELED, REJECTED, SUCCEEDED
from tests.one_game import RobotSide, SimulatorSide

#: Of each execution; 5,000 take some minutes.
TRACES = int(os.environ.get("PACMAN_ENV_TRACES", "200"))
STEP_S = 0.0625  # exact in binary, so that both sides' times are the same numbers
EXACT = {
    "physics_step_s": STEP_S,
    "clyde.update_period_s": 0.25,
    "localization.scan_period_s": 0.125,
    "localization.perfect": True,
}
PELLETS = np.array([(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)])
REFUGES = np.array([(0.0, 3.0), (2.0, 3.0)])
HOLD = len(PELLETS) + len(REFUGES)
PLACES: list[tuple[float, float]] = [*map(tuple, PELLETS.tolist()), *map(tuple, REFUGES.tolist()), (1.0, 1.5)]
#: By a byte of a trace: what happens.
EVENTS = ("choose", "choose", "choose", "accept", "end", "reject", "stale", "check", "check", "wait", "report", "reset")
WAITS = (1, 4, 8, 16, 40, 100)  # steps


class Trace:
    """Both sides, stepped together and compared after every event."""

    def __init__(self, execution: str, power: int) -> None:
        config = make_config("robot", execution, **EXACT, **{"power.pellets": power, "power.duration_s": 8.0})
        self.config = config
        self.simulator = SimulatorSide(config, PELLETS, REFUGES)
        self.robot = RobotSide(config, PELLETS, REFUGES, self.simulator.power)
        self.zero = self.robot.now
        self.step = 0
        self.old: list[int] = []

    def play(self, codes: bytes) -> None:
        pairs = zip(codes[::2], codes[1::2], strict=False)
        for event, value in pairs:
            self.simulator.at(self.step, PLACES[value % len(PLACES)])
            self.robot.now = self.zero + self.step * STEP_S
            name = EVENTS[event % len(EVENTS)]
            if self.robot.end == RUNNING or name == "reset":
                getattr(self, name)(value)
                self.compare(f"{name} {value}")

    def compare(self, what: str) -> None:
        simulator, robot = self.simulator.seen(), self.robot.seen()
        assert simulator == robot, f"after {what} at step {self.step}"

    # Events

    def choose(self, value: int) -> None:
        candidate = value % (HOLD + 1)
        if candidate in self.robot.executor.round.masked(self.robot.now) or candidate not in self.allowed():
            return
        self.robot.look_at(PLACES[value // 16 % len(PLACES)])
        self.simulator.at(self.step, PLACES[value // 16 % len(PLACES)])
        if self.robot.choose(candidate):
            self.simulator.choose(candidate)

    def allowed(self) -> set[int]:
        left = set(self.simulator.seen()["left"])
        return {c for c in range(HOLD + 1) if c >= len(PELLETS) or c in left}

    def accept(self, value: int) -> None:
        """An answer, early or late, to the goal sent last."""
        if self.robot.unanswered:
            number = self.robot.unanswered[-1]
            wanted = not self.robot.let_go(number)
            self.robot.accept(number)
            self.simulator.accept() if wanted else self.simulator.pre_empt()

    def end(self, value: int) -> None:
        """Of the goal that Nav2 drives to."""
        number = self.robot.driven()
        if number is None:
            return
        status = (SUCCEEDED, SUCCEEDED, ABORTED, CANCELED)[value // 16 % 4]
        if int(self.simulator.game["nav_goal"][0]) >= 0:
            self.simulator.result(status)
        self.old.append(number)
        self.robot.executor.pose = PLACES[value % len(PLACES)]
        self.robot.finish(number, status, PLACES[value % len(PLACES)])

    def reject(self, value: int) -> None:
        if self.robot.unanswered:
            number = self.robot.unanswered[-1]
            wanted = not self.robot.let_go(number)
            self.robot.reject(number)
            self.old.append(number)
            if wanted and int(self.simulator.game["nav_next"][0]) >= 0:
                self.simulator.result(REJECTED)

    def stale(self, value: int) -> None:
        """An answer twice, or about a goal that nobody ever sent."""
        number = (self.old or [999])[value % len(self.old or [0])]
        {0: self.robot.accept, 1: self.robot.reject}.get(value % 3, self._end_again)(number)

    def _end_again(self, number: int) -> None:
        self.robot.finish(number, SUCCEEDED, PLACES[0])

    def check(self, value: int) -> None:
        pose, ghost = PLACES[value % len(PLACES)], PLACES[value // 16 % len(PLACES)]
        ghost = ghost if value & 1 else (99.0, 99.0)
        self.simulator.at(self.step, pose, ghost)
        self.time_out()
        self.simulator.check()
        self.robot.check(pose, [ghost])

    def time_out(self) -> None:
        """A goal without an answer is given up by the next look."""
        if self.robot.gives_up() and int(self.simulator.game["nav_next"][0]) >= 0:
            self.simulator.result(REJECTED)

    def wait(self, value: int) -> None:
        self.step += WAITS[value % len(WAITS)]
        self.simulator.at(self.step, PLACES[-1])
        self.robot.now = self.zero + self.step * STEP_S
        self.time_out()
        self.robot.look_at(PLACES[-1])

    def report(self, value: int) -> None:
        self.robot.report()

    def reset(self, value: int) -> None:
        self.old.clear()
        self.robot.reset()
        self.simulator.reset()
        self.zero, self.step = self.robot.now, 0


@pytest.mark.parametrize("power", [0, 1, 2])
@pytest.mark.parametrize("execution", ["robust", "as_built"])
@settings(max_examples=TRACES, deadline=None)
@given(codes=st.binary(min_size=20, max_size=80))
def test_simulator_and_robot_agree_on_any_event_trace(execution: str, power: int, codes: bytes) -> None:
    Trace(execution, power).play(codes)
