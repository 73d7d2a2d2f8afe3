"""Walk through a recorded game: what the robot knew at each decision, and where it was sent."""

import json
from collections.abc import Iterator
from typing import Any, Protocol

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
from pacman_env.ros.message_conversion import BadMessage, ghost_times_of, pose_of
from pacman_env.ros.selector.believed_pose import BelievedPose

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


class Follower(Protocol):
    """Receiver of the events of a recorded game; times are in s since the start of the bag."""

    def begin(self, at_s: float) -> None:
        """Handle the start of a round."""

    def decide(self, at_s: float, situation: Situation, recorded: int | None) -> None:
        """Handle a decision of the round; ``recorded`` is the recorded choice of candidate, None if it is unknown."""

    def report(self, at_s: float, status: str) -> None:
        """Handle a message on ``game_status``."""

    def end(self, at_s: float, state: str, situation: Situation | None) -> None:
        """Handle the end of a round: the game's new state, and the situation (None if the robot's pose is unknown)."""


class Walk:
    """One pass through a bag."""

    def __init__(self, bag: Bag, assets: MapAssets, config: Config, follower: Follower) -> None:
        self.view, self.motion = RobotView(assets, config), PoseStatistics(counts=False)
        self.rounds = 0
        self.bad_messages: dict[str, int] = {}
        self._bag, self._follower = bag, follower
        self._tick_s = config.execution.tick_s
        self._by_event = config.decisions.when == "event"
        self._ghosts = {topics.GHOST_POSES[k].name: k for k in range(len(config.clyde.ghosts))}
        self._has_scores = bag.has(topics.SCORES)  # without scores, another planner played the game
        self._chosen_before = -1
        self._plans = [] if self._has_scores else list(_plans(bag, assets))
        self._believed = BelievedPose(TF_S)  # same limits as in the goal selector
        self._game = GameMonitor()
        self._due_s = 0.0
        self._left: set[int] = set()
        self._gone: set[int] = set()  # pellets removed in this round
        self._velocity = (0.0, 0.0)
        self._harmless = np.zeros((len(self._ghosts), 2))  # ROS times, s: harmless until, away until
        self._began_ns = 0  # ROS time at the start of the bag

    def run(self) -> None:
        """Read the bag and report its events to the follower.

        The decisions are the recorded decisions of the goal selector. In a bag without scores, a decision is due every
        tick.
        """
        for recorded in self._bag.messages(_READ):
            self._decisions_before(recorded)
            try:
                self._update(recorded)
            except BadMessage as error:
                what = f"{recorded.topic}: {error}"
                self.bad_messages[what] = self.bad_messages.get(what, 0) + 1

    def _decisions_before(self, recorded: Recorded) -> None:
        if self._has_scores:
            while self._by_event and self._running and self._due_s + TICK_LATE * self._tick_s < recorded.at_s:
                self._situation(self._due_s, self._chosen_before)  # a tick in which the goal selector only observed
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

    def _update(self, recorded: Recorded) -> None:
        message, topic, at_s = recorded.message, recorded.topic, recorded.at_s
        game, was_running = self._game, self._running
        game.update(topic, message, at_s)
        if topic == topics.GAME_STATE.name:
            self._enter(was_running, at_s)
        elif topic == topics.GAME_STATUS.name:
            self._follower.report(at_s, message.data)
        elif topic == topics.PELLET_MARKERS.name:
            self._left = set(self.view.pellets(game.pellets, game.power_pellets).known)
        elif topic == topics.REMOVE_PELLET.name:
            self._gone.add(message.data)
        elif topic == topics.CLYDE_SPEED.name:
            self.view.clyde_speed_mps = message.data
        elif topic == topics.HARMLESS_GHOSTS.name:
            self._harmless = ghost_times_of(message, len(self._ghosts))
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
        elif topic == topics.ODOMETRY.name:
            twist = message.twist.twist
            self._velocity = twist.linear.x, twist.angular.z
            self.motion.drive(pose_of(message, frame=message.header.frame_id), twist.linear.x)

    @property
    def _running(self) -> bool:
        return self._game.state == "running"

    def _enter(self, was_running: bool, at_s: float) -> None:
        if self._running and not was_running:
            self.rounds += 1
            self._due_s = at_s
            self.motion.counts = True
            self._chosen_before = -1
            self.view.begin()
            self._follower.begin(at_s)
        elif not self._running:
            self.motion.counts = False  # shows and the drive home do not count as driving
            if was_running:
                self._follower.end(at_s, str(self._game.state), self._situation(at_s, -1, over=True))
            self._gone.clear()

    def _situation(self, at_s: float, pursued: int, over: bool = False) -> Situation | None:
        """Return a policy's situation at a tick; None if too little is known."""
        belief, left = self._believed.at(at_s), self._left - self._gone
        pose = self.motion.believed if belief is None else belief.pose  # ``believed`` for a bag without transforms
        velocity = self._velocity if belief is None else belief.velocity
        goal = None if pursued < 0 else self.view.goal(pursued)
        if goal is not None and goal.pellet is not None and goal.pellet not in left:
            pursued = -1  # the pellet has been collected
        if pose is None or self.view.unseen or not (left or over) or self.view.off_the_map(*pose[:2]):
            return None
        age_s = 0.0 if belief is None else belief.age_s
        now_s = (self._began_ns + round(at_s * 1e9)) / 1e9
        seen = Seen(
            time_s=at_s - self._game.began_s,
            pose=pose,
            left=left,
            velocity=velocity,
            pose_age_s=age_s,
            pursued=pursued,
            harmless_s=np.maximum(self._harmless - now_s, 0.0),
        )
        return self.view.situation(seen)

    def _decide(self, at_s: float, pursued: int, recorded: int | None) -> None:
        """Report a decision: ``pursued`` was the current goal, ``recorded`` is the choice (-1: none, None: unknown)."""
        situation = self._situation(at_s, pursued)
        if situation is not None:
            chosen = self.view.hold if recorded is not None and recorded < 0 else recorded
            self._follower.decide(at_s, situation, chosen)

    def _planned(self, at_s: float) -> int:
        """Return the candidate to which Nav2's plan led at ``at_s``, -1 for none."""
        recent = [candidate for when, candidate in self._plans if at_s - PLAN_LASTS_S < when <= at_s]
        return recent[-1] if recent else -1


def recorded_config(bag: Bag) -> Config:
    """Return the recorded configuration of the goal selector, or the default one."""
    config = make_config()
    for recorded in bag.messages((topics.CONFIGURATION,)):
        problems = (ValueError, TypeError, LookupError, AttributeError, RecursionError)
        with located(f"{topics.CONFIGURATION.name}: not a configuration of this version", BagError, problems):
            plays = json.loads(recorded.message.data)
            if plays["node"] == SELECTOR:
                fields = differences(make_config().as_dict(), plays["configuration"])
                values = {
                    name: value for name, (_, value) in fields.items() if value is not None
                }  # None: an old recording lacks the field
                config = make_config(**values)
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
    for marker in markers.markers:
        if marker.color.g > 0.5 > max(marker.color.r, marker.color.b):
            return int(marker.id)
    return -1
