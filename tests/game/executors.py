"""GoalExecutors to begin a test with, and places to send them to."""

from collections.abc import Iterable
from typing import Any

from pacman_env.config import make_config
from pacman_env.game.goal_executor import GoalExecutor
from pacman_env.game.goals import ExecutorAction, Goals, Place, home_place

CONFIG = make_config("robot")


NEAR, FAR = Place(0, 1.0, 0.0, 10), Place(1, 5.0, 0.0, 11)
AWAY = (9.0, 9.0)  # of a ghost
REFUGE = Place(2, 0.0, 3.0)
PELLETS = {10: (1.0, 0.0), 11: (5.0, 0.0)}


def words(actions: list[ExecutorAction]) -> list[str]:
    """``send 1`` and the like."""
    return [f"{action.kind} {action.value}".strip() for action in actions]


GOALS = Goals(PELLETS, {}, [(0.0, 3.0)])


POWER_GOALS = Goals(PELLETS, {}, [(0.0, 3.0)], power=(10,))


def make_executor(home: Place, min_dwell_s: float = 1.0, goals: Goals = GOALS) -> GoalExecutor:
    settings = {"execution.min_dwell_s": min_dwell_s, "power.pellets": int(goals.power.sum())}
    config = CONFIG.with_fields(**settings)
    return GoalExecutor(config, goals, home)


def running(goals: Goals = GOALS, shown: Iterable[int] | None = None, **options: Any) -> GoalExecutor:
    """Enabled and running at t = 0, at the home pose, Nav2 there."""
    executor = make_executor(home_place(0.0, 0.0, 0.0), goals=goals, **options)
    executor.activate(0.0)
    executor.nav2(True, 0.0)
    executor.command("enable", 0.0)
    executor.state("running", 0.0)
    executor.round.report(goals.positions if shown is None else shown, 0)
    executor.check((0.0, 0.0), (), 0.0)
    return executor


def frightening() -> GoalExecutor:
    """One that has collected a power pellet at t = 1: ghosts are frightened for 20 s."""
    executor = running(goals=POWER_GOALS)
    assert words(executor.check((1.0, 0.0), [AWAY, AWAY], 1.0)) == ["status pellet_collected:10", "remove 10"]
    return executor


def driving() -> GoalExecutor:
    """On its way to the near pellet: goal 1, sent at t = 0 and accepted at 0.1 s."""
    executor = running()
    assert words(executor.choose(NEAR, 0.0)) == ["send 1"]
    assert executor.sent.accepted(1, 0.1) == []
    return executor


def homing(pose: tuple[float, float] = (4.0, 0.0)) -> GoalExecutor:
    executor = running()
    executor.check(pose, (), 0.0)
    executor.command("disable", 1.0)
    executor.command("return_home", 1.0)
    return executor


def driving_home() -> GoalExecutor:
    """On its way home: goal 1, sent at 1.1 s and accepted at 1.2 s."""
    executor = homing()
    executor.state("returning_home", 1.1)
    executor.sent.accepted(1, 1.2)
    return executor
