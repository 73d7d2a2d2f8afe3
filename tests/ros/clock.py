"""Simulated time for nodes with ``use_sim_time``, which goes on only when a test says so."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rclpy.time import Time
from rosgraph_msgs.msg import Clock

from pacman_env.ros import topics

if TYPE_CHECKING:
    from tests.ros.system import Probe


class SimulatedClock:
    """Tells some nodes of the probe's system the time; what happens at which time then depends on no machine.

    Args:
        probe: its messages from before a step are taken in before it.
        nodes: names, without the namespace.
    """

    def __init__(self, probe: Probe, *nodes: str) -> None:
        self.probe = probe
        self.now_s = 1000.0
        self._nodes = [f"{probe.system.namespace}/{node}" for node in nodes]
        self._publisher = probe.publisher(topics.CLOCK)
        probe.wait_for(lambda: self._publisher.get_subscription_count() >= len(nodes), what="listeners to the clock")
        for node in self._nodes:
            probe.answered_by(node, anew=True)  # who knows a client knows the publisher that was made before it
        self._show()

    def advance(self, seconds: float, step_s: float = 0.05) -> None:
        """Let time pass in steps; whatever is due in one is done before the next, and at the end."""
        for _ in range(round(seconds / step_s)):
            self.now_s += step_s
            self._show()
        self._show()  # timers that are due run after the answer

    def _show(self) -> None:
        self._publisher.publish(Clock(clock=Time(seconds=self.now_s).to_msg()))
        for node in self._nodes:
            self.probe.answered_by(node)
