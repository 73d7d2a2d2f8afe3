"""Choose goals for one robot and let Nav2 drive to them, in our own or in a foreign game.

``game/goal_executor.py`` decides what follows from an event, ``policy_process.py`` asks the policy. No method blocks.
"""

import math
from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

import numpy as np
from rcl_interfaces.msg import ParameterDescriptor
from rclpy.parameter import Parameter

from pacman_env.config import Config
from pacman_env.game.decisions import HOLD, LastDecision, Moment
from pacman_env.game.execution import REJECTED
from pacman_env.game.goal_executor import GoalExecutor
from pacman_env.game.goals import ExecutorAction, Place, home_place
from pacman_env.game.power import HARMLESS_UNTIL
from pacman_env.levels.assets import map_assets
from pacman_env.observations.robot_view import RobotView, Seen
from pacman_env.observations.situation import Situation
from pacman_env.ros.configured_node import ConfiguredNode
from pacman_env.ros.message_conversion import Pose, Position
from pacman_env.ros.rclpy_private import accept_integers
from pacman_env.ros.selector import goal_scores
from pacman_env.ros.selector.asked_policy import AskedPolicy
from pacman_env.ros.selector.nav2_failures import Nav2Failures
from pacman_env.ros.selector.navigation_client import NavigationClient
from pacman_env.ros.selector.policy_child import ROBOT, Answer
from pacman_env.ros.selector.pose_topics import PoseTopics
from pacman_env.ros.selector.robot_pose import Belief, PoseLimits
from pacman_env.ros.selector.shadow import Shadow

STOPPED = "stopped by the operator"

_REPORTS = ("status", "remove", "event")
#: Takes reports of a goal selector that belong together: each a ``status``, a pellet to ``remove`` or an ``event``, and
#: its word or id.
Report = Callable[[Sequence[tuple[str, int | str]]], None]


def declare_home(node: ConfiguredNode) -> Pose | None:
    """Declare the parameter ``home`` and return the pose x, y, heading (m, m, rad); None if it is not set."""
    text = "home pose x, y, heading (m, m, rad); not set: where the robot first leaves the menu"
    accept_integers(node, "home")
    descriptor = ParameterDescriptor(description=text, read_only=True)
    home = node.declare_parameter("home", Parameter.Type.DOUBLE_ARRAY, descriptor).value
    if home is None:
        return None
    if len(home) != 3:
        raise ValueError(f"parameter home: {len(home)} numbers, must be x, y, heading")
    return home[0], home[1], home[2]


