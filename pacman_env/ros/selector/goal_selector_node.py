"""Node ``goal_selector``: plays with any registered policy in a foreign game, such as the original's.

It replaces the original's ``planner_stub`` on the topics of the original's documentation. In a game of our own the goal
selector is part of ``pacman_game``; as a shadow this node then shows what another policy would do.
"""

import sys
import time
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any

from rclpy.lifecycle.node import LifecycleNodeMixin, TransitionCallbackReturn

from pacman_env.config import MAX_SPEED_MPS
from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.game.power import HARMLESS_UNTIL
from pacman_env.ros import message_conversion as messages
from pacman_env.ros import topics
from pacman_env.ros.configured_node import ConfiguredNode
from pacman_env.ros.node import BaseNode, parameter
from pacman_env.ros.operator_stop import OperatorStop
from pacman_env.ros.process import run
from pacman_env.ros.rclpy_private import destroy_state_machine
from pacman_env.ros.selector.asked_policy import AskedPolicy
from pacman_env.ros.selector.diagnostics import Diagnostics, selector_condition
from pacman_env.ros.selector.goal_selector import GoalSelector, Report, declare_home
from pacman_env.ros.selector.navigation_client import LOST_GOALS_S, NavigationClient
from pacman_env.ros.selector.policy_process import PolicyProcess, fork_spare
from pacman_env.ros.selector.pose_topics import declare_limits
from pacman_env.ros.selector.reasons import GHOST_LOST, SILENT_S
from pacman_env.ros.selector.shadow import Shadow

NAME = "goal_selector"
_WALL_S = 0.5  # shortest wall time without a ghost that counts, because the game's clock may run fast on a busy machine


def published_reports(node: BaseNode) -> Report:
    """Return how a goal selector reports to a foreign game, which hears topics."""
    kinds = {"status": topics.GAME_STATUS, "event": topics.GAME_EVENT, "remove": topics.REMOVE_PELLET}
    publishers = {kind: topic.publisher(node) for kind, topic in kinds.items()}

    def publish(reports: Sequence[tuple[str, int | str]]) -> None:
        for kind, value in reports:
            publishers[kind].publish(publishers[kind].msg_type(data=value))

    return publish


