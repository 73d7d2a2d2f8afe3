"""Choice of goals for one robot, from received messages to actions.

``robot_view.py`` turns messages into a situation, the policy chooses, and ``game/goal_executor.py`` decides what
follows. Nothing is published here, and time is an argument.
"""

from collections import deque
from collections.abc import Callable, Iterable, Sequence
from typing import Any, Protocol

import numpy as np

from pacman_env import __version__
from pacman_env.config import MAX_SPEED_MPS, Config
from pacman_env.game.decisions import HOLD, LastDecision, Moment
from pacman_env.game.execution import ABORTED, REJECTED
from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.game.goal_executor import GoalExecutor
from pacman_env.game.goals import ExecutorAction, home_place
from pacman_env.game.power import HARMLESS_UNTIL
from pacman_env.levels.assets import map_assets
from pacman_env.observations.robot_view import RobotView, Seen
from pacman_env.observations.situation import Situation
from pacman_env.policies.base import Policy
from pacman_env.policies.policy_calls import PolicyError, choose, name_of, reset
from pacman_env.policies.registry import make_policy
from pacman_env.ros import topics
from pacman_env.ros.map_comparison import grid_of, map_differences
from pacman_env.ros.message_conversion import (
    BadMessage,
    Pose,
    Position,
    nanoseconds_of,
    number_of,
    pellets_of,
    pose_of,
    power_pellets_of,
    word_of,
)
from pacman_env.ros.selector.believed_pose import Belief, BelievedPose
from pacman_env.ros.selector.ghost_watch import GhostWatch
from pacman_env.ros.selector.goal_scores import decision_times
from pacman_env.ros.selector.nav2_failures import Nav2Failures
from pacman_env.ros.selector.pose_watch import PoseLimits, PoseWatch
from pacman_env.ros.selector.reasons import GHOST_LOST, NAV2_FAILS, POLICY_FAILS
from pacman_env.ros.selector.rehearsal import SLOW_S, rehearse
from pacman_env.ros.surroundings import current
from pacman_env.world.maps.occupancy import OccupancyMap


class Troubles(Protocol):
    """Receiver of troubles by kind and text: ``warning`` for short ones, ``begin`` and ``over`` for lasting ones."""

    def warning(self, key: str, text: str) -> None: ...

    def begin(self, key: str, text: str) -> None: ...

    def over(self, key: str) -> None: ...


