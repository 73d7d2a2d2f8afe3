"""Subscriptions, publishers and Nav2 goals of a configured goal selector.

``selection.py`` decides which actions to perform and when.
"""

import math
from collections.abc import Callable
from functools import partial
from typing import Any

from std_msgs.msg import Float64MultiArray, Int32, String

from pacman_env.game.execution import CANCELED
from pacman_env.game.goals import ExecutorAction, Place
from pacman_env.game.power import HARMLESS_UNTIL
from pacman_env.observations.situation import Situation
from pacman_env.policies.policy_calls import PolicyError, name_of, scores, what_users_raise
from pacman_env.ros import topics
from pacman_env.ros.discovery import costmaps_without
from pacman_env.ros.message_conversion import Position, twist_message
from pacman_env.ros.node import GameNode
from pacman_env.ros.operator_stop import OperatorStop
from pacman_env.ros.selector import goal_scores
from pacman_env.ros.selector.message_queue import MessageQueue
from pacman_env.ros.selector.nav2_failures import error_words
from pacman_env.ros.selector.navigation_client import NavigationClient
from pacman_env.ros.selector.saved_jump import SavedJump
from pacman_env.ros.selector.selection import Selection

_STOPPED = "stopped by the operator"
_REPEAT_S = 2.0  # wall time, because a restart of the referee takes wall time
_NAV2_CHECK_S = 0.5  # wall time, shorter than any restart of a simulated robot
_PUBLISHED = (
    *(topics.GAME_STATUS, topics.GAME_EVENT, topics.REMOVE_PELLET, topics.CMD_VEL),
    *(topics.SCORES, topics.WHY, topics.CANDIDATES, topics.DIAGNOSTICS),
)
_Actions = list[ExecutorAction] | None


