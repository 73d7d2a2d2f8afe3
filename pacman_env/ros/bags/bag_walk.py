"""Walk through a recorded game: what the robot knew at each decision, and where it was sent."""

import json
from collections import Counter
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np

from pacman_env.config import Config, differences, located, make_config
from pacman_env.levels.assets import MapAssets
from pacman_env.observations.robot_view import RobotView, Seen
from pacman_env.observations.situation import Situation
from pacman_env.ros import topics
from pacman_env.ros.bags.bag import Bag, BagError, Recorded
from pacman_env.ros.bags.pose_statistics import PoseStatistics
from pacman_env.ros.game_monitor import GameMonitor
from pacman_env.ros.game_nodes import SELECTOR
from pacman_env.ros.message_conversion import BadMessage, pose_of
from pacman_env.ros.selector.robot_pose import BelievedPose

_READ = (
    *(topics.GAME_STATE, topics.GAME_STATUS, topics.PELLET_MARKERS, topics.REMOVE_PELLET, *topics.GHOST_POSES),
    *(topics.CLYDE_SPEED, topics.AMCL_POSE, topics.ODOMETRY, topics.TF, topics.TF_STATIC, topics.SCORES),
    topics.HARMLESS_GHOSTS,
)
PLAN_LASTS_S = 2.5  # Nav2 replans every second while it has a goal
PLAN_LATE_S = 1.2  # longest delay of the first plan after a choice
TICK_LATE = 0.1  # longest delay of the goal selector's choice, in ticks
TF_S = 1.0  # maximum age of transforms, as in the goal selector
END_OF_PLAN_M = 0.75  # Nav2 may end a plan next to its goal, half a metre off in x and in y


class Decision(NamedTuple):
    at_s: float  # time since the start of the bag
    round: int  # 1 for the first round in the bag
    situation: Situation
    recorded: int | None  # recorded choice of candidate, None if it is unknown


