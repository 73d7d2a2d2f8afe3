"""``pacman-env ros replay``: a policy is asked at every decision of a recorded game, with what the robot knew then.

The game continues as it was recorded, whatever the policy chooses."""

import json
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from pacman_env.config import Config, differences, make_config
from pacman_env.policies.base import KIND_NAMES, Policy
from pacman_env.policies.registry import make_policy
from pacman_env.ros import topics
from pacman_env.ros.bags.bag import Bag, BagError, Recorded, open_bag
from pacman_env.ros.bags.pose_statistics import QUANTITIES, PoseStatistics, simulated_statistics
from pacman_env.ros.messages import BadMessage, nanoseconds_of, pellets_of, pose_of
from pacman_env.ros.selector.believed_pose import BelievedPose
from pacman_env.ros.supervisor.game_nodes import SELECTOR
from pacman_env.ros.supervisor.terminal import wrapped
from pacman_env.sim.maps.assets import MapAssets, map_assets
from pacman_env.sim.observation.robot_view import RobotView, Seen
from pacman_env.sim.observation.situation import Situation
from pacman_env.world.maps.occupancy import load_map

_READ = (
    *(topics.GAME_STATE, topics.GAME_STATUS, topics.PELLET_MARKERS, topics.REMOVE_PELLET, *topics.GHOST_POSES),
    *(topics.CLYDE_SPEED, topics.AMCL_POSE, topics.ODOMETRY, topics.TF, topics.TF_STATIC, topics.SCORES),
)
PLAN_LASTS_S = 2.5  # Nav2 plans anew every second while it has a goal
PLAN_LATE_S = 1.2  # a choice is visible in the first plan after it, this late at most
TICK_LATE = 0.1  # of a tick: what the goal selector chose in it is known by then
TF_S = 1.0  # a transform that is older is no use, by default of the goal selector
END_OF_PLAN_M = 0.75  # Nav2 may end a plan beside its goal, half a metre in x and in y
_LISTED = 20


@dataclass
class Otherwise:
    """Decisions in a row in which the policy would have chosen another goal."""

    at_s: float  # since the bag began
    decisions: int
    recorded: str
    chosen: str


@dataclass
class ReplayReport:
    """The result of a replay; times in s since the bag began."""

    bag: str
    namespace: str
    map: str
    policy: str
    duration_s: float
    rounds: int = 0
    statuses: dict[str, int] = field(default_factory=dict)
    bad_messages: dict[str, int] = field(default_factory=dict)
    decisions: int = 0
    same: int = 0
    unknown: int = 0  # decisions without a record of where the robot was sent
    otherwise: list[Otherwise] = field(default_factory=list)
    decision_ms: list[float] | None = None  # 50 %, 99 %, most
    robot: dict[str, list[float] | None] = field(default_factory=dict)  # 10 %, 50 %, 90 %
    simulator: dict[str, list[float] | None] = field(default_factory=dict)

    def render(self) -> str:
        other = self.decisions - self.same - self.unknown
        same = f"{self.same} as recorded, {other} otherwise, {self.unknown} unknown"
        statuses = ", ".join(f"{count} {word}" for word, count in self.statuses.items()) or "no status"
        lines = [
            f"{self.bag}: {self.namespace or '/'}, {self.duration_s:.1f} s, rounds {self.rounds}, {statuses}",
            f"{self.policy} on {self.map}: {self.decisions} decisions, {same}",
        ]
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
            columns = (_range(side.get(name)) for side in (self.robot, self.simulator))
            lines.append(f"{words:29}{{:24}}{{}}".format(*columns))
        return "\n".join(wrapped(line, 11) for line in lines)


def _range(quantiles: list[float] | None) -> str:
    return "-" if quantiles is None else "{1:.3f} ({0:.3f} to {2:.3f})".format(*quantiles)


def replay_bag(path: Path, map: str, policy: str, namespace: str | None = None) -> ReplayReport:
    occupancy, chooser = load_map(map), make_policy(policy)
    with open_bag(path, namespace) as bag:
        config = recorded_config(bag)
        assets = map_assets(occupancy, config)
        report = ReplayReport(str(path), bag.namespace, map, policy, bag.duration_s)
        walk = _Walk(bag, assets, config, chooser, report)
        for recorded in bag.messages(_READ):
            walk.receive(recorded)
        walk.finish()
    report.simulator = simulated_statistics(assets, config, make_policy(policy)).quantiles()
    return report