class Selection:
    """Choice of goals by a rehearsed policy on a prepared map.

    Message handlers return the actions to perform, and raise BadMessage; ``now`` is the node's time, s.

    Without ``home``, the home is the robot's pose when it first leaves the menu, or leaves it after a person has set
    the pose in the menu: AMCL has corrected a clicked pose by then. After a start in the middle of a game, the map's
    home is used. Raises MapError, and the exceptions of ``make_policy`` and ``rehearse``.
    """

    def __init__(
        self,
        config: Config,
        map: str | OccupancyMap,
        policy: str,
        home: Pose | None,
        limits: PoseLimits,
        troubles: Troubles,
    ) -> None:
        self._warn, self._perf_counter = troubles.warning, current().perf_counter
        self._troubles = troubles
        self._config = config
        self._home_given = self._home_known = home is not None
        instance = make_policy(policy)  # refuses an unusable policy before anything is compiled
        self.view = RobotView(map_assets(map, config, home), config)
        self.executor = GoalExecutor(config, self.view.goals, None if home is None else home_place(*home))
        self._fresh = False  # True once the policy has been reset for this round
        self.spec, self.policy = policy, rehearse(instance, self.view, config, self._perf_counter)
        self.decision: tuple[Situation, int] | None = None  # set if the last ``decide`` called the policy
        self._believed = BelievedPose(limits.timeout_s)
        self._ghosts = GhostWatch()
        self._watch = PoseWatch(self._believed, limits)
        self._nav2 = Nav2Failures()
        self._collected = 0  # pellets collected in the round until the last ``decide``
        self._belief: Belief | None = None
        self._unknown_pellets: tuple[int, ...] = ()
        self._times_ms: deque[float] = deque(maxlen=1000)
        self._last = LastDecision(config)
        self._ended = {"aborted": 0, "rejected": 0}

    # The game's messages

    def on_state(self, message: Any, now: float) -> list[ExecutorAction]:
        self._believe(now)
        word = word_of(message, topics.STATE_WORDS)
        if word != "menu" and self.executor.home is not None:
            self._home_known = True
        return self.executor.state(word, now)

    def on_command(self, message: Any, now: float) -> list[ExecutorAction]:
        word = word_of(message, topics.COMMAND_WORDS)
        if word == "reset_round" or (word == "enable" and self.executor.task != "play"):
            self.view.begin()
            self._fresh = False
            self._last.clear()
            self._nav2.reset()
        self._believe(now)
        return self.executor.command(word, now)

    def on_pellets(self, message: Any, now: float) -> list[ExecutorAction]:
        pellets = self.view.pellets(pellets_of(message), power_pellets_of(message))
        self._unknown_pellets = unknown = pellets.unknown
        if unknown:
            self._warn("unknown pellets", f"pellets ignored, the map has none such there: {_list_of(unknown)}")
        if unreachable := self._out_of_reach(pellets.known):
            self._warn("pellets out of reach", f"pellets that the robot cannot drive to: {_list_of(unreachable)}")
        return self.executor.pellets(pellets.known, len(unknown), now)

    def _out_of_reach(self, pellets: Iterable[int]) -> list[int]:
        return [number for number in pellets if not self.view.is_candidate(number)]

    def on_count(self, use: Callable[[int], None], least: int, message: Any, now: float) -> None:
        """Pass the number in a referee's message to ``use``; BadMessage if it is below ``least``."""
        use(int(number_of(message, least, 2**31 - 1)))

    def on_spawned(self, message: Any, now: float) -> None:
        self.executor.statuses.spawned = int(number_of(message, 0, 2**31 - 1))

    def on_ghost(self, number: int, message: Any, now: float) -> None:
        x, y, _ = pose_of(message)
        self._ghosts.see(number, now)
        self.view.see_ghost(number, x, y, nanoseconds_of(message.header.stamp) or int(now * 1e9))

    def on_clyde_speed(self, message: Any, now: float) -> None:
        self.view.clyde_speed_mps = number_of(message, 0.0, MAX_SPEED_MPS)

    # Where the robot is

    def on_initial_pose(self, message: Any, now: float) -> None:
        """Note a pose that a person has set. In the menu the home then follows the pose, unless a home was given."""
        pose = pose_of(message)
        if self.view.off_the_map(*pose[:2]):
            raise BadMessage(f"({pose[0]:.2f}, {pose[1]:.2f}) is off the map")
        self._watch.expect_jump_to(pose)
        if self.executor.game_state == "menu":
            self._home_known = self._home_given

    def on_map(self, message: Any, now: float) -> None:
        """Compare the map of localization, to which the pose refers, with the map of the game."""
        try:
            differences = map_differences(grid_of(message), self.view.assets.occupancy)
        except ValueError as error:
            raise BadMessage(str(error)) from None
        self._watch.other_map = "; ".join(differences)

    @property
    def jump(self) -> str:
        """Text of the pose jump that a person must answer; empty if there is none."""
        return self._watch.jump

    def resume(self, jump: str) -> None:
        """Restore the text of a pose jump that no person answered in an earlier process."""
        self._watch.jump = jump

    def accept_pose(self) -> None:
        self._watch.accept()

    def on_amcl(self, message: Any, now: float) -> None:
        self._believed.latched(message)

    def on_transforms(self, message: Any, now: float, static: bool = False) -> None:
        for trouble in self._believed.transforms(message, now, static):
            self._warn("bad tf_static" if static else "bad tf", trouble)

    def watch(self, now: float) -> list[ExecutorAction]:
        """Hold while the pose is not trusted or a ghost is lost; call this after new transforms were handled."""
        actions: list[ExecutorAction] = []
        self._watch.check(now)
        # Begin holds before ending others: if one reason replaces another, no goal is sent in between.
        reasons = {**self._watch.reasons(now), GHOST_LOST: self._ghosts.lost(now) if self.executor.playing else ""}
        for reason, words in sorted(reasons.items(), key=lambda pair: not pair[1]):
            self._report(reason, words)
            actions += self.executor.hold(reason, bool(words), now)
        return actions

    def _believe(self, now: float) -> Belief | None:
        """Update and return the pose for decisions; None if it is not trusted or off the map."""
        belief = None if any(self._watch.reasons(now).values()) else self._believed.at(now)
        if belief is not None and self.view.off_the_map(*belief.pose[:2]):
            x, y, _ = belief.pose
            self._warn("off the map", f"{belief.source}: ({x:.2f}, {y:.2f}) is off the map")
            belief = None
        self._belief = belief
        if belief is not None:
            self.executor.pose = belief.pose[:2]
        state = self.executor.game_state
        if not self._home_known and belief is not None and state is not None:
            # After a start in the middle of a round the robot may be anywhere.
            home = belief.pose if state == "menu" else self.view.assets.grid.home.tolist()
            self.executor.home, self._home_known = home_place(*home), state != "menu"
        return belief

    # Choosing

    def decide(self, now: float, do: Callable[[list[ExecutorAction]], None]) -> None:
        """Apply the rules at the time ``now``, s, choose a goal if one is needed, and pass the actions to ``do``.

        The policy is called only if a decision is due (``game/decisions.py``). Otherwise its last choice is repeated,
        as in the simulator.
        """
        start_s = self._perf_counter()
        belief = self._believe(now)
        do(self.executor.check(None if belief is None else belief.pose[:2], self.view.ghosts, now))
        self.decision = None
        self._watch_nav2()
        if belief is None or not self.executor.wants_choice(now) or self._nav2.waiting(now):
            return
        missing = self.view.unseen
        if missing:
            self._warn(f"no {missing[0]}", f"no goal is chosen until {missing[0]}_pose is received")
            return
        times = self.executor.round.ghosts[: len(self.view.ghosts), HARMLESS_UNTIL:]
        seen = Seen(
            time_s=now - self.executor.began_s,
            pose=belief.pose,
            left=self.executor.round.left,
            velocity=belief.velocity,
            pose_age_s=belief.age_s,
            masked=self.executor.round.masked(now),
            pursued=self.executor.sent.pursued,
            harmless_s=np.maximum(times - now, 0.0) if self._config.power.pellets > 0 else None,
        )
        situation = self.view.situation(seen)  # even if no decision is due: it measures Clyde's approach
        news = seen.left, self.executor.round.record.caught
        moment = Moment(now, seen.pursued, news, self.view.nearest_ghost_m(belief.pose[:2]))
        due = self._last.due(moment)
        if due:
            try:
                chosen = _ask(self.policy, situation, None if self._fresh else self._config, self._perf_counter)
                self._fresh = True
            except PolicyError as error:  # the robot holds, and the policy may work at the next tick
                self._report(POLICY_FAILS, f"{error}; the robot holds")
                self._last.decide(HOLD, moment, allowed=False)
                do(self.executor.choose(None, now))
                return
            self._report(POLICY_FAILS, "")
            allowed = bool(situation.mask[0, chosen])
            self._last.decide(HOLD if chosen == self.view.hold else chosen, moment, allowed)
        choice = self._last.choice
        do(self.executor.choose(None if choice == HOLD else self.view.goal(choice), now))
        if due:
            self._times_ms.append(1000 * (self._perf_counter() - start_s))
            self.decision = situation, chosen

    def on_rejected(self, number: int, now: float) -> list[ExecutorAction]:
        self._ended["rejected"] += number == self.executor.sent.number
        self._count(number, REJECTED, 0, now)
        return self.executor.rejected(number, now)

    def on_finished(
        self, number: int, status: int, error: int, now: float, at: Position | None
    ) -> list[ExecutorAction]:
        """Handle the end of a goal: ``error`` is Nav2's code, ``at`` the last position that Nav2 reported."""
        self._believe(now)
        self._ended["aborted"] += number == self.executor.sent.number and status == ABORTED
        self._count(number, status, error, now)
        return self.executor.finished(number, status, now, at)

    def _count(self, number: int, status: int, error: int, now: float) -> None:
        sent = self.executor.sent
        if number == sent.current and number in sent.open:  # a goal that was given up also ends as aborted
            self._nav2.ended(status, error, now - sent.open[number].since_s, now)
            self._watch_nav2()

    def _watch_nav2(self) -> None:
        """Report that Nav2 fails repeatedly, until the robot reaches a goal or collects a pellet."""
        previous, self._collected = self._collected, self.executor.round.record.collected
        if self._collected > previous:
            self._nav2.reset()
        self._report(NAV2_FAILS, self._nav2.words)

    def _report(self, trouble: str, words: str) -> None:
        """Report that a trouble lasts, or that it is over if ``words`` is empty."""
        if words:
            self._troubles.begin(trouble, words)
        else:
            self._troubles.over(trouble)

    def condition(self, now: float) -> dict[str, Any]:
        """Return the diagnostics for operators, as plain values."""
        belief, executor, home = self._belief, self.executor, self.executor.home
        ghosts = dict(zip(GHOST_NAMES, self.view.ghosts, strict=False))
        metadata = getattr(self.policy, "metadata", None)
        return {
            "policy": self.spec,
            "policy_version": __version__ if metadata is None else f"{metadata.package_version} {metadata.commit}",
            "package_version": __version__,
            "map": self.view.assets.occupancy.name,
            "state": executor.game_state,
            "task": executor.task,
            "home": None if home is None else [home.x, home.y, home.heading],
            "pose": None if belief is None else list(belief.pose),
            "pose_source": None if belief is None else belief.source,
            "pose_age_s": None if belief is None else belief.age_s,
            **{name: None if name in self.view.unseen else at for name, at in ghosts.items()},
            "pellets_left": len(executor.round.left),
            "pellets_unreachable": self._out_of_reach(executor.round.left),
            "pellets_unknown": list(self._unknown_pellets[:20]),
            "pursued": executor.sent.pursued,
            "masked": sorted(executor.round.masked(now)),
            "goals_sent": executor.sent.number,
            "goals_rejected": self._ended["rejected"],
            "goals_aborted": self._ended["aborted"],
            "decisions": decision_times(self._times_ms),
        }


def _ask(policy: Policy, situation: Situation, begins: Config | None, clock_s: Callable[[], float]) -> int:
    """Return the policy's choice; raises PolicyError if the policy fails or is slow.

    If ``begins`` is a configuration, a round with it begins, and the policy is reset first.
    """
    start_s = clock_s()
    if begins is not None:
        reset(policy, np.ones(1, np.bool_), begins)
    chosen = int(choose(policy, situation)[0])
    if clock_s() - start_s > SLOW_S:
        raise PolicyError(f"policy {name_of(policy)!r}: takes more than {SLOW_S:g} s to choose")
    return chosen


def _list_of(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers[:5])) + (", ..." if len(numbers) > 5 else "")
