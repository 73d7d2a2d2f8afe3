"""Pursuits to begin a test with, and places to send them to."""

from __future__ import annotations

from dataclasses import dataclass

from pacman_env.config import make_config
from pacman_env.game.goal_executor import Action, Pursuit
from pacman_env.game.goals import Home

CONFIG = make_config("robot")


@dataclass(frozen=True)
class Spot:
    candidate: int
    x: float
    y: float
    pellet: int | None = None


NEAR, FAR = Spot(0, 1.0, 0.0, 10), Spot(1, 5.0, 0.0, 11)
REFUGE = Spot(2, 0.0, 3.0)
PELLETS = {10: (1.0, 0.0), 11: (5.0, 0.0)}


def words(actions: list[Action]) -> list[str]:
    """``send 1`` and the like."""
    return [f"{action.kind} {action.value}".strip() for action in actions]


def running(**options: float) -> Pursuit:
    """Enabled and running at t = 0, at the home pose, Nav2 there."""
    pursuit = Pursuit(CONFIG, Home(0.0, 0.0, 0.0), **options)  # type: ignore[arg-type]
    pursuit.activate(0.0)
    pursuit.nav2(True, 0.0)
    pursuit.command("enable", 0.0)
    pursuit.state("running", 0.0)
    pursuit.pellets(PELLETS, 0, 0.0)
    pursuit.look((0.0, 0.0), None, 0.0)
    return pursuit


def homing(pose: tuple[float, float] = (4.0, 0.0)) -> Pursuit:
    pursuit = running()
    pursuit.look(pose, None, 0.0)
    pursuit.command("disable", 1.0)
    pursuit.command("return_home", 1.0)
    return pursuit