class _Walk:
    """One pass through a bag: what the robot knows at each moment, and a decision at each tick."""

    def __init__(self, bag: Bag, assets: MapAssets, config: Config, policy: Policy, report: ReplayReport) -> None:
        self._view, self._config = RobotView(assets, config), config
        self._assets, self._policy, self._report = assets, policy, report
        self._tick_s = config.execution.tick_s
        self._by_event = config.decisions.when == "event"
        self._ghosts = {topics.GHOST_POSES[k].name: k for k in range(len(config.clyde.ghosts))}
        self._has_scores = bag.has(topics.SCORES)  # else it is another planner's game
        self._chosen_before = -1
        self._plans = [] if self._has_scores else list(_plans(bag, assets))
        self._believed = BelievedPose(TF_S)  # as the goal selector has it
        self._motion = PoseStatistics(counts=False)
        self._running = False
        self._began_s = self._due_s = 0.0
        self._left: set[int] = set()
        self._gone: set[int] = set()  # of this round
        self._velocity = (0.0, 0.0)
        self._elapsed_ms: list[float] = []
        self._differs: tuple[str, str] | None = None

    def receive(self, recorded: Recorded) -> None:
        """Decisions are those of the recorded goal selector, or due every half second before the message."""
        if self._has_scores:
            while self._by_event and self._running and self._due_s + TICK_LATE * self._tick_s < recorded.at_s:
                self._situation(self._due_s, self._chosen_before)  # a tick in which it only observed
                self._due_s += self._tick_s
            if self._running and recorded.topic == topics.SCORES.name:
                chosen = chosen_of(recorded.message)
                self._decide(recorded.at_s, self._chosen_before, chosen)
                self._chosen_before, self._due_s = chosen, recorded.at_s + self._tick_s
        else:
            while self._running and self._due_s <= recorded.at_s:
                chosen_soon = self._planned(self._due_s + PLAN_LATE_S) if self._plans else None
                self._decide(self._due_s, self._planned(self._due_s), chosen_soon)
                self._due_s += self._tick_s
        try:
            self._update(recorded)
        except BadMessage as error:
            bad, what = self._report.bad_messages, f"{recorded.topic}: {error}"
            bad[what] = bad.get(what, 0) + 1

    def finish(self) -> None:
        report = self._report
        report.robot = self._motion.quantiles()
        if self._elapsed_ms:
            report.decision_ms = [float(q) for q in np.quantile(self._elapsed_ms, (0.5, 0.99, 1.0))]
        if report.rounds == 0:
            raise BagError(f"{report.bag}: no round was played in it")
        if report.decisions == 0:
            lacking = f"it lacks poses, a ghost or pellets of map {report.map}"
            raise BagError(f"{report.bag}: no decision can be made: {lacking}")

    def _update(self, recorded: Recorded) -> None:
        message, topic, at_s = recorded.message, recorded.topic, recorded.at_s
        if topic == topics.GAME_STATE.name:
            self._enter(message.data, at_s)
        elif topic == topics.GAME_STATUS.name:
            statuses, word = self._report.statuses, message.data.partition(":")[0]
            statuses[word] = statuses.get(word, 0) + 1
        elif topic == topics.PELLET_MARKERS.name:
            self._left = set(self._view.pellets(pellets_of(message)).known)
        elif topic == topics.REMOVE_PELLET.name:
            self._gone.add(message.data)
        elif topic == topics.CLYDE_SPEED.name:
            self._view.clyde_speed_mps = message.data
        elif topic in self._ghosts:
            (x, y, _), stamp_ns = pose_of(message), nanoseconds_of(message.header.stamp)
            self._view.see_ghost(self._ghosts[topic], x, y, stamp_ns)
            if topic == topics.CLYDE_POSE.name:
                self._motion.see_clyde(stamp_ns / 1e9, x, y)
        elif topic in (topics.TF.name, topics.TF_STATIC.name):
            self._believed.transforms(message, at_s, static=topic == topics.TF_STATIC.name)
        elif topic == topics.AMCL_POSE.name:
            self._motion.localize(nanoseconds_of(message.header.stamp) / 1e9, pose_of(message))
        elif topic == topics.ODOMETRY.name:
            twist = message.twist.twist
            self._velocity = twist.linear.x, twist.angular.z
            self._motion.drive(pose_of(message, frame=message.header.frame_id), twist.linear.x)

    def _enter(self, state: str, at_s: float) -> None:
        running = state == "running"
        if running and not self._running:
            self._report.rounds += 1
            self._began_s = self._due_s = at_s
            self._motion.counts = True
            self._chosen_before = -1
            self._view.begin()
            self._policy.reset(np.ones(1, dtype=np.bool_), self._config)
        elif not running:
            self._motion.counts = False  # shows and the drive home are no driving for pellets
            self._gone.clear()
            self._differs = None
        self._running = running

    def _situation(self, at_s: float, pursued: int) -> Situation | None:
        """What a policy sees at a tick; None if too little is known."""
        belief, left = self._believed.at(at_s), self._left - self._gone
        pose = self._motion.believed if belief is None else belief.pose  # of a bag without transforms
        velocity = self._velocity if belief is None else belief.velocity
        goal = None if pursued < 0 else self._view.goal(pursued)
        if goal is not None and goal.pellet is not None and goal.pellet not in left:
            pursued = -1  # it was collected since
        if pose is None or self._view.unseen or not left or self._view.off_the_map(*pose[:2]):
            return None
        age_s = 0.0 if belief is None else belief.age_s
        seen = Seen(at_s - self._began_s, pose, left, velocity, pose_age_s=age_s, pursued=pursued)
        return self._view.situation(seen)

    def _decide(self, at_s: float, pursued: int, recorded: int | None) -> None:
        """``pursued``: where the robot was going, ``recorded``: what was chosen (-1 for nothing, None if not known)."""
        situation = self._situation(at_s, pursued)
        if situation is None:
            return
        began = time.perf_counter()
        chosen = int(self._policy.select(situation)[0])
        self._elapsed_ms.append((time.perf_counter() - began) * 1e3)
        self._report.decisions += 1
        if recorded is None:
            self._report.unknown += 1
            return
        recorded = self._view.hold if recorded < 0 else recorded
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

    def _planned(self, at_s: float) -> int:
        """The candidate that Nav2 planned to, -1 for none."""
        before = [candidate for when, candidate in self._plans if at_s - PLAN_LASTS_S < when <= at_s]
        return before[-1] if before else -1

    def _name(self, candidate: int) -> str:
        goal = self._view.goal(candidate)
        if goal is None:
            return KIND_NAMES[2]
        kind = f"refuge {candidate - self._assets.pellets}" if goal.pellet is None else f"pellet {goal.pellet}"
        return f"{kind} at ({goal.x:.2f}, {goal.y:.2f})"