class GoalSelectorNode(LifecycleNodeMixin, ConfiguredNode):
    """Lifecycle node that activates itself unless ``autostart`` is false; ``ask`` makes the policy's process."""

    def __init__(self, ask: Callable[..., PolicyProcess] = PolicyProcess, **options: Any) -> None:
        ConfiguredNode.__init__(self, NAME, with_map=True, **options)
        LifecycleNodeMixin.__init__(self)
        home, limits = declare_home(self), declare_limits(self)
        autostart = parameter(self, "autostart", True, "activate at the start")
        self._policy = AskedPolicy(
            self, ask, lambda answer: self.selector.on_answer(answer), lambda: self.selector.executor.game_state
        )
        report = self._log_report if self._shadows else published_reports(self)
        navigate = Shadow if self._shadows else NavigationClient
        self.selector = selector = GoalSelector(self, self.config, self._policy, report, home, limits, navigate)
        self._seen_s: dict[int, tuple[float, float]] = {}  # by ghost: game time and wall time when it was last seen
        self._operator = None if self._shadows else OperatorStop(self, selector.stop)
        self._harmless = None
        if self.config.power.pellets > 0 and not self._shadows:
            self._harmless = topics.HARMLESS_GHOSTS.publisher(self)
        for topic, handle in self._handlers():
            self.listen(topic, handle, f"bad {topic.name}")
        topics.CONTINUE.server(self, selector.on_continue)
        Diagnostics(self, self._condition)
        self._policy.process.wait()
        self._tick_timer = self.create_timer(self.config.execution.tick_s, self._tick)
        self._tick_timer.cancel()
        self.create_timer(LOST_GOALS_S, selector.nav2.end_without_results)
        if autostart:
            self.trigger_configure()
            self.trigger_activate()

    def acts(self) -> bool:
        self._shadows = parameter(self, "shadow", False, "decide and log while another planner drives; send nothing")
        return not self._shadows

    def destroy_node(self) -> None:
        """Destroy the node and its state machine."""
        super().destroy_node()
        destroy_state_machine(self)

    def _log_report(self, reports: Sequence[tuple[str, int | str]]) -> None:
        for kind, value in reports:
            self.get_logger().info(f"shadow: {kind} {value}")

    def _handlers(self) -> Iterable[tuple[topics.Topic, Callable[[Any], object]]]:
        selector, number_of = self.selector, messages.number_of
        yield topics.GAME_STATE, lambda message: selector.on_state(messages.word_of(message, topics.STATE_WORDS))
        yield topics.GAME_COMMAND, lambda message: selector.on_command(messages.word_of(message, topics.COMMAND_WORDS))
        yield topics.AMCL_POSE, selector.pose.believed.latched
        yield topics.PELLET_MARKERS, self._on_pellets
        played = selector.executor.round
        yield topics.ROUND, lambda message: played.begin(int(number_of(message, 1, 2**31 - 1)))
        yield topics.GHOSTS_CAUGHT, lambda message: played.caught_before(int(number_of(message, 0, 2**31 - 1)))
        yield topics.CLYDE_SPEED, lambda message: selector.on_clyde_speed(number_of(message, 0.0, MAX_SPEED_MPS))
        for k in range(len(self.config.clyde.ghosts)):
            yield topics.GHOST_POSES[k], partial(self._on_ghost, k)

    def _on_pellets(self, message: Any) -> None:
        self.selector.on_pellets(messages.pellets_of(message), messages.power_pellets_of(message))

    def _on_ghost(self, number: int, message: Any) -> None:
        (x, y, _), now = messages.pose_of(message), self.now_s()
        self._seen_s[number] = now, time.monotonic()
        self.selector.view.see_ghost(number, x, y, messages.nanoseconds_of(message.header.stamp) or int(now * 1e9))

    def _tick(self) -> None:
        self.selector.hold(GHOST_LOST, self._lost_ghost() if self.selector.executor.playing else "")
        self.selector.tick()
        if self._harmless is not None:
            ghosts = self.selector.executor.round.ghosts[: len(self.config.clyde.ghosts), HARMLESS_UNTIL:]
            self._harmless.publish(messages.ghost_times_message(ghosts - self.set_back_s))

    def _lost_ghost(self) -> str:
        """Describe the ghost that was not seen for the longest time; empty if no ghost is lost.

        A round must not continue if the node of the ghosts is dead.
        """
        now = self.now_s()
        for number, (seen_s, wall_s) in sorted(self._seen_s.items(), key=lambda pair: pair[1]):
            if now - seen_s > SILENT_S and time.monotonic() - wall_s > _WALL_S:
                return f"{GHOST_NAMES[number]} was not seen for {now - seen_s:.0f} s; the robot holds"
        return ""

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        self.selector.activate(True)
        self._tick_timer.reset()
        self.get_logger().info(f"policy {self._policy.spec}{', a shadow: nothing is sent' if self._shadows else ''}")
        return super().on_activate(state)

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        self._tick_timer.cancel()
        self.selector.activate(False)
        return super().on_deactivate(state)

    def on_shutdown(self, state: Any) -> TransitionCallbackReturn:
        self.selector.activate(False)
        return super().on_shutdown(state)

    def _condition(self) -> dict[str, Any]:
        stopped = self._operator is not None and self._operator.stopped
        condition = selector_condition(self.selector, self.now_s())
        return {"shadow": self._shadows, "stopped": stopped, **condition}

    def last_messages(self) -> Iterable[Any]:
        self._policy.process.close()
        return self.selector.close()


def main(argv: Sequence[str] | None = None) -> int:
    if argv is None:  # otherwise this process may have threads already
        fork_spare()
    return run(GoalSelectorNode, NAME, argv)


if __name__ == "__main__":
    sys.exit(main())
