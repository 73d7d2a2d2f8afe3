"""The goal selector: puts any policy of the registry on the robot, in the place of ``planner_stub``.

The node alone: its life, its parameters, what it publishes and what it sends to Nav2. What is done, and when, is
decided in ``selection.py``. It never waits for anything but the next message.
"""

from __future__ import annotations

import math
import sys
import traceback
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.lifecycle.node import LifecycleNodeMixin, TransitionCallbackReturn
from rclpy.parameter import Parameter
from std_msgs.msg import Int32, String

from pacman_env.config import ConfigError
from pacman_env.game.execution import CANCELED
from pacman_env.game.goal_executor import ExecutorAction
from pacman_env.game.goals import Home, Place
from pacman_env.policies.base import Policy
from pacman_env.ros import topics
from pacman_env.ros.discovery import costmaps_without
from pacman_env.ros.messages import Position, twist_message
from pacman_env.ros.node import GameNode, parameter, run
from pacman_env.ros.operator_stop import OperatorStop
from pacman_env.ros.selector.goal_scores import (
    CANDIDATES,
    DIAGNOSTICS,
    SCORES,
    WHY,
    as_json,
    candidates_of,
    reasons,
    score_markers,
)
from pacman_env.ros.selector.message_queue import MessageQueue
from pacman_env.ros.selector.navigation_client import NavigationClient
from pacman_env.ros.selector.selection import Selection
from pacman_env.world.maps.occupancy import MapError

NAME = "goal_selector"
_STOPPED = "stopped by the operator"
_REPEAT_S = 2.0  # of wall time, however fast the game's clock runs: a referee needs as long to come back
_LOOK_S = 0.5  # of wall time, shorter than any start
_UNUSABLE = (ValueError, TypeError, ModuleNotFoundError, MapError, ConfigError, OSError)
_PUBLISHED = (
    *(topics.GAME_STATUS, topics.GAME_EVENT, topics.REMOVE_PELLET, topics.CMD_VEL),
    *(SCORES, WHY, CANDIDATES, DIAGNOSTICS),
)


