"""``pacman-env ros replay``: call a policy at each decision of a recorded game, with the robot's knowledge then.

The game continues as recorded, whatever the policy chooses."""

import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pacman_env.config import Config
from pacman_env.game.goals import goal_name
from pacman_env.levels.assets import map_assets
from pacman_env.policies.base import KIND_NAMES, Policy
from pacman_env.policies.policy_calls import choose, reset
from pacman_env.policies.registry import make_policy
from pacman_env.ros.bags.bag import BagError, open_bag
from pacman_env.ros.bags.bag_walk import Walk, recorded_config
from pacman_env.ros.bags.pose_statistics import QUANTITIES, simulated_statistics
from pacman_env.ros.supervisor.terminal import wrapped
from pacman_env.world.maps.occupancy import load_map

_LISTED = 20


@dataclass
class Otherwise:
    """Consecutive decisions in which the policy would have chosen another goal."""

    at_s: float  # time since the start of the bag
    decisions: int
    recorded: str
    chosen: str


@dataclass
class ReplayReport:
    """Result of a replay; times in s since the start of the bag."""

    bag: str
    namespace: str
    map: str
    policy: str
    duration_s: float
    rounds: int = 0
    statuses: dict[str, int] = field(default_factory=dict)
    bad_messages: dict[str, int] = field(default_factory=dict)
    unchecked: str = ""  # why the bag's messages may be damaged
    decisions: int = 0
    same: int = 0
    unknown: int = 0  # decisions without a recorded goal
    otherwise: list[Otherwise] = field(default_factory=list)
    decision_ms: list[float] = field(default_factory=list)  # median, 99 % quantile, maximum
    robot: dict[str, list[float] | None] = field(default_factory=dict)  # 10 %, 50 % and 90 % quantiles by quantity
    simulator: dict[str, list[float] | None] = field(default_factory=dict)

    def render(self) -> str:
        other = self.decisions - self.same - self.unknown
        same = f"{self.same} as recorded, {other} otherwise, {self.unknown} unknown"
        statuses = ", ".join(f"{count} {word}" for word, count in self.statuses.items()) or "no status"
        lines = [
            f"{self.bag}: {self.namespace or '/'}, {self.duration_s:.1f} s, rounds {self.rounds}, {statuses}",
            f"{self.policy} on {self.map}: {self.decisions} decisions, {same}",
        ]
        if self.unchecked:
            lines.append(self.unchecked)
        lines.append("decision: {:.2f} ms at 50 %, {:.2f} ms at 99 %, {:.2f} ms at most".format(*self.decision_ms))
        for one in self.otherwise[:_LISTED]:
            more = f", {one.decisions} times" if one.decisions > 1 else ""
            lines.append(f"{one.at_s:7.1f} s  {one.chosen} instead of {one.recorded}{more}")
        if len(self.otherwise) > _LISTED:
            lines.append(f"  and {len(self.otherwise) - _LISTED} more")
        lines += [f"  {count} bad messages: {what}" for what, count in self.bad_messages.items()]
        lines.append(f"{'median (10 % to 90 %)':29}{'robot':24}simulator")
        for name, words in QUANTITIES.items():
            sides = (side.get(name) for side in (self.robot, self.simulator))
            columns = ("-" if one is None else "{1:.3f} ({0:.3f} to {2:.3f})".format(*one) for one in sides)
            lines.append(f"{words:29}{{:24}}{{}}".format(*columns))
        return "\n".join(wrapped(line, 11) for line in lines)


def replay_bag(path: Path, map: str, policy: str, namespace: str | None = None) -> ReplayReport:
    occupancy, chooser = load_map(map), make_policy(policy)
    with open_bag(path, namespace) as bag:
        config = recorded_config(bag)
        assets = map_assets(occupancy, config)
        report = ReplayReport(str(path), bag.namespace, map, policy, bag.duration_s, unchecked=bag.unchecked)
        walk = Walk(bag, assets, config)
        elapsed_ms = _ask(chooser, config, walk, report)
    report.rounds, report.statuses, report.bad_messages = walk.rounds, dict(walk.statuses), dict(walk.bad_messages)
    if report.rounds == 0:
        raise BagError(f"{path}: no round was played in it")
    if report.decisions == 0:
        raise BagError(f"{path}: no decision can be made: it lacks poses, a ghost or pellets of map {map}")
    report.decision_ms = [float(q) for q in np.quantile(elapsed_ms, (0.5, 0.99, 1.0))]
    report.robot = walk.motion.quantiles()
    report.simulator = simulated_statistics(assets, config, make_policy(policy)).quantiles()
    return report


def _ask(policy: Policy, config: Config, walk: Walk, report: ReplayReport) -> list[float]:
    """Call the policy at each decision, report where its choice differs, and return the duration of each call, ms."""
    elapsed_ms: list[float] = []
    round, differs = 0, None
    for decision in walk.decisions():
        if decision.round != round:
            reset(policy, np.ones(1, dtype=np.bool_), config)
            round, differs = decision.round, None
        start_s = time.perf_counter()
        chosen = int(choose(policy, decision.situation)[0])
        elapsed_ms.append((time.perf_counter() - start_s) * 1e3)
        if decision.recorded is None:
            report.unknown += 1
        elif decision.recorded == chosen:
            report.same += 1
            differs = None
        else:
            before, differs = differs, (_name(walk, decision.recorded), _name(walk, chosen))
            if differs == before:
                report.otherwise[-1].decisions += 1
            else:
                report.otherwise.append(Otherwise(decision.at_s, 1, *differs))
    report.decisions = len(elapsed_ms)
    return elapsed_ms


def _name(walk: Walk, candidate: int) -> str:
    goal, pellet_ids = walk.view.goal(candidate), walk.view.assets.pellet_ids.tolist()
    return KIND_NAMES[2] if goal is None else f"{goal_name(pellet_ids, candidate)} at ({goal.x:.2f}, {goal.y:.2f})"
