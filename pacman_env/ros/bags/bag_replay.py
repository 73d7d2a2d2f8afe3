"""``pacman-env ros replay``: a recorded game seen again by any policy, offline.

At every decision of the recorded game the policy is asked with what the robot knew then. The game goes on as it was
recorded, whatever the policy says: this tells where it would have chosen otherwise, not what would have come of it.
"""

from __future__ import annotations

import json
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
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
from pacman_env.ros.selector.goal_scores import SCORES
from pacman_env.ros.supervisor.game_nodes import SELECTOR
from pacman_env.sim.maps.assets import MapAssets, map_assets
from pacman_env.sim.observation.robot_view import RobotView, Seen
from pacman_env.sim.observation.situation import Situation
from pacman_env.world.maps.occupancy import load_map

_READ = (
    topics.GAME_STATE,
    topics.GAME_STATUS,
    topics.PELLET_MARKERS,
    topics.REMOVE_PELLET,
    *topics.GHOST_POSES,
    topics.CLYDE_SPEED,
    topics.AMCL_POSE,
    topics.ODOMETRY,
    topics.TF,
    topics.TF_STATIC,
    SCORES,
)
PLAN_LASTS_S = 2.5  # Nav2 plans anew every second while it has a goal
PLAN_LATE_S = 1.2  # a choice shows in the first plan after it, this late at most
TICK_LATE = 0.1  # of a tick: what the goal selector chose in it is known by then
TF_S = 1.0  # a transform that is older is no use, by default of the goal selector
END_OF_PLAN_M = 0.75  # Nav2 may end a plan beside its goal, half a metre in x and in y
_LISTED = 20


@dataclass(frozen=True)
class Otherwise:
    """A stretch of decisions in which the policy would have gone elsewhere."""

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
    unknown: int = 0  # decisions of which nothing recorded tells where the robot was sent
    otherwise: list[Otherwise] = field(default_factory=list)
    decision_ms: list[float] | None = None  # 50 %, 99 %, most
    robot: dict[str, list[float] | None] = field(default_factory=dict)  # 10 %, 50 %, 90 %
    simulator: dict[str, list[float] | None] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """Plain data, as JSON has it."""
        return asdict(self)

    def render(self) -> str:
        """As text."""
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
            lines.append(f"  {one.at_s:7.1f} s  {one.chosen} instead of {one.recorded} ({one.decisions} decisions)")
        if len(self.otherwise) > _LISTED:
            lines.append(f"  and {len(self.otherwise) - _LISTED} more")
        lines += [f"  {count} bad messages: {what}" for what, count in self.bad_messages.items()]
        lines.append(f"{'median (10 % to 90 %)':40}{'robot':24}simulator")
        for name, words in QUANTITIES.items():
            columns = (_range(side.get(name)) for side in (self.robot, self.simulator))
            lines.append(f"{words:40}{{:24}}{{}}".format(*columns))
        return "\n".join(lines)


def _range(quantiles: list[float] | None) -> str:
    return "-" if quantiles is None else "{1:.3f} ({0:.3f} to {2:.3f})".format(*quantiles)


def replay_bag(path: Path, map: str, policy: str, namespace: str | None = None) -> ReplayReport:
    """Ask ``policy`` at every decision of a recorded game, under the configuration that its goal selector played by.

    Args:
        path: A bag's folder, or its .mcap or .db3 file.
        map: Its map, as a YAML file or a shipped map's name.
        policy: By name, or an .onnx file.
        namespace: Which robot's game; None: the only one there is.

    Raises:
        ValueError: no bag of a game, one of another map, a map or policy that cannot be used.
    """
    occupancy, chooser = load_map(map), make_policy(policy)
    with open_bag(path, namespace) as bag:
        config = recorded_config(bag)
        assets = map_assets(occupancy, config)
        report = ReplayReport(str(path), bag.namespace, map, policy, bag.duration_s)
        walk = _Walk(bag, assets, config, chooser, report)
        for recorded in bag.messages(_READ):
            walk.take(recorded)
        walk.finish()
    report.simulator = simulated_statistics(assets, config, make_policy(policy)).quantiles()
    return report