class GoalSelector(LifecycleNodeMixin, GameNode):
    """A lifecycle node; it configures and activates itself unless ``autostart`` is false.

    Raises:
        ValueError: with ``autostart``, a map or a policy that cannot be used.
    """

    def __init__(self) -> None:
        GameNode.__init__(self, NAME, with_map=True)
        LifecycleNodeMixin.__init__(self)
        text = "the policy: a name of the registry or an .onnx file; may be changed while the game is in menu"
        self.declare_parameter("policy", "ppo", ParameterDescriptor(description=text))
        text = "home pose x, y, heading (m, m, rad); not set: the first pose in menu, or what initialpose says there"
        descriptor = ParameterDescriptor(description=text, read_only=True)
        self._home = self.declare_parameter("home", Parameter.Type.DOUBLE_ARRAY, descriptor).value
        self._tell_rate = parameter(self, "diagnostics_rate", 1.0, "diagnostics messages per second", 0.1, 10.0)
        text = "a transform older than this gives way to the latched amcl_pose, s"
        self._pose_timeout_s = parameter(self, "pose_timeout_s", 1.0, text, 0.1, 10.0)
        autostart = parameter(self, "autostart", True, "configure and activate without being asked")

        self._selection: Selection | None = None  # None: not configured
        self._fault = ""  # why configuring failed
        self._destroy: list[Callable[[], Any]] = []  # what configuring made
        self._loaded: tuple[str, Policy] | None = None  # a policy about to be taken over
        self._timer: Any = None
        self._fresh = False  # activated, but no tick yet
        self._cleared = False  # goals from before have been cancelled
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._take_policy_over)
        if autostart:
            if self.trigger_configure() != TransitionCallbackReturn.SUCCESS:
                raise ValueError(self._fault or "cannot be configured")
            self.trigger_activate()

    def acts(self) -> bool:
        """Not as a shadow."""
        self._shadow = parameter(self, "shadow", False, "decide and log beside another planner, send nothing")
        return not self._shadow

    def destroy_node(self) -> None:
        """As rclpy's, which forgets the state machine: that keeps the node, and its name's place in the log."""
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()

    # Lifecycle

    def on_configure(self, state: Any) -> TransitionCallbackReturn:
        """Prepare the map, load the policy and warm it up; connect."""
        try:
            if self._home is not None and len(self._home) != 3:
                raise ValueError(f"parameter home: {len(self._home)} numbers, must be x, y, heading")
            self._selection = Selection(
                self.config,
                self.map,
                self.get_parameter("policy").value,
                None if self._home is None else tuple(self._home),
                self._pose_timeout_s,
                self.once.warning,
            )
            self._connect(self._selection)
        except _UNUSABLE as error:
            self._fault = str(error)
            self.get_logger().error(self._fault)
            return TransitionCallbackReturn.FAILURE
        except Exception:  # rclpy would drop it without a word
            self.get_logger().error(traceback.format_exc())
            raise
        return super().on_configure(state)

    def _connect(self, selection: Selection) -> None:
        self._out = {topic.name: topic.publisher(self) for topic in _PUBLISHED}
        self._nav2 = NavigationClient(self, self._on_accepted, self._on_rejected, self._on_finished)
        self._operator = None if self._shadow else OperatorStop(self, self._hear_stop)
        self._out[CANDIDATES.name].publish(String(data=as_json(candidates_of(selection.view.assets))))
        ghosts = topics.GHOST_POSES[: len(self.config.clyde.ghosts)]
        heard: tuple[tuple[topics.Topic, Callable[[Any, float], list[ExecutorAction]]], ...] = (
            (topics.GAME_STATE, selection.on_state),
            (topics.GAME_COMMAND, selection.on_command),
            (topics.PELLET_MARKERS, selection.on_pellets),
            (topics.PELLETS_COLLECTED, selection.on_collected),
            *((topic, partial(selection.on_ghost, k)) for k, topic in enumerate(ghosts)),
            (topics.CLYDE_SPEED, selection.on_clyde_speed),
            (topics.AMCL_POSE, selection.on_amcl),
            (topics.INITIAL_POSE, selection.on_initial_pose),
            (topics.TF_STATIC, selection.on_static_transforms),
        )
        subscriptions = [
            self.listen(topic, partial(self._take, take_in), f"bad {topic.name}") for topic, take_in in heard
        ]
        self._transforms = MessageQueue(self, topics.TF, self._take_transforms)
        timer = self.create_timer(1.0 / self._tell_rate, self._tell_condition)
        wall = self.surroundings.clock()
        timers = [timer, self.create_timer(_REPEAT_S, self._repeat, clock=wall)]
        if self.get_parameter("use_sim_time").value:
            timers.append(self.create_timer(_LOOK_S, self._look_for_nav2, clock=wall))
        self._destroy = [
            self._nav2.destroy,
            self._transforms.destroy,
            *([] if self._operator is None else [partial(self._operator.destroy, self)]),
            *[lambda one=one: self.destroy_timer(one) for one in timers],
            *[lambda one=one: self.destroy_subscription(one) for one in subscriptions],
            *[lambda one=one: self.destroy_publisher(one) for one in self._out.values()],
        ]

    def _hear_stop(self, stopped: bool, who: str) -> None:
        """The robot stands at once, and no goal of anybody's is left to Nav2, until it is released."""
        assert self._selection is not None
        self._nav2.forbidden = stopped
        if stopped:
            self.once.warning(_STOPPED, f"stopped by {who}: no goal is sent until it is released")
            self._stop()
            self._nav2.cancel_all()
        else:
            self.once.over(_STOPPED)
        self._do(self._selection.executor.hold(stopped, self.now_s()))

    def _take(self, take_in: Callable[[Any, float], list[ExecutorAction]], message: Any) -> None:
        self._transforms.catch_up()
        self._do(take_in(message, self.now_s()))

    def _take_transforms(self, message: Any, waited_s: float) -> None:
        assert self._selection is not None
        self._selection.on_transforms(message, self.now_s() - waited_s)

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        """Begin to decide."""
        assert self._selection is not None
        self._fresh = True
        self._timer = self.create_timer(self.config.execution.tick_s, self._tick)
        what = f"policy {self._selection.spec} on map {self._selection.view.assets.occupancy.name}"
        self.get_logger().info(f"{what}{', a shadow: nothing is sent' if self._shadow else ''}")
        return super().on_activate(state)

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        """Stop the robot and decide nothing any more."""
        self._rest()
        return super().on_deactivate(state)

    def on_cleanup(self, state: Any) -> TransitionCallbackReturn:
        """Forget map and policy; disconnect."""
        self._disconnect()
        return super().on_cleanup(state)

    def on_shutdown(self, state: Any) -> TransitionCallbackReturn:
        """Stop the robot for good."""
        self._rest()
        return super().on_shutdown(state)

    def _rest(self) -> None:
        if self._timer is not None:
            self.destroy_timer(self._timer)
            self._timer = None
        if self._selection is not None:
            self._do(self._selection.executor.deactivate(self.now_s()))

    def _disconnect(self) -> None:
        for destroy in self._destroy:
            destroy()
        self._destroy, self._selection = [], None

    def last_messages(self) -> Iterable[Any]:
        """Cancel what runs and stop the wheels."""
        if self._selection is None or self._shadow:
            return ()
        self._rest()
        self._stop()
        rest = self._nav2.rest()
        rest.add_done_callback(lambda _: self._stop())  # once more: Nav2 drove on until it had heard
        return (rest,)

    # Parameters

    def _check_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        """Load a new policy; refuse it outside the menu, and if it cannot be used."""
        for wanted in parameters:
            if wanted.name != "policy" or self._selection is None:
                continue
            state = self._selection.executor.game_state
            if state not in ("menu", None):
                return SetParametersResult(successful=False, reason=f"policy: the game is in state {state!r}, not menu")
            try:
                self._loaded = wanted.value, self._selection.load(wanted.value)
            except _UNUSABLE as error:
                return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _take_policy_over(self, parameters: list[Parameter]) -> None:
        if self._loaded is not None and self._selection is not None:
            self._selection.spec, self._selection.policy = self._loaded
            self.get_logger().info(f"policy {self._loaded[0]}")
        self._loaded = None

    # Decisions

    def _tick(self) -> None:
        assert self._selection is not None
        self._transforms.catch_up()
        now, executor = self.now_s(), self._selection.executor
        if self._fresh:  # what was latched has been heard by now, and is acted on as a whole
            self._fresh = False
            self._do(executor.activate(now))
        self._cleared = self._cleared or self._shadow or self._nav2.clear()
        there = self._shadow or (self._nav2.ready and self._cleared)
        if self._shadow or self._nav2.ready:
            self.once.over("no Nav2")
        else:
            self.once.warning("no Nav2", "no action server navigate_to_pose")
        self._do(executor.nav2(there, now))
        self._decide()

    def _look_for_nav2(self) -> None:
        """A simulated robot takes the time with it: while it is started again there is no tick to see that."""
        assert self._selection is not None
        if self._timer is not None and not self._shadow and not self._nav2.ready:
            self._do(self._selection.executor.nav2(False, self.now_s()))

    def _decide(self) -> None:
        assert self._selection is not None
        now = self.now_s()
        self._selection.decide(now, self._do)
        if self._selection.seen is None:
            return
        (situation, chosen), policy = self._selection.seen, self._selection.policy
        if self._out[SCORES.name].get_subscription_count() > 0:
            scores = policy.scores(situation)
            self._out[SCORES.name].publish(score_markers(situation, scores, chosen, self._stamp()))
        if self._out[WHY.name].get_subscription_count() > 0:
            round_s = self._selection.executor.round_s(now)
            self._out[WHY.name].publish(String(data=as_json(reasons(policy, situation, chosen, round_s))))

    def _on_accepted(self, number: int) -> None:
        assert self._selection is not None
        self._do(self._selection.executor.accepted(number, self.now_s()))

    def _on_rejected(self, number: int) -> None:
        assert self._selection is not None
        self.get_logger().warning(f"goal {number} was rejected")
        self._do(self._selection.on_rejected(number, self.now_s()))

    def _on_finished(self, number: int, status: int, seen: Position | None) -> None:
        assert self._selection is not None
        self._transforms.catch_up()
        self._do(self._selection.on_finished(number, status, self.now_s(), seen))

    def _repeat(self) -> None:
        """Say again what nobody has answered; go on where an answer was lost."""
        assert self._selection is not None
        self._nav2.end_without_results()
        if self._timer is not None and not self._shadow:
            self._do([ExecutorAction("status", word) for word in self._selection.executor.statuses.open()])

    def _tell_condition(self) -> None:
        assert self._selection is not None
        heard = not costmaps_without(self, topics.CLYDE_OBSTACLE.name)
        if self._selection.executor.playing and not heard:
            text = "no costmap listens to clyde_obstacle: Nav2 plans through ghosts (pacman-env ros doctor)"
            self.once.warning("ghosts unheard", text)
        elif heard:
            self.once.over("ghosts unheard")
        condition = {
            "shadow": self._shadow,
            "active": self._timer is not None,
            "nav2": self._nav2.ready,
            "stopped": self._operator is not None and self._operator.stopped,
            "ghosts_heard": heard,
            "last_status": self._nav2.last_status,
            "last_error_code": self._nav2.last_error,
            "troubles": dict(self.once.counts),
            **self._selection.condition(self.now_s()),
        }
        self._out[DIAGNOSTICS.name].publish(String(data=as_json(condition)))

    # What is done

    def _do(self, actions: list[ExecutorAction]) -> None:
        for action in actions:
            if action.kind == "ignored":
                self.once.warning(str(action.value), f"{action.value} is ignored")
            elif self._shadow:
                self._pretend(action)
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

    def _send(self, number: int, place: Place | None) -> None:
        assert self._selection is not None
        assert place is not None
        if isinstance(place, Home):
            heading = place.heading
        else:
            x, y = self._selection.executor.pose or (place.x, place.y)
            heading = math.atan2(place.y - y, place.x - x)
        self._nav2.send(number, (place.x, place.y, heading))
        self.get_logger().info(f"goal {number}: {_words(place)}")

    def _stop(self) -> None:
        self._out[topics.CMD_VEL.name].publish(twist_message(0.0, 0.0, self._stamp()))

    def _stamp(self) -> Any:
        return self.get_clock().now().to_msg()

    def _pretend(self, action: ExecutorAction) -> None:
        """As a shadow: say what would be done, and believe that Nav2 does it."""
        assert self._selection is not None
        executor, now = self._selection.executor, self.now_s()
        if action.kind == "send":
            self.get_logger().info(f"shadow: goal {action.value}: {_words(action.place)}")
            self._do(executor.accepted(int(action.value), now))
        elif action.kind == "cancel":
            self.get_logger().info(f"shadow: cancel goal {action.value}")
            self._do(executor.finished(int(action.value), CANCELED, now))
        elif action.kind in ("status", "event"):
            self.get_logger().info(f"shadow: {action.kind} {action.value}")


def _words(place: Any) -> str:
    what = "home" if isinstance(place, Home) else "a refuge" if place.pellet is None else f"pellet {place.pellet}"
    return f"{what} at ({place.x:.2f}, {place.y:.2f})"


def main(argv: list[str] | None = None) -> int:
    """Run the node."""
    return run(GoalSelector, NAME, argv)


if __name__ == "__main__":
    sys.exit(main())
