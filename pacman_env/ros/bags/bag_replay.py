"""``pacman-env ros replay``: call a policy at each decision of a recorded game, with the robot's knowledge then.

The game continues as recorded, whatever the policy chooses."""

import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from pacman_env.config import Config
from pacman_env.game.goals import goal_name
from pacman_env.levels.assets import MapAssets, map_assets
from pacman_env.observations.robot_view import RobotView
from pacman_env.observations.situation import Situation
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
    decision_ms: list[float] | None = None  # median, 99 % quantile, maximum
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
        if self.decision_ms:
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
        replay = _Replay(assets, config, chooser, report)
        walk = Walk(bag, assets, config, replay)
        replay.view = walk.view
        walk.run()
    report.rounds, report.bad_messages = walk.rounds, walk.bad_messages
    report.robot = walk.motion.quantiles()
    replay.finish()
    report.simulator = simulated_statistics(assets, config, make_policy(policy)).quantiles()
    return report


class _Replay:
    """Call the policy at each decision, and note where its choice differs."""

    view: RobotView

    def __init__(self, assets: MapAssets, config: Config, policy: Policy, report: ReplayReport) -> None:
        self._assets, self._config, self._policy, self._report = assets, config, policy, report
        self._elapsed_ms: list[float] = []
        self._differs: tuple[str, str] | None = None

    def begin(self, at_s: float) -> None:
        reset(self._policy, np.ones(1, dtype=np.bool_), self._config)
        self._differs = None

    def report(self, at_s: float, status: str) -> None:
        statuses, word = self._report.statuses, status.partition(":")[0]
        statuses[word] = statuses.get(word, 0) + 1

    def end(self, at_s: float, state: str, situation: Situation | None) -> None:
        pass

    def decide(self, at_s: float, situation: Situation, recorded: int | None) -> None:
        start_s = time.perf_counter()
        chosen = int(choose(self._policy, situation)[0])
        self._elapsed_ms.append((time.perf_counter() - start_s) * 1e3)
        self._report.decisions += 1
        if recorded is None:
            self._report.unknown += 1
            return
        if recorded == chosen:
            self._report.same += 1
            self._differs = None
            return
        differs = self._name(recorded), self._name(chosen)
        if differs == self._differs:
            self._report.otherwise[-1].decisions += 1
        else:
            self._report.otherwise.append(Otherwise(at_s, 1, *differs))
        self._differs = differs

    def finish(self) -> None:
        report = self._report
        if self._elapsed_ms:
            report.decision_ms = [float(q) for q in np.quantile(self._elapsed_ms, (0.5, 0.99, 1.0))]
        if report.rounds == 0:
            raise BagError(f"{report.bag}: no round was played in it")
        if report.decisions == 0:
            lacking = f"it lacks poses, a ghost or pellets of map {report.map}"
            raise BagError(f"{report.bag}: no decision can be made: {lacking}")

    def _name(self, candidate: int) -> str:
        goal = self.view.goal(candidate)
        if goal is None:
            return KIND_NAMES[2]
        return f"{goal_name(self._assets.pellet_ids.tolist(), candidate)} at ({goal.x:.2f}, {goal.y:.2f})"