class Walk:
    """One pass through a bag."""

    def __init__(self, bag: Bag, assets: MapAssets, config: Config) -> None:
        self.view, self.motion = RobotView(assets, config), PoseStatistics(counts=False)
        self.rounds = 0
        self.statuses: Counter[str] = Counter()
        self.bad_messages: Counter[str] = Counter()
        self._bag = bag
        self._tick_s = config.execution.tick_s
        self._by_event = config.decisions.when == "event"
        self._ghosts = {topics.GHOST_POSES[k].name: k for k in range(len(config.clyde.ghosts))}
        self._has_scores = any(bag.messages((topics.SCORES,)))  # without scores, another planner played the game
        self._chosen_before = -1
        self._plans = [] if self._has_scores else list(_plans(bag, assets))
        self._believed = BelievedPose(TF_S)  # same limits as in the goal selector
        self._game = GameMonitor()
        self._due_s = 0.0
        self._left: set[int] = set()
        self._gone: set[int] = set()  # pellets removed in this round
        self._began_ns = 0  # ROS time at the start of the bag

    def decisions(self) -> Iterator[Decision]:
        """Read the bag and yield the recorded decisions, or one for each tick if the bag contains no scores.

        A decision is left out if too little is known for it.
        """
        for recorded in self._bag.messages(_READ):
            for at_s, pursued, chosen in self._due_before(recorded) if self._running else ():
                if (situation := self._situation(at_s, pursued)) is not None:
                    choice = self.view.hold if chosen is not None and chosen < 0 else chosen
                    yield Decision(at_s, self.rounds, situation, choice)
            try:
                self._update(recorded)
            except BadMessage as error:
                self.bad_messages[f"{recorded.topic}: {error}"] += 1

    def _due_before(self, recorded: Recorded) -> Iterator[tuple[float, int, int | None]]:
        """Yield time, current goal and recorded choice of each decision (-1: none, None: unknown)."""
        if not self._has_scores:
            while self._due_s <= recorded.at_s:
                chosen_soon = self._planned(self._due_s + PLAN_LATE_S) if self._plans else None
                yield self._due_s, self._planned(self._due_s), chosen_soon
                self._due_s += self._tick_s
            return
        while self._by_event and self._due_s + TICK_LATE * self._tick_s < recorded.at_s:
            self._situation(self._due_s, self._chosen_before)  # a tick in which the goal selector only observed
            self._due_s += self._tick_s
        if recorded.topic == topics.SCORES.name:
            chosen = chosen_of(recorded.message)
            yield recorded.at_s, self._chosen_before, chosen
            self._chosen_before, self._due_s = chosen, recorded.at_s + self._tick_s

    def _update(self, recorded: Recorded) -> None:
        message, topic, at_s = recorded.message, recorded.topic, recorded.at_s
        game, was_running = self._game, self._running
        game.update(topic, message, at_s)
        if topic == topics.GAME_STATE.name:
            self.motion.counts = self._running  # shows and the drive home do not count as driving
            if self._running and not was_running:
                self._begin_round(at_s)
        elif topic == topics.GAME_STATUS.name:
            self.statuses[message.data.partition(":")[0]] += 1
        elif topic == topics.PELLET_MARKERS.name:
            self._left = set(self.view.pellets(game.pellets, game.power_pellets).known)
        elif topic == topics.REMOVE_PELLET.name:
            self._gone.add(message.data)
        elif topic == topics.CLYDE_SPEED.name:
            self.view.clyde_speed_mps = message.data
        elif topic in self._ghosts:
            (x, y, _), stamp_ns = game.ghosts[self._ghosts[topic]]
            self._began_ns = stamp_ns - round(at_s * 1e9)
            self.view.see_ghost(self._ghosts[topic], x, y, stamp_ns)
            if topic == topics.CLYDE_POSE.name:
                self.motion.see_clyde(stamp_ns / 1e9, x, y)
        elif topic in (topics.TF.name, topics.TF_STATIC.name):
            self._believed.transforms(message, at_s, static=topic == topics.TF_STATIC.name)
        elif topic == topics.AMCL_POSE.name:
            pose, stamp_ns = game.valid("pose")
            self.motion.localize(stamp_ns / 1e9, pose)
            self._believed.latched(message)
        elif topic == topics.ODOMETRY.name:
            self.motion.drive(pose_of(message, frame=message.header.frame_id), message.twist.twist.linear.x)

    @property
    def _running(self) -> bool:
        return self._game.state == "running"

    def _begin_round(self, at_s: float) -> None:
        self.rounds += 1
        self._due_s, self._chosen_before = at_s, -1
        self._gone.clear()
        self.view.begin()

    def _situation(self, at_s: float, pursued: int) -> Situation | None:
        """Return a policy's situation at a tick; None if too little is known."""
        belief, left = self._believed.at(at_s), self._left - self._gone
        if belief is None or self.view.unseen or not left or self.view.off_the_map(*belief.pose[:2]):
            return None
        goal = None if pursued < 0 else self.view.goal(pursued)
        if goal is not None and goal.pellet is not None and goal.pellet not in left:
            pursued = -1  # the pellet has been collected
        until_s = self._game.harmless_until_s
        remaining_s = np.maximum(until_s - (self._began_ns / 1e9 + at_s), 0.0)
        harmless_s = remaining_s if len(until_s) == len(self._ghosts) else None
        movement = belief.pose, left, belief.velocity, belief.age_s
        return self.view.situation(Seen(at_s - self._game.began_s, *movement, pursued=pursued, harmless_s=harmless_s))

    def _planned(self, at_s: float) -> int:
        """Return the candidate to which Nav2's plan led at ``at_s``, -1 for none."""
        valid = (candidate for when, candidate in reversed(self._plans) if at_s - PLAN_LASTS_S < when <= at_s)
        return next(valid, -1)


def recorded_config(bag: Bag) -> Config:
    """Return the recorded configuration of the goal selector, or the default one."""
    config = make_config()
    for recorded in bag.messages((topics.CONFIGURATION,)):
        problems = (ValueError, TypeError, LookupError, AttributeError, RecursionError)
        with located(f"{topics.CONFIGURATION.name}: not a configuration of this version", BagError, problems):
            plays = json.loads(recorded.message.data)
            if plays["node"] == SELECTOR:
                fields = differences(make_config().as_dict(), plays["configuration"])
                # None: an old recording lacks the field
                config = make_config(**{name: value for name, (_, value) in fields.items() if value is not None})
                ghosts = ("policy" if name.lower().endswith(".onnx") else name for name in config.clyde.ghosts)
                config = config.with_fields(**{"clyde.ghosts": tuple(ghosts)})
    return config


def _plans(bag: Bag, assets: MapAssets) -> Iterator[tuple[float, int]]:
    """Yield the time of each plan of Nav2 and its candidate, -1 for another goal such as home."""
    for recorded in bag.messages((topics.PLAN,)):
        if recorded.message.poses:
            end = recorded.message.poses[-1].pose.position
            distance_m = np.hypot(assets.goal_xy[:, 0] - end.x, assets.goal_xy[:, 1] - end.y)
            nearest = int(distance_m.argmin())
            yield recorded.at_s, nearest if distance_m[nearest] <= END_OF_PLAN_M else -1


def chosen_of(markers: Any) -> int:
    """Return the candidate that a MarkerArray of scores shows in green, -1 for none."""
    colours = ((int(marker.id), marker.color) for marker in markers.markers)
    return next((number for number, colour in colours if colour.g > 0.5 > max(colour.r, colour.b)), -1)