def recorded_config(bag: Bag) -> Config:
    """The configuration that the goal selector published, else the default one."""
    found = make_config()
    for recorded in bag.messages((topics.CONFIGURATION,)):
        try:
            plays = json.loads(recorded.message.data)
            if plays["node"] == SELECTOR:
                fields = differences(make_config().as_dict(), plays["configuration"])
                known = {name: value for name, (_, value) in fields.items() if value is not None}  # else of 0.10
                found = make_config(**known)
                ghosts = ("policy" if name.endswith(".onnx") else name for name in found.clyde.ghosts)  # only seen here
                found = found.with_fields(**{"clyde.ghosts": tuple(ghosts)})
        except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
            raise BagError(f"{topics.CONFIGURATION.name}: not a configuration of this version: {error}") from None
    return found


def _plans(bag: Bag, assets: MapAssets) -> Iterator[tuple[float, int]]:
    """When Nav2 planned, and to which candidate, or to none (-1), such as home."""
    for recorded in bag.messages((topics.PLAN,)):
        if recorded.message.poses:
            end = recorded.message.poses[-1].pose.position
            away = np.hypot(assets.goal_xy[:, 0] - end.x, assets.goal_xy[:, 1] - end.y)
            nearest = int(away.argmin())
            yield recorded.at_s, nearest if away[nearest] <= END_OF_PLAN_M else -1


def chosen_of(markers: Any) -> int:
    """The candidate that a MarkerArray of scores shows in green, -1 for none."""
    for marker in markers.markers:
        if marker.color.g > 0.5 > max(marker.color.r, marker.color.b):
            return int(marker.id)
    return -1
