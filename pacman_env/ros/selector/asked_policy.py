"""The policy of a node: its parameter, its process, and the delivery of its answers."""

from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.parameter import Parameter

from pacman_env.engine.cache_folder import is_compiled
from pacman_env.ros.configured_node import ConfiguredNode
from pacman_env.ros.selector.policy_child import Answer, PolicySetup
from pacman_env.ros.selector.policy_process import PolicyProcess
from pacman_env.ros.selector.reasons import POLICY_FAILS

_POLL_S = 0.02  # wall time between looks for an answer
_PROMPT_S = 0.01  # longest wait right after a question; most policies answer within a few ms


class AskedPolicy:
    """Policies in a process made by ``make``; ``deliver`` is called with each answer, and with failures.

    Without ``chooses`` only the policies of ghosts are loaded, if there are any.
    """

    def __init__(
        self,
        node: ConfiguredNode,
        make: Callable[..., PolicyProcess],
        deliver: Callable[[Answer], None],
        game_state: Callable[[], str | None],  # None: unknown
        chooses: bool = True,
    ) -> None:
        self._node, self._make, self._deliver, self._game_state = node, make, deliver, game_state
        text = "policy: a registered name or an .onnx file; can be changed while the game is in the menu"
        self.spec: str = node.declare_parameter("policy", "ppo", ParameterDescriptor(description=text)).value
        self._next: PolicyProcess | None = None  # used once the parameter is set
        self.process = self._started(self.spec if chooses else "")
        self._timer = node.create_timer(_POLL_S, self._poll, clock=Clock(clock_type=ClockType.STEADY_TIME))
        node.add_on_set_parameters_callback(self._check_parameters)
        node.add_post_set_parameters_callback(self._use_next)
        if not is_compiled():  # refuse a policy before anything is compiled; the child compiles for this process, too
            self.process.wait()

    def _started(self, spec: str) -> PolicyProcess:
        preset, execution, settings = self._node.rules
        return self._make(PolicySetup(spec, self._node.map_yaml, preset, execution, settings), self._report)

    def asked(self) -> None:
        """Deliver answers that come at once; others are delivered later."""
        if self.process.is_busy:
            self._timer.reset()
            self._poll(_PROMPT_S)

    def _poll(self, wait_s: float = 0.0) -> None:
        while (answer := self.process.poll(wait_s)) is not None:
            self._deliver(answer)
        if not self.process.is_busy:
            self._timer.cancel()
        elif self._timer.is_canceled():
            self._timer.reset()

    def _report(self, words: str) -> None:
        if words:
            self._node.once.begin(POLICY_FAILS, words)
        else:
            self._node.once.over(POLICY_FAILS)

    def _check_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        """Load a new policy; refuse it outside the menu or if it cannot be used."""
        for change in parameters:
            if change.name != "policy":
                continue
            if (state := self._game_state()) not in ("menu", None):
                reason = f"policy: the game is in state {state!r}, not menu"
                return SetParametersResult(successful=False, reason=reason)
            loaded = self._started(change.value)
            try:
                loaded.wait()
            except ValueError as error:
                return SetParametersResult(successful=False, reason=str(error))
            self._next = loaded
        return SetParametersResult(successful=True)

    def _use_next(self, parameters: list[Parameter]) -> None:
        if self._next is None:
            return
        self.process.close()
        self.process, self._next = self._next, None
        self.spec = self.process.setup.policy
        self._report("")
        self._node.get_logger().info(f"policy {self.spec}")

    def condition(self) -> dict[str, Any]:
        """Return the diagnostics of the policy's process."""
        self._poll()  # it may have died without a question
        process = self.process
        return {"policy": self.spec, "policy_ready": process.ready, "policy_restarts": process.restarts}