class GoalSelector:
    """One robot's choice of goals; ``navigate`` makes the client of Nav2, or of a shadow.

    ``report`` tells the game what happens: by calls in our own game, by topics in a foreign one.

    Without ``home``, the home is the robot's pose when it first leaves the menu, or leaves it after a person has set
    the pose in the menu: AMCL has corrected a clicked pose by then. After a start in the middle of a game, the map's
    home is used.
    """

    def __init__(
        self,
        node: ConfiguredNode,
        config: Config,
        policy: AskedPolicy,
        report: Report,
        home: Pose | None,
        limits: PoseLimits,
        navigate: Callable[..., NavigationClient | Shadow] = NavigationClient,
    ) -> None:
        self._node, self._config, self.policy, self._report = node, config, policy, report
        self.view = RobotView(map_assets(node.map, config, home), config)
        self.view.compile_kernels()
        self.executor = GoalExecutor(config, self.view.goals, None if home is None else home_place(*home))
        self.pose = PoseTopics(node, self.view, limits)
        self._home_given = self._home_known = home is not None
        self.belief: Belief | None = None
        self.nav2 = navigate(node, self._on_accepted, self._on_rejected, self._on_finished)
        self.failures = Nav2Failures(node.once)
        self._cleared = False  # True once all earlier goals have been cancelled
        self._last = LastDecision(config)
        self._begins = True  # the policy has not been asked in this round
        self._asked: tuple[int, Situation, Moment] | None = None  # the open question
        self.unknown_pellets: tuple[int, ...] = ()
        self._explanations = goal_scores.Explanations(node, self.view)

    @property
    def missing(self) -> str:
        """Return the reason why no round can begin, or ""."""
        return "the robot has no pose yet" if self.executor.pose is None else ""

    # What the game says

    def on_state(self, word: str) -> None:
        self.update_pose()
        now = self._node.now_s()
        self._believe(now)
        if word != "menu" and self.executor.home is not None:
            self._home_known = True
        self._do(self.executor.state(word, now))

    def on_command(self, word: str) -> None:
        if word == "reset_round" or (word == "enable" and self.executor.task != "play"):
            self.view.begin()
            self._begins, self._asked = True, None
            self._last.clear()
            self.failures.reset()
        self.update_pose()
        now = self._node.now_s()
        self._believe(now)
        self._do(self.executor.command(word, now))

    def on_clyde_speed(self, mps: float) -> None:
        self.view.clyde_speed_mps = mps

    def see_ghosts(self, places: Sequence[Position], stamp_ns: int) -> None:
        for number, (x, y) in enumerate(places):
            self.view.see_ghost(number, x, y, stamp_ns)

    def on_pellets(self, left: Mapping[int, Position], power: Collection[int]) -> None:
        """Use the pellets that are left, as positions (m) by id, and which of them are ``power`` pellets."""
        pellets = self.view.pellets(left, power)
        self.unknown_pellets = pellets.unknown
        if pellets.unknown:
            words = f"pellets ignored, the map has none such there: {_list_of(pellets.unknown)}"
            self._node.once.warning("unknown pellets", words)
        if unreachable := self.view.out_of_reach(pellets.known):
            words = f"pellets that the robot cannot drive to: {_list_of(unreachable)}"
            self._node.once.warning("pellets out of reach", words)
        self.executor.round.report(pellets.known, len(pellets.unknown))

    def stop(self, stopped: bool, who: str) -> None:
        """Stop the robot and cancel the goals of all nodes; allow no goal until the release."""
        self.nav2.forbid(stopped)
        self.hold(STOPPED, f"stopped by {who}: no goal is sent until it is released" if stopped else "")

    def on_continue(self, request: Any, response: Any) -> Any:
        """Accept the pose after a jump; callback of the service."""
        self.update_pose()
        jump = self.pose.watch.jump
        self.pose.watch.accept()
        self.update_pose()
        response.success = bool(jump)
        refusal = "the pose has not jumped: there is nothing to confirm"
        response.message = f"continues although the {jump}" if jump else refusal
        return response

    def hold(self, reason: str, words: str) -> None:
        """Stand still for a reason that ``words`` describe; empty words end it."""
        if words:
            self._node.once.begin(reason, words)
        else:
            self._node.once.over(reason)
        self._do(self.executor.hold(reason, bool(words), self._node.now_s()))

    # Life

    def activate(self, active: bool) -> None:
        """Begin to drive, or cancel all goals and stop; the task is kept."""
        now = self._node.now_s()
        self._do(self.executor.activate(now) if active else self.executor.deactivate(now))

    def close(self) -> tuple[Any, ...]:
        """Stop the robot at the end of the process; return what to wait for."""
        self.activate(False)
        return self.nav2.finish()

    def snapshot(self) -> dict[str, Any]:
        """Return what ``restore`` needs, as JSON values."""
        now, home = self._node.now_s(), self.executor.home
        return {
            "home": None if home is None or not self._home_known else [home.x, home.y, home.heading],
            "jump": self.pose.watch.jump,
            "harmless_s": self.executor.round.harmless_s(now),
            "round_s": now - self.executor.began_s,
        }

    def restore(self, saved: Mapping[str, Any], collected: Collection[int], caught: int) -> None:
        """Resume the game of an earlier process, which has counted the pellets ``collected`` and ``caught`` ghosts.

        Raises an exception for something else.
        """
        home, jump, now = saved["home"], str(saved["jump"])[:500], self._node.now_s()
        self.executor.round.restore(collected, caught, saved["harmless_s"], now)
        self.executor.began_s = now - float(saved["round_s"])
        if home is not None and not self._home_given:
            x, y, heading = map(float, home)
            self.executor.home, self._home_known = home_place(x, y, heading), True
        self.pose.watch.jump = jump

    # Decisions

    def tick(self) -> None:
        """Apply the rules to the newest pose, and choose a goal if a decision is due (``game/decisions.py``)."""
        self.update_pose()
        now, once = self._node.now_s(), self._node.once
        self._cleared = self._cleared or self.nav2.clear()
        if self.nav2.ready:
            once.over("no Nav2")
        else:
            once.warning("no Nav2", "no action server navigate_to_pose")
        self._do(self.executor.nav2(self.nav2.ready and self._cleared, now))
        belief = self._believe(now)
        self._do(self.executor.check(None if belief is None else belief.pose[:2], self.view.ghosts, now))
        self.failures.progress(self.executor.round.record.collected)
        if belief is not None and self.executor.wants_choice(now) and not self.failures.waiting(now):
            self._decide(belief, now)

    def update_pose(self) -> None:
        """Hold while the pose is not trusted; called before everything that uses the pose."""
        # Begin holds before ending others: if one reason replaces another, no goal is sent in between.
        for reason, words in sorted(self.pose.update().items(), key=lambda pair: not pair[1]):
            self.hold(reason, words)

    def _decide(self, belief: Belief, now: float) -> None:
        """Ask the policy if a decision is due; otherwise repeat its last choice, as in the simulator."""
        if missing := self.view.unseen:
            self._node.once.warning(f"no {missing[0]}", f"no goal is chosen until {missing[0]}_pose is received")
            return
        playing = self.executor.round
        times = playing.ghosts[: len(self.view.ghosts), HARMLESS_UNTIL:]
        seen = Seen(
            time_s=now - self.executor.began_s,
            pose=belief.pose,
            left=playing.left,
            velocity=belief.velocity,
            pose_age_s=belief.age_s,
            masked=playing.masked(now),
            pursued=self.executor.sent.pursued,
            harmless_s=np.maximum(times - now, 0.0) if self._config.power.pellets > 0 else None,
        )
        situation = self.view.situation(seen)  # even if no decision is due: it measures Clyde's approach
        news = seen.left, playing.record.caught
        moment = Moment(now, seen.pursued, news, self.view.nearest_ghost_m(belief.pose[:2]))
        if not self._last.due(moment):
            self._pursue_choice(now)
        elif self.policy.process.ready and self._asked is None:
            shown = self._explanations
            number = self.policy.process.ask(
                ROBOT, situation, self._begins, shown.scores_are_wanted, shown.why_is_wanted
            )
            self._asked = number, situation, moment
            self.policy.asked()

    def on_answer(self, answer: Answer) -> None:
        """Use an answer of the policy: send its goal, or hold if the policy failed."""
        asked, now = self._asked, self._node.now_s()
        if answer.error:
            self._asked = None
            self._begins = True  # the policy that answers next is a new one
            self._last.clear()
            self._do(self.executor.choose(None, now))
        elif asked is not None and asked[0] == answer.number:
            _, situation, moment = asked
            self._asked, self._begins = None, False
            chosen = answer.choice[0]
            allowed = bool(situation.mask[0, chosen])
            self._last.decide(HOLD if chosen == self.view.hold else chosen, moment, allowed)
            self._pursue_choice(now)
            self._explanations.publish(answer, situation)

    def _pursue_choice(self, now: float) -> None:
        choice = self._last.choice
        self._do(self.executor.choose(None if choice == HOLD else self.view.goal(choice), now))

    def _believe(self, now: float) -> Belief | None:
        """Update and return the pose for decisions; None if it is not trusted. The home may follow it."""
        self.belief = belief = self.pose.trusted(now)
        state = self.executor.game_state
        if self.pose.was_set and state is not None:
            self.pose.was_set = False
            if state == "menu":
                self._home_known = self._home_given
        if belief is None:
            return None
        self.executor.pose = belief.pose[:2]
        if not self._home_known and state is not None:
            # After a start in the middle of a round the robot may be anywhere.
            home = belief.pose if state == "menu" else self.view.assets.grid.home.tolist()
            self.executor.home, self._home_known = home_place(*home), state != "menu"
        return belief

    # Nav2

    def _on_accepted(self, number: int) -> None:
        self._do(self.executor.sent.accepted(number, self._node.now_s()))

    def _on_rejected(self, number: int) -> None:
        self._node.get_logger().warning(f"goal {number} was rejected")
        self._count(number, REJECTED)
        self._do(self.executor.rejected(number, self._node.now_s()))

    def _on_finished(self, number: int, status: int, at: Position | None) -> None:
        self.update_pose()
        self._believe(self._node.now_s())
        self._count(number, status)
        self._do(self.executor.finished(number, status, self._node.now_s(), at))

    def _count(self, number: int, status: int) -> None:
        sent, now = self.executor.sent, self._node.now_s()
        if number == sent.current and number in sent.open:  # a goal that was given up also ends as aborted
            self.failures.ended(status, self.nav2.last_error, now - sent.open[number].since_s, now)

    # Actions

    def _do(self, actions: Sequence[ExecutorAction]) -> None:
        if reports := [(action.kind, action.value) for action in actions if action.kind in _REPORTS]:
            self._report(reports)
        for action in actions:
            if action.kind == "ignored":
                self._node.once.warning(str(action.value), f"{action.value} is ignored")
            elif action.place is not None:
                self._node.get_logger().info(f"goal {action.value}: {_words(action.place)}")
                self.nav2.send(int(action.value), _pose_at(action.place, self.executor.pose))
            elif action.kind == "cancel":
                self.nav2.cancel(int(action.value))
            elif action.kind == "stop":
                self.nav2.stop_wheels()


def _pose_at(place: Place, start: Position | None) -> Pose:
    """Return the pose in which the robot arrives at a place: without a heading, the direction from its start."""
    x, y = start or (place.x, place.y)
    return place.x, place.y, math.atan2(place.y - y, place.x - x) if place.heading is None else place.heading


def _words(place: Any) -> str:
    what = "home" if place.heading is not None else "a refuge" if place.pellet is None else f"pellet {place.pellet}"
    return f"{what} at ({place.x:.2f}, {place.y:.2f})"


def _list_of(numbers: Sequence[int]) -> str:
    return ", ".join(map(str, numbers[:5])) + (", ..." if len(numbers) > 5 else "")
