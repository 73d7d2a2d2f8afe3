"""One robot's choosing of goals, from the messages that it hears to the actions that it takes.

Messages become a situation in ``robot_view.py``, the policy chooses, ``game/goal_executor.py`` says what follows from
choices and events. Nothing is published here: the node does what it is told, and gives the time.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from pacman_env import __version__
from pacman_env.config import MAX_SPEED_MPS, Config
from pacman_env.game.execution import ABORTED
from pacman_env.game.goal_executor import Action, Pursuit
from pacman_env.game.goals import Home
from pacman_env.policies.base import Policy
from pacman_env.policies.registry import make_policy
from pacman_env.ros import topics
from pacman_env.ros.messages import Pose, Position, nanoseconds_of, number_of, pellets_of, pose_of, word_of
from pacman_env.ros.selector.believed_pose import Belief, BelievedPose
from pacman_env.ros.selector.goal_scores import DecisionTimes
from pacman_env.sim.maps.assets import map_assets
from pacman_env.sim.observation.robot_view import LiveGame, Pellets, Seen
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
        home: the home pose; None: the first one in menu, or the map's.
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
        self._config = config
        self._warn = warn
        self.live = LiveGame(map_assets(map, self._config, home), self._config)
        self.pursuit = Pursuit(
            self._config, None if home is None else Home(*home), min_dwell_s=config.execution.min_dwell_s
        )
        self.spec, self.policy = policy, self.load(policy)
        self.seen: tuple[Situation, int] | None = None  # at the last choice, and the candidate chosen
        self._believed = BelievedPose(pose_timeout_s)
        self._belief: Belief | None = None
        self._pellets = Pellets({}, ())
        self._times = DecisionTimes()
        self._ended = {"aborted": 0, "rejected": 0}

    def load(self, spec: str) -> Policy:
        """Another policy, with all that a decision needs compiled and loaded before the first one counts.

        Raises:
            ValueError: it cannot be loaded or does not run; ModuleNotFoundError and TypeError likewise.
        """
        policy, live = make_policy(spec), self.live
        rehearsal = live.rehearsal()
        policy.reset(_ONE)
        policy.scores(rehearsal)
        policy.select(rehearsal)
        policy.reset(_ONE)
        x, y, heading = live.assets.grid.home.tolist()
        live.off_the_map(x, y)
        pursuit = Pursuit(self._config, Home(x, y, heading))
        pursuit.activate(0.0)
        pursuit.nav2(True, 0.0)
        pursuit.state("running", 0.0)
        pursuit.command("enable", 0.0)
        pursuit.look((x, y), (x + 9.0, y), 0.0)
        pursuit.choose(live.goal(0), 0.0)
        pursuit.finished(pursuit.number, ABORTED, 0.0)
        return policy

    # What the game says; callbacks raise BadMessage

    def on_state(self, message: Any, now: float) -> list[Action]:
        """``game_state``."""
        self._believe(now)
        return self.pursuit.state(word_of(message, topics.STATE_WORDS), now)

    def on_command(self, message: Any, now: float) -> list[Action]:
        """``game_command``."""
        word = word_of(message, topics.COMMAND_WORDS)
        if word == "reset_round" or (word == "enable" and self.pursuit.task != "play"):
            self.live.begin()
            self.policy.reset(_ONE)
        self._believe(now)
        return self.pursuit.command(word, now)

    def on_pellets(self, message: Any, now: float) -> list[Action]:
        """``pellet_markers``."""
        self._pellets = pellets = self.live.pellets(pellets_of(message))
        if pellets.strange:
            self._warn("strange pellets", f"pellets ignored, the map has none such there: {_listed(pellets.strange)}")
        beyond = self._out_of_reach(pellets.known)
        if beyond:
            self._warn("pellets out of reach", f"pellets that the robot cannot drive to: {_listed(beyond)}")
        return self.pursuit.pellets(pellets.known, len(pellets.strange), now, beyond)

    def _out_of_reach(self, pellets: Iterable[int]) -> list[int]:
        return [number for number in pellets if not self.live.is_candidate(number)]

    def on_collected(self, message: Any, now: float) -> list[Action]:
        """``game/pellets_collected``."""
        self.pursuit.reports.counted(int(number_of(message, 0, 2**31 - 1)))
        return []

    def on_clyde(self, message: Any, now: float) -> list[Action]:
        """``clyde_pose``."""
        x, y, _ = pose_of(message)
        stamp_ns = nanoseconds_of(message.header.stamp)
        self.live.see_clyde(x, y, stamp_ns or int(now * 1e9))
        return []

    def on_clyde_speed(self, message: Any, now: float) -> list[Action]:
        """``clyde/speed``."""
        self.live.clyde_speed_mps = number_of(message, 0.0, MAX_SPEED_MPS)
        return []

    # Where the robot is

    def on_amcl(self, message: Any, now: float) -> list[Action]:
        """``amcl_pose``."""
        self._believed.latched(message)
        return []

    def on_transforms(self, message: Any, now: float) -> list[Action]:
        """``tf``."""
        for trouble in self._believed.transforms(message, now):
            self._warn("bad tf", trouble)
        return []

    def on_static_transforms(self, message: Any, now: float) -> list[Action]:
        """``tf_static``."""
        for trouble in self._believed.transforms(message, now, static=True):
            self._warn("bad tf_static", trouble)
        return []

    def _believe(self, now: float) -> Belief | None:
        """The pose to decide by, if there is one on the map."""
        belief = self._believed.at(now)
        if belief is not None and self.live.off_the_map(*belief.pose[:2]):
            x, y, _ = belief.pose
            self._warn("off the map", f"{belief.source}: ({x:.2f}, {y:.2f}) is off the map")
            belief = None
        self._belief = belief
        if belief is not None:
            self.pursuit.pose = belief.pose[:2]
        state = self.pursuit.game_state
        if self.pursuit.home is None and belief is not None and state is not None:
            # After a start in the middle of a round the pose is anywhere.
            self.pursuit.home = Home(*(belief.pose if state == "menu" else self.live.assets.grid.home.tolist()))
        return belief

    # Choosing

    def decide(self, now: float, do: Callable[[list[Action]], None]) -> None:
        """Look at the rules, and choose where a choice is wanted; ``do`` is called with what is to be done."""
        began = time.perf_counter()
        belief, clyde = self._believe(now), self.live.clyde
        do(self.pursuit.look(None if belief is None else belief.pose[:2], clyde, now))
        self.seen = None
        if belief is None or not self.pursuit.wants_choice(now):
            return
        if clyde is None:
            self._warn("no Clyde", "nothing is chosen as long as clyde_pose has not been heard")
            return
        situation = self.live.situation(
            Seen(
                time_s=self.pursuit.round_s(now),
                pose=belief.pose,
                left=self.pursuit.left,
                velocity=belief.velocity,
                pose_age_s=belief.age_s,
                barred=self.pursuit.barred(now),
                pursued=self.pursuit.pursued,
            )
        )
        chosen = int(self.policy.select(situation)[0])
        do(self.pursuit.choose(self.live.goal(chosen), now))
        self._times.add(time.perf_counter() - began)
        self.seen = situation, chosen

    def on_rejected(self, number: int, now: float) -> list[Action]:
        """Nav2 has not taken a goal up."""
        self._ended["rejected"] += number == self.pursuit.number
        return self.pursuit.rejected(number, now)

    def on_finished(self, number: int, status: int, now: float, seen: Position | None) -> list[Action]:
        """A goal has ended; ``seen`` is where Nav2 saw the robot last."""
        self._believe(now)
        self._ended["aborted"] += number == self.pursuit.number and status == ABORTED
        return self.pursuit.finished(number, status, now, seen)

    def condition(self, now: float) -> dict[str, Any]:
        """Everything that an operator may want to know, plain values."""
        belief, pursuit = self._belief, self.pursuit
        sidecar = getattr(self.policy, "sidecar", None)
        return {
            "policy": self.spec,
            "policy_version": __version__ if sidecar is None else f"{sidecar.package_version} {sidecar.commit}",
            "package_version": __version__,
            "map": self.live.assets.occupancy.name,
            "state": pursuit.game_state,
            "task": pursuit.task,
            "home": None if pursuit.home is None else [pursuit.home.x, pursuit.home.y, pursuit.home.heading],
            "pose": None if belief is None else list(belief.pose),
            "pose_source": None if belief is None else belief.source,
            "pose_age_s": None if belief is None else belief.age_s,
            "clyde": self.live.clyde,
            "pellets_left": len(pursuit.left),
            "pellets_unreachable": self._out_of_reach(pursuit.left),
            "pellets_strange": list(self._pellets.strange[:20]),
            "pursued": pursuit.pursued,
            "barred": sorted(pursuit.barred(now)),
            "goals_sent": pursuit.number,
            "goals_rejected": self._ended["rejected"],
            "goals_aborted": self._ended["aborted"],
            "decisions": self._times.summary(),
        }


def _listed(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers[:5])) + (", ..." if len(numbers) > 5 else "")