class GoalDriver:
    """ROS entities of a configured node and their callbacks; if ``passive``, it decides and logs but sends nothing."""

    def __init__(
        self, node: GameNode, selection: Selection, jump: SavedJump, diagnostics_rate: float, passive: bool
    ) -> None:
        self._node, self.selection, self._passive = node, selection, passive
        self._executor = selection.executor
        self._jump = jump
        selection.resume(jump.load())
        self._tick_timer: Any = None  # None while the node is inactive
        self._fresh = False  # True between the activation and the first tick
        self._shown_ready = False  # value of ``nav2`` in the last diagnostics
        self._cleared = False  # True once all earlier goals have been cancelled
        power = node.config.power.pellets > 0
        published = (*_PUBLISHED, topics.HARMLESS_GHOSTS) if power and not passive else _PUBLISHED
        self._out = {topic.name: topic.publisher(node) for topic in published}
        self._ghost_times: list[float] = []  # the times that were last published
        self._nav2 = NavigationClient(node, self._on_accepted, self._on_rejected, self._on_finished)
        self._operator = None if passive else OperatorStop(node, self._on_stop)
        self._publish_json(topics.CANDIDATES, goal_scores.candidates_of(selection.view.assets))
        ghosts = topics.GHOST_POSES[: len(node.config.clyde.ghosts)]
        statuses = self._executor.statuses
        power_handlers = (
            (topics.ROUND, partial(selection.on_count, self._executor.round.begin, 1)),
            (topics.GHOSTS_CAUGHT, partial(selection.on_count, statuses.catches_counted, 0)),
        )
        handlers: tuple[tuple[topics.Topic, Callable[[Any, float], _Actions]], ...] = (
            (topics.GAME_STATE, selection.on_state),
            (topics.GAME_COMMAND, selection.on_command),
            (topics.PELLET_MARKERS, selection.on_pellets),
            (topics.PELLETS_SPAWNED, selection.on_spawned),
            (topics.PELLETS_COLLECTED, partial(selection.on_count, statuses.counted, 0)),
            *(power_handlers if power else ()),
            *((topic, partial(selection.on_ghost, k)) for k, topic in enumerate(ghosts)),
            (topics.CLYDE_SPEED, selection.on_clyde_speed),
            (topics.AMCL_POSE, selection.on_amcl),
            (topics.INITIAL_POSE, selection.on_initial_pose),
            (topics.TF_STATIC, partial(selection.on_transforms, static=True)),
            (topics.MAP, selection.on_map),
        )
        self._subscriptions = [
            node.listen(topic, partial(self._handle, handle), f"bad {topic.name}") for topic, handle in handlers
        ]
        self._continue = topics.CONTINUE.server(node, self._on_continue)
        self._transforms = MessageQueue(
            node, topics.TF, lambda message, waited_s: selection.on_transforms(message, node.now_s() - waited_s)
        )
        wall = node.surroundings.clock()
        self._timers = [
            node.create_timer(1.0 / diagnostics_rate, self._publish_diagnostics),
            node.create_timer(_REPEAT_S, self._repeat, clock=wall),
        ]
        if node.get_parameter("use_sim_time").value:
            self._timers.append(node.create_timer(_NAV2_CHECK_S, self._check_nav2, clock=wall))

    def destroy(self) -> None:
        self._nav2.destroy()
        self._transforms.destroy()
        if self._operator is not None:
            self._operator.destroy(self._node)
        self._node.destroy_service(self._continue)
        for timer in self._timers:
            self._node.destroy_timer(timer)
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)
        for publisher in self._out.values():
            self._node.destroy_publisher(publisher)

    def activate(self) -> None:
        self._fresh = True
        self._tick_timer = self._node.create_timer(self._node.config.execution.tick_s, self._tick)

    def deactivate(self) -> None:
        if self._tick_timer is not None:
            self._node.destroy_timer(self._tick_timer)
            self._tick_timer = None
        self._do(self._executor.deactivate(self._node.now_s()))

    def last_messages(self) -> tuple[Any, ...]:
        if self._node.status is None:  # after a signal: the game ends, so the jump needs no answer
            self._jump.save("")
        if self._passive:
            return ()
        self.deactivate()
        self._stop()
        ended = self._nav2.finish()
        ended.add_done_callback(lambda _: self._stop())  # again, because Nav2 drove until it received the cancels
        return (ended,)

    # Messages

    def _catch_up(self) -> None:
        """Handle the waiting transforms first, so that everything else uses the newest pose."""
        self._transforms.catch_up()
        self._watch()

    def _watch(self) -> None:
        self._do(self.selection.watch(self._node.now_s()))
        self._jump.save(self.selection.jump)

    def _on_continue(self, request: Any, response: Any) -> Any:
        self._catch_up()
        jump = self.selection.jump
        self.selection.accept_pose()
        self._watch()
        response.success = bool(jump)
        refusal = "the pose has not jumped: there is nothing to confirm"
        response.message = f"continues although the {jump}" if jump else refusal
        return response

    def _handle(self, handle: Callable[[Any, float], _Actions], message: Any) -> None:
        self._catch_up()
        self._do(handle(message, self._node.now_s()))

    def _on_stop(self, stopped: bool, who: str) -> None:
        """Stop the robot and cancel the goals of all nodes; allow no goal until the release."""
        self._nav2.forbidden = stopped
        if stopped:
            self._node.once.begin(_STOPPED, f"stopped by {who}: no goal is sent until it is released")
            self._stop()
            self._nav2.cancel_all()
        else:
            self._node.once.over(_STOPPED)
        self._do(self._executor.hold(_STOPPED, stopped, self._node.now_s()))

    def _on_accepted(self, number: int) -> None:
        self._do(self._executor.sent.accepted(number, self._node.now_s()))

    def _on_rejected(self, number: int) -> None:
        self._node.get_logger().warning(f"goal {number} was rejected")
        self._do(self.selection.on_rejected(number, self._node.now_s()))

    def _on_finished(self, number: int, status: int, at: Position | None) -> None:
        self._catch_up()
        self._do(self.selection.on_finished(number, status, self._nav2.last_error, self._node.now_s(), at))

    # Timers

    def _tick(self) -> None:
        self._catch_up()
        now, once = self._node.now_s(), self._node.once
        if self._fresh:  # all latched messages have arrived by now, and are used together
            self._fresh = False
            self._do(self._executor.activate(now))
        self._cleared = self._cleared or self._passive or self._nav2.clear()
        if self._passive or self._nav2.ready:
            once.over("no Nav2")
        else:
            once.warning("no Nav2", "no action server navigate_to_pose")
        self._do(self._executor.nav2(self._passive or (self._nav2.ready and self._cleared), now))
        if self._nav2.ready != self._shown_ready:  # a round may wait for Nav2
            self._publish_diagnostics()
        self._decide()

    def _check_nav2(self) -> None:
        """Report a missing Nav2, by wall time: without the simulated robot its clock stops, and so do the ticks."""
        if self._tick_timer is not None and not self._passive and not self._nav2.ready:
            self._do(self._executor.nav2(False, self._node.now_s()))

    def _decide(self) -> None:
        now, selection = self._node.now_s(), self.selection
        selection.decide(now, self._do)
        if selection.decision is None:
            return
        try:
            self._explain(*selection.decision, now - self._executor.began_s)
        except PolicyError as error:  # the choice remains valid without an explanation
            self._node.once.warning("no scores", f"{error}; its scores are not shown")

    def _explain(self, situation: Situation, chosen: int, round_s: float) -> None:
        policy = self.selection.policy
        if self._out[topics.SCORES.name].get_subscription_count() > 0:
            markers = goal_scores.score_markers(situation, scores(policy, situation), chosen, self._stamp())
            self._out[topics.SCORES.name].publish(markers)
        if self._out[topics.WHY.name].get_subscription_count() > 0:
            with what_users_raise(type(policy), name_of(policy)):
                robot_mps = self._node.config.robot.speed_mps
                why = goal_scores.reasons(policy, situation, chosen, round_s, robot_mps)
            self._publish_json(topics.WHY, why)

    def _repeat(self) -> None:
        """Repeat unanswered reports, and end goals whose result was lost."""
        self._nav2.end_without_results()
        if self._tick_timer is not None and not self._passive:
            self._do([ExecutorAction("status", word) for word in self._executor.statuses.open()])

    def _publish_diagnostics(self) -> None:
        node, key = self._node, "ghosts unheard"
        ghosts_received = not costmaps_without(node, topics.CLYDE_OBSTACLE.name)
        if self._executor.playing and not ghosts_received:
            text = "no costmap listens to clyde_obstacle: Nav2 plans through ghosts (pacman-env ros doctor)"
            node.once.warning(key, text)
        elif ghosts_received:
            node.once.over(key)
        self._shown_ready = self._nav2.ready
        condition = {
            "shadow": self._passive,
            "active": self._tick_timer is not None,
            "nav2": self._nav2.ready,
            "stopped": self._operator is not None and self._operator.stopped,
            "ghosts_heard": ghosts_received,
            "last_status": self._nav2.last_status,
            "last_error_code": self._nav2.last_error,
            "last_error": error_words(self._nav2.last_error),
            "troubles": node.troubles(),
            "trouble_texts": dict(node.once.texts),
            **self.selection.condition(node.now_s()),
        }
        self._publish_json(topics.DIAGNOSTICS, condition)

    # Actions

    def _publish_json(self, topic: topics.Topic, values: dict[str, Any]) -> None:
        self._out[topic.name].publish(String(data=goal_scores.as_json(values)))

    def _do(self, actions: _Actions) -> None:
        for action in actions or ():
            if action.kind == "ignored":
                self._node.once.warning(str(action.value), f"{action.value} is ignored")
            elif self._passive:
                self._log(action)
            elif action.kind == "send":
                self._send(int(action.value), action.place)
            elif action.kind == "cancel":
                self._nav2.cancel(int(action.value))
            elif action.kind == "stop":
                self._stop()
            elif action.kind == "remove":
                self._out[topics.REMOVE_PELLET.name].publish(Int32(data=int(action.value)))
            else:
                topic = topics.GAME_STATUS if action.kind == "status" else topics.GAME_EVENT
                self._out[topic.name].publish(String(data=str(action.value)))
        if topics.HARMLESS_GHOSTS.name in self._out:
            ghosts = len(self._node.config.clyde.ghosts)
            times = self._executor.round.ghosts[:ghosts, HARMLESS_UNTIL:].ravel().tolist()
            if times != self._ghost_times:
                self._ghost_times = times
                self._out[topics.HARMLESS_GHOSTS.name].publish(Float64MultiArray(data=times))

    def _send(self, number: int, place: Place | None) -> None:
        assert place is not None
        heading = place.heading
        if heading is None:
            x, y = self._executor.pose or (place.x, place.y)
            heading = math.atan2(place.y - y, place.x - x)
        self._nav2.send(number, (place.x, place.y, heading))
        self._node.get_logger().info(f"goal {number}: {_words(place)}")

    def _stop(self) -> None:
        self._out[topics.CMD_VEL.name].publish(twist_message(0.0, 0.0, self._stamp()))

    def _stamp(self) -> Any:
        return self._node.get_clock().now().to_msg()

    def _log(self, action: ExecutorAction) -> None:
        """Log an action instead of performing it, and assume its success."""
        now, log = self._node.now_s(), self._node.get_logger().info
        if action.kind == "send":
            log(f"shadow: goal {action.value}: {_words(action.place)}")
            self._do(self._executor.sent.accepted(int(action.value), now))
        elif action.kind == "cancel":
            log(f"shadow: cancel goal {action.value}")
            self._do(self._executor.finished(int(action.value), CANCELED, now))
        elif action.kind in ("status", "event"):
            log(f"shadow: {action.kind} {action.value}")


def _words(place: Any) -> str:
    what = "home" if place.heading is not None else "a refuge" if place.pellet is None else f"pellet {place.pellet}"
    return f"{what} at ({place.x:.2f}, {place.y:.2f})"
