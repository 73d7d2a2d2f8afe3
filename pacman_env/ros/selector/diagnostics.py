"""Diagnostics of a node that plays: JSON on a topic of its own, and ``diagnostic_msgs`` on ``/diagnostics``."""

import contextlib
from collections.abc import Callable
from typing import Any

from std_msgs.msg import String

from pacman_env import __version__
from pacman_env.game.ghosts import GHOST_NAMES
from pacman_env.ros import topics
from pacman_env.ros.configured_node import ConfiguredNode
from pacman_env.ros.discovery import costmaps_without
from pacman_env.ros.node import parameter
from pacman_env.ros.selector.goal_scores import decision_times
from pacman_env.ros.selector.goal_selector import GoalSelector
from pacman_env.ros.selector.nav2_failures import error_words
from pacman_env.ros.selector.policy_child import as_json
from pacman_env.ros.selector.reasons import REMEDIES

_UNHEARD = "ghosts unheard"


class Diagnostics:
    """Publisher of a node's condition, which ``condition`` returns, at the rate of a parameter."""

    def __init__(self, node: ConfiguredNode, condition: Callable[[], dict[str, Any]]) -> None:
        self._node, self._condition = node, condition
        self._json = topics.DIAGNOSTICS.publisher(node)
        self._array: Any = None
        with contextlib.suppress(ImportError, AttributeError):  # without the package of diagnostic_msgs
            self._array = topics.DIAGNOSTIC_ARRAY.publisher(node)
        rate = parameter(node, "diagnostics_rate", 1.0, "diagnostics messages per second", 1.0, 10.0)
        node.create_timer(1.0 / rate, self.publish)

    def publish(self) -> None:
        node = self._node
        ghosts_received = not costmaps_without(node, topics.CLYDE_OBSTACLE.name)
        condition = {"ghosts_heard": ghosts_received, **self._condition()}
        if condition.get("task") == "play" and not ghosts_received:
            text = "no costmap listens to clyde_obstacle: Nav2 plans through ghosts (pacman-env ros doctor)"
            node.once.warning(_UNHEARD, text)
        elif ghosts_received:
            node.once.over(_UNHEARD)
        condition |= {"troubles": node.troubles(), "trouble_texts": dict(node.once.texts)}
        # A foreign selector publishes here too; its condition counts more.
        if "active" in condition or node.count_publishers(self._json.topic_name) == 1:
            self._json.publish(String(data=as_json(condition)))
        if self._array is not None:
            self._publish_array(condition)

    def _publish_array(self, condition: dict[str, Any]) -> None:
        from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

        texts = condition["trouble_texts"]
        serious = any(kind in REMEDIES for kind in texts)
        level = DiagnosticStatus.ERROR if serious else DiagnosticStatus.WARN if texts else DiagnosticStatus.OK
        shown = {name: condition.get(name) for name in ("policy", "state", "task", "nav2", "stopped", "pellets_left")}
        status = DiagnosticStatus(
            level=level,
            name=self._node.get_fully_qualified_name(),
            message="; ".join(texts.values()) or str(condition.get("state")),
            hardware_id=self._node.get_namespace(),
            values=[KeyValue(key=name, value=str(value)) for name, value in shown.items()],
        )
        array = DiagnosticArray(status=[status])
        array.header.stamp = self._node.get_clock().now().to_msg()
        self._array.publish(array)


def selector_condition(selector: GoalSelector, now: float) -> dict[str, Any]:
    """Return the diagnostics of a goal selector for operators, as plain values."""
    belief, executor, home, nav2 = selector.belief, selector.executor, selector.executor.home, selector.nav2
    view, sent, policy = selector.view, selector.executor.sent, selector.policy
    ghosts = dict(zip(GHOST_NAMES, view.ghosts, strict=False))
    return {
        "active": executor.active,
        "nav2": nav2.ready,
        "last_status": nav2.last_status,
        "last_error_code": nav2.last_error,
        "last_error": error_words(nav2.last_error),
        **policy.condition(),
        "policy_version": policy.process.version or __version__,
        "package_version": __version__,
        "map": view.assets.occupancy.name,
        "state": executor.game_state,
        "task": executor.task,
        "round_s": round(now - executor.began_s, 2) if executor.playing else None,
        "home": None if home is None else [home.x, home.y, home.heading],
        "pose": None if belief is None else list(belief.pose),
        "pose_source": None if belief is None else belief.source,
        "pose_age_s": None if belief is None else belief.age_s,
        **{name: None if name in view.unseen else at for name, at in ghosts.items()},
        "pellets_left": len(executor.round.left),
        "pellets_unreachable": view.out_of_reach(executor.round.left),
        "pellets_unknown": list(selector.unknown_pellets[:20]),
        "pursued": sent.pursued,
        "masked": sorted(executor.round.masked(now)),
        "goals_sent": sent.number,
        "goals_rejected": selector.failures.rejected,
        "goals_aborted": selector.failures.aborted,
        "decisions": decision_times(policy.process.times_ms),
    }