class _Walk:
    """One pass through a bag: what the robot knows at each moment, and a decision at each tick."""

    def __init__(self, bag: Bag, assets: MapAssets, config: Config, policy: Policy, report: ReplayReport) -> None:
        self._view, self._config = RobotView(assets, config), config
        self._assets, self._policy, self._report = assets, policy, report
        self._path = report.bag
        self._tick_s = config.execution.tick_s
        self._by_event = config.decisions.when == "event"
        self._ghosts = {topics.GHOST_POSES[k].name: k for k in range(len(config.clyde.ghosts))}
        self._has_scores = bag.has(SCORES)  # else it is another planner's game
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
        self._statuses: Counter[str] = Counter()
        self._bad: Counter[str] = Counter()
        self._differs: tuple[str, str] | None = None

    def take(self, recorded: Recorded) -> None:
        """One message. Decisions are those of the recorded goal selector, or due every half second before it."""
        if self._has_scores:
            while self._by_event and self._running and self._due_s + TICK_LATE * self._tick_s < recorded.at_s:
                self._situation(self._due_s, self._chosen_before)  # a tick in which it only looked
                self._due_s += self._tick_s
            if self._running and recorded.topic == SCORES.name:
                chosen = chosen_of(recorded.message)
                self._decide(recorded.at_s, self._chosen_before, chosen)
                self._chosen_before, self._due_s = chosen, recorded.at_s + self._tick_s
        else:
            while self._running and self._due_s <= recorded.at_s:
                chosen_soon = self._planned(self._due_s + PLAN_LATE_S) if self._plans else None
                self._decide(self._due_s, self._planned(self._due_s), chosen_soon)
                self._due_s += self._tick_s
        try:
            self._take(recorded)
        except BadMessage as error:
            self._bad[f"{recorded.topic}: {error}"] += 1

    def finish(self) -> None:
        """Sum up.

        Raises:
            BagError: there was nothing to decide on this map.
        """
        report = self._report
        report.statuses, report.bad_messages = dict(self._statuses), dict(self._bad)
        report.robot = self._motion.quantiles()
        if self._elapsed_ms:
            report.decision_ms = [float(q) for q in np.quantile(self._elapsed_ms, (0.5, 0.99, 1.0))]
        if report.rounds == 0:
            raise BagError(f"{self._path}: no round was played in it")
        if report.decisions == 0:
            raise BagError(
                f"{self._path}: no decision can be made: it lacks poses, a ghost or pellets of map {report.map}"
            )

    def _take(self, recorded: Recorded) -> None:
        message, topic, at_s = recorded.message, recorded.topic, recorded.at_s
        if topic == topics.GAME_STATE.name:
            self._enter(message.data, at_s)
        elif topic == topics.GAME_STATUS.name:
            self._statuses[message.data.partition(":")[0]] += 1
        elif topic == topics.PELLET_MARKERS.name:
            self._left = set(self._view.pellets(pellets_of(message)).known)
        elif topic == topics.REMOVE_PELLET.name:
            self._gone.add(message.data)
        elif topic == topics.CLYDE_SPEED.name:
            self._view.clyde_speed_mps = message.data
        elif topic in self._ghosts:
            x, y, _ = pose_of(message)
            self._view.see_ghost(self._ghosts[topic], x, y, nanoseconds_of(message.header.stamp))
            if topic == topics.CLYDE_POSE.name:
                self._motion.see_clyde(nanoseconds_of(message.header.stamp) / 1e9, x, y)
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
            self._motion.counts = False  # shows and the way home are no driving for pellets
            self._gone.clear()
            self._differs = None
        self._running = running

    def _situation(self, at_s: float, pursued: int) -> Situation | None:
        """What a policy sees at a tick; None: too little is known."""
        belief, left = self._believed.at(at_s), self._left - self._gone
        pose = self._motion.believed if belief is None else belief.pose  # of a bag without transforms
        velocity = self._velocity if belief is None else belief.velocity
        goal = None if pursued < 0 else self._view.goal(pursued)
        if goal is not None and goal.pellet is not None and goal.pellet not in left:
            pursued = -1  # it was collected since
        if pose is None or self._view.unseen or not left or self._view.off_the_map(*pose[:2]):
            return None
        return self._view.situation(
            Seen(
                time_s=at_s - self._began_s,
                pose=pose,
                left=left,
                velocity=velocity,
                pose_age_s=0.0 if belief is None else belief.age_s,
                pursued=pursued,
            )
        )

    def _decide(self, at_s: float, pursued: int, recorded: int | None) -> None:
        """``pursued``: where the robot was going, ``recorded``: what was chosen; -1: nothing, None: not known."""
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
            last = self._report.otherwise[-1]
            self._report.otherwise[-1] = Otherwise(last.at_s, last.decisions + 1, *differs)
        else:
            self._report.otherwise.append(Otherwise(at_s, 1, *differs))
        self._differs = differs

    def _planned(self, at_s: float) -> int:
        """The candidate that Nav2 planned to, -1: none."""
        before = [candidate for when, candidate in self._plans if at_s - PLAN_LASTS_S < when <= at_s]
        return before[-1] if before else -1

    def _name(self, candidate: int) -> str:
        goal = self._view.goal(candidate)
        if goal is None:
            return KIND_NAMES[2]
        kind = f"refuge {candidate - self._assets.pellets}" if goal.pellet is None else f"pellet {goal.pellet}"
        return f"{kind} at ({goal.x:.2f}, {goal.y:.2f})"


def recorded_config(bag: Bag) -> Config:
    """The configuration that the goal selector of a recorded game published; the default one where it has not.

    Raises:
        BagError: it is none of this version's.
    """
    found = make_config()
    for recorded in bag.messages((topics.CONFIGURATION,)):
        try:
            said = json.loads(recorded.message.data)
            if said["node"] == SELECTOR:
                fields = differences(make_config().as_dict(), said["configuration"])
                known = {name: value for name, (_, value) in fields.items() if value is not None}  # else of 0.10
                found = make_config(**known)
                ghosts = ("policy" if name.endswith(".onnx") else name for name in found.clyde.ghosts)  # only seen here
                found = found.with_fields(**{"clyde.ghosts": tuple(ghosts)})
        except (ValueError, TypeError, LookupError, AttributeError, RecursionError) as error:
            raise BagError(f"{topics.CONFIGURATION.name}: not a configuration of this version: {error}") from None
    return found


def _plans(bag: Bag, assets: MapAssets) -> Iterator[tuple[float, int]]:
    """When Nav2 planned, and to which candidate; -1: to none, such as home."""
    for recorded in bag.messages((topics.PLAN,)):
        if recorded.message.poses:
            end = recorded.message.poses[-1].pose.position
            away = np.hypot(assets.goal_xy[:, 0] - end.x, assets.goal_xy[:, 1] - end.y)
            nearest = int(away.argmin())
            yield recorded.at_s, nearest if away[nearest] <= END_OF_PLAN_M else -1


def chosen_of(markers: Any) -> int:
    """The candidate that a MarkerArray of scores shows in green; -1: none."""
    for marker in markers.markers:
        if marker.color.g > 0.5 > max(marker.color.r, marker.color.b):
            return int(marker.id)
    return -1
