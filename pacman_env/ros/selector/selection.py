"""One robot's choosing of goals, from the messages that it hears to the actions that it takes.

Messages become a situation in ``robot_view.py``, the policy chooses, ``game/goal_executor.py`` says what follows from
choices and events. Nothing is published here: the node does what it is told, and gives the time.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from pacman_env import __version__
from pacman_env.config import MAX_SPEED_MPS, Config
from pacman_env.game.decisions import HOLD, LastDecision, Moment
from pacman_env.game.execution import ABORTED
from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.game.goal_executor import GoalExecutor
from pacman_env.game.goals import ExecutorAction, Home
from pacman_env.policies.base import Policy
from pacman_env.ros import topics
from pacman_env.ros.messages import BadMessage, Pose, Position, nanoseconds_of, number_of, pellets_of, pose_of, word_of
from pacman_env.ros.selector.believed_pose import Belief, BelievedPose
from pacman_env.ros.selector.goal_scores import DecisionTimes
from pacman_env.ros.selector.rehearsal import rehearsed
from pacman_env.ros.surroundings import current
from pacman_env.sim.maps.assets import map_assets
from pacman_env.sim.observation.robot_view import Pellets, RobotView, Seen
from pacman_env.sim.observation.situation import Situation
from pacman_env.world.maps.occupancy import OccupancyMap

_ONE = np.ones(1, np.bool_)


class Selection:
    """A policy on a prepared map, warmed up.

    Every method that hears something takes the time, s, and returns what is to be done.

    Args:
        config: what is played by.
        map: a YAML file, the name of a shipped map, or a loaded map.
        policy: a name of the registry, or an .onnx file.
        home: the home pose; None: the first one in menu, or the one it is corrected to there, or the map's.
        pose_timeout_s: a transform older than this gives way to the latched pose.
        warn: called with the kind of a trouble and what to say about it.

    Raises:
        MapError: the map cannot be read or played on.
        ValueError: a policy that cannot be loaded, ModuleNotFoundError and TypeError likewise.
    """

    def __init__(
        self,
        config: Config,
        map: str | OccupancyMap,
        policy: str,
        home: Pose | None,
        pose_timeout_s: float,
        warn: Callable[[str, str], None],
    ) -> None:
        self._warn, self._perf_counter = warn, current().perf_counter
        self._home_given = home is not None
        self.view = RobotView(map_assets(map, config, home), config)
        self.executor = GoalExecutor(config, self.view.goals, None if home is None else Home(*home))
        self.spec, self.policy = policy, self.load(policy)
        self.seen: tuple[Situation, int] | None = None  # by the policy in the last look, and what it chose
        self._believed = BelievedPose(pose_timeout_s)
        self._belief: Belief | None = None
        self._pellets = Pellets({}, ())
        self._times = DecisionTimes()
        self._last = LastDecision(config)
        self._ended = {"aborted": 0, "rejected": 0}

    def load(self, spec: str) -> Policy:
        """Another policy, with all that a decision needs compiled and loaded before the first one counts.

        Raises:
            ValueError: it cannot be loaded or does not run; ModuleNotFoundError and TypeError likewise.
        """
        return rehearsed(spec, self.view)

    # What the game says; callbacks raise BadMessage

    def on_state(self, message: Any, now: float) -> list[ExecutorAction]:
        """``game_state``."""
        self._believe(now)
        return self.executor.state(word_of(message, topics.STATE_WORDS), now)

    def on_command(self, message: Any, now: float) -> list[ExecutorAction]:
        """``game_command``."""
        word = word_of(message, topics.COMMAND_WORDS)
        if word == "reset_round" or (word == "enable" and self.executor.task != "play"):
            self.view.begin()
            self.policy.reset(_ONE)
            self._last.forget()
        self._believe(now)
        return self.executor.command(word, now)

    def on_pellets(self, message: Any, now: float) -> list[ExecutorAction]:
        """``pellet_markers``."""
        self._pellets = pellets = self.view.pellets(pellets_of(message))
        if pellets.unknown:
            self._warn("unknown pellets", f"pellets ignored, the map has none such there: {_listed(pellets.unknown)}")
        unreachable = self._out_of_reach(pellets.known)
        if unreachable:
            self._warn("pellets out of reach", f"pellets that the robot cannot drive to: {_listed(unreachable)}")
        return self.executor.pellets(pellets.known, len(pellets.unknown), now)

    def _out_of_reach(self, pellets: Iterable[int]) -> list[int]:
        return [number for number in pellets if not self.view.is_candidate(number)]

    def on_collected(self, message: Any, now: float) -> list[ExecutorAction]:
        """``game/pellets_collected``."""
        self.executor.statuses.counted(int(number_of(message, 0, 2**31 - 1)))
        return []

    def on_ghost(self, number: int, message: Any, now: float) -> list[ExecutorAction]:
        """``clyde_pose`` and those of the other ghosts."""
        x, y, _ = pose_of(message)
        self.view.see_ghost(number, x, y, nanoseconds_of(message.header.stamp) or int(now * 1e9))
        return []

    def on_clyde_speed(self, message: Any, now: float) -> list[ExecutorAction]:
        """``clyde/speed``."""
        self.view.clyde_speed_mps = number_of(message, 0.0, MAX_SPEED_MPS)
        return []

    # Where the robot is

    def on_initial_pose(self, message: Any, now: float) -> list[ExecutorAction]:
        """``initialpose``: who corrects the robot's pose in the menu says where its home is, unless that was given."""
        pose = pose_of(message)
        if self.view.off_the_map(*pose[:2]):
            raise BadMessage(f"({pose[0]:.2f}, {pose[1]:.2f}) is off the map")
        if self.executor.game_state == "menu" and not self._home_given:
            self.executor.home = Home(*pose)
        return []

    def on_amcl(self, message: Any, now: float) -> list[ExecutorAction]:
        """``amcl_pose``."""
        self._believed.latched(message)
        return []

    def on_transforms(self, message: Any, now: float) -> list[ExecutorAction]:
        """``tf``."""
        for trouble in self._believed.transforms(message, now):
            self._warn("bad tf", trouble)
        return []

    def on_static_transforms(self, message: Any, now: float) -> list[ExecutorAction]:
        """``tf_static``."""
        for trouble in self._believed.transforms(message, now, static=True):
            self._warn("bad tf_static", trouble)
        return []

    def _believe(self, now: float) -> Belief | None:
        """The pose to decide by, if there is one on the map."""
        belief = self._believed.at(now)
        if belief is not None and self.view.off_the_map(*belief.pose[:2]):
            x, y, _ = belief.pose
            self._warn("off the map", f"{belief.source}: ({x:.2f}, {y:.2f}) is off the map")
            belief = None
        self._belief = belief
        if belief is not None:
            self.executor.pose = belief.pose[:2]
        state = self.executor.game_state
        if self.executor.home is None and belief is not None and state is not None:
            # After a start in the middle of a round the pose is anywhere.
            self.executor.home = Home(*(belief.pose if state == "menu" else self.view.assets.grid.home.tolist()))
        return belief

    # Choosing

    def decide(self, now: float, do: Callable[[list[ExecutorAction]], None]) -> None:
        """Look at the rules, and choose where a choice is wanted; ``do`` is called with what is to be done.

        The policy is asked where ``config.decisions`` says that a decision is due; until then its last choice is made
        again at each look, as in the simulator.
        """
        began = self._perf_counter()
        belief = self._believe(now)
        do(self.executor.look(None if belief is None else belief.pose[:2], self.view.ghosts, now))
        self.seen = None
        if belief is None or not self.executor.wants_choice(now):
            return
        unseen = self.view.unseen
        if unseen:
            self._warn(f"no {unseen[0]}", f"nothing is chosen as long as {unseen[0]}_pose has not been heard")
            return
        seen = Seen(
            time_s=now - self.executor.began_s,
            pose=belief.pose,
            left=self.executor.left,
            velocity=belief.velocity,
            pose_age_s=belief.age_s,
            masked=self.executor.masked(now),
            pursued=self.executor.pursued,
        )
        situation = self.view.situation(seen)  # of every look: it counts them, and watches how fast Clyde comes
        moment = Moment(now, seen.pursued, seen.left, self._distance(belief))
        due = self._last.due(moment)
        if due:
            chosen = int(self.policy.select(situation)[0])
            allowed = bool(situation.mask[0, chosen])
            self._last.decide(HOLD if chosen == self.view.hold else chosen, moment, allowed)
        choice = self._last.choice
        do(self.executor.choose(None if choice == HOLD else self.view.goal(choice), now))
        if due:
            self._times.add(self._perf_counter() - began)
            self.seen = situation, chosen

    def _distance(self, belief: Belief) -> float:
        """From the believed pose to the nearest ghost, m."""
        return min(math.dist(belief.pose[:2], ghost) for ghost in self.view.ghosts)

    def on_rejected(self, number: int, now: float) -> list[ExecutorAction]:
        """Nav2 has not taken a goal up."""
        self._ended["rejected"] += number == self.executor.sent.number
        return self.executor.rejected(number, now)

    def on_finished(self, number: int, status: int, now: float, seen: Position | None) -> list[ExecutorAction]:
        """A goal has ended; ``seen`` is where Nav2 saw the robot last."""
        self._believe(now)
        self._ended["aborted"] += number == self.executor.sent.number and status == ABORTED
        return self.executor.finished(number, status, now, seen)

    def condition(self, now: float) -> dict[str, Any]:
        """Everything that an operator may want to know, plain values."""
        belief, executor = self._belief, self.executor
        metadata = getattr(self.policy, "metadata", None)
        return {
            "policy": self.spec,
            "policy_version": __version__ if metadata is None else f"{metadata.package_version} {metadata.commit}",
            "package_version": __version__,
            "map": self.view.assets.occupancy.name,
            "state": executor.game_state,
            "task": executor.task,
            "home": None if executor.home is None else [executor.home.x, executor.home.y, executor.home.heading],
            "pose": None if belief is None else list(belief.pose),
            "pose_source": None if belief is None else belief.source,
            "pose_age_s": None if belief is None else belief.age_s,
            **{
                name: None if name in self.view.unseen else place
                for name, place in zip(GHOST_NAMES, self.view.ghosts, strict=False)
            },
            "pellets_left": len(executor.left),
            "pellets_unreachable": self._out_of_reach(executor.left),
            "pellets_unknown": list(self._pellets.unknown[:20]),
            "pursued": executor.pursued,
            "masked": sorted(executor.masked(now)),
            "goals_sent": executor.sent.number,
            "goals_rejected": self._ended["rejected"],
            "goals_aborted": self._ended["aborted"],
            "decisions": self._times.summary(),
        }


def _listed(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers[:5])) + (", ..." if len(numbers) > 5 else "")
