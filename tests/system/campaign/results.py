"""The results of games: a row for each, and a table by what happened in them. ROS is not imported."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field

from pacman_env.ros.simulated_robot.sim_faults import FAULTS
from tests.system.campaign.schedule import (
    EVERY_NODE,
    GAMES_PER_SYSTEM,
    INTERFERENCES,
    LOSS,
    NODES,
    OUTAGES,
    Schedule,
    arena_of,
)

OUTCOMES = ("complete", "lost", "reset", "home failed", "never")
_WIDTH = 34  # of the names in the table


@dataclass
class Verdict:
    seed: int
    arena: str
    policy: str
    happened: list[str] = field(default_factory=list)  # kinds of faults, interferences and outages
    outcome: str = "never"
    robot_s: float = 0.0
    simulated_s: float = 0.0  # from menu to menu
    messages: int = 0  # that a node has handled in that time
    transcript: str = ""  # SHA-256 of them all, in order, with their simulated times
    violations: list[str] = field(default_factory=list)
    outages: list[tuple[str, str, str]] = field(default_factory=list)  # kind, node and how long in which state

    def line(self) -> str:
        faults = [kind for kind in self.happened if kind in FAULTS]
        faults += [" ".join(one) for one in self.outages]
        others = sum(kind in INTERFERENCES for kind in self.happened)
        return (
            f"{self.seed:5d} {self.arena:14} {self.policy:11} {self.outcome:11} {self.robot_s:6.0f}"
            f" {self.transcript[:8]:8} {', '.join(faults) or '-'}; {others} interferences"
        )


def verdict_on(plan: Schedule) -> Verdict:
    """That of a game that is yet to be played."""
    name, within_m = arena_of(plan.seed)
    return Verdict(plan.seed, name if math.isinf(within_m) else f"{name}, {within_m:g} m", plan.policy)


def table(verdicts: Sequence[Verdict]) -> list[str]:
    """Games by fault kind, as lines."""
    head = f"{'':{_WIDTH}} {'games':>6}" + "".join(f" {name:>11}" for name in OUTCOMES) + f" {'violations':>10}"
    rows = {"all games": list(verdicts), "nothing": [v for v in verdicts if not v.happened]}
    rows |= {kind: [v for v in verdicts if kind in v.happened] for kind in (*FAULTS, *INTERFERENCES, *OUTAGES)}
    rows |= {
        f"{kind} of {node}": [v for v in verdicts if any(one[:2] == (kind, node) for one in v.outages)]
        for kind, node in itertools.product(OUTAGES, (*NODES, EVERY_NODE))
        if kind == LOSS or node != EVERY_NODE
    }
    several = [v for v in verdicts if len(set(v.happened) & FAULTS.keys()) > 1]
    rows |= {"several faults": several}
    lines = [head]
    for name, games in rows.items():
        ends = "".join(f" {sum(v.outcome == how for v in games):11d}" for how in OUTCOMES)
        lines.append(f"{name:{_WIDTH}} {len(games):6d}{ends} {sum(len(v.violations) for v in games):10d}")
    return lines


def blocks(seeds: Sequence[int]) -> Iterator[list[int]]:
    """Seeds that are played by the same nodes, in order."""
    for _, block in itertools.groupby(sorted(set(seeds)), key=lambda seed: seed // GAMES_PER_SYSTEM):
        yield list(block)
