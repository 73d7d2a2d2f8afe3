"""Node ``goal_selector``: drives the robot with any registered policy, instead of the original's ``planner_stub``.

This module has the lifecycle and the parameters, ``goal_driver.py`` the work of a configured node. No callback blocks.
"""

import sys
import traceback
from collections.abc import Iterable
from functools import partial
from typing import Any

from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult
from rclpy.lifecycle.node import LifecycleNodeMixin, TransitionCallbackReturn
from rclpy.parameter import Parameter

from pacman_env.config import ConfigError
from pacman_env.policies.base import Policy
from pacman_env.policies.registry import make_policy
from pacman_env.ros.heartbeat import HEART, LONG_S
from pacman_env.ros.node import GameNode, parameter, run
from pacman_env.ros.rclpy_private import accept_integers, destroy_state_machine
from pacman_env.ros.selector.goal_driver import GoalDriver
from pacman_env.ros.selector.pose_watch import PoseLimits
from pacman_env.ros.selector.reasons import POLICY_FAILS
from pacman_env.ros.selector.rehearsal import rehearse
from pacman_env.ros.selector.saved_jump import SavedJump
from pacman_env.ros.selector.selection import Selection
from pacman_env.ros.surroundings import current
from pacman_env.world.maps.occupancy import MapError

NAME = "goal_selector"
_UNUSABLE = (ValueError, TypeError, ModuleNotFoundError, MapError, ConfigError, OSError)


class GoalSelector(LifecycleNodeMixin, GameNode):
    """Lifecycle node that configures and activates itself unless ``autostart`` is false."""

    def __init__(self) -> None:
        GameNode.__init__(self, NAME, with_map=True)
        LifecycleNodeMixin.__init__(self)
        text = "policy: a registered name or an .onnx file; can be changed while the game is in the menu"
        self.declare_parameter("policy", "ppo", ParameterDescriptor(description=text))
        text = "home pose x, y, heading (m, m, rad); not set: where the robot first leaves the menu"
        descriptor = ParameterDescriptor(description=text, read_only=True)
        accept_integers(self, "home")
        self._home = self.declare_parameter("home", Parameter.Type.DOUBLE_ARRAY, descriptor).value
        self._rate = parameter(self, "diagnostics_rate", 1.0, "diagnostics messages per second", 1.0, 10.0)
        text = "age of a transform, s, beyond which the latched amcl_pose is used instead"
        timeout_s = parameter(self, "pose_timeout_s", PoseLimits.timeout_s, text, 0.1, 10.0)
        # AMCL stamps its transform 1 s into the future: after 2 s without one, Nav2 has had none for 1 s.
        text = "time without a transform, s, until the pose is lost: no goals and no pellets until one arrives"
        lost_s = parameter(self, "pose_lost_s", PoseLimits.lost_s, text, 0.5, 60.0)
        # AMCL corrects at most its error: 0.03 to 0.04 m in corridors 1 m wide, up to 0.8 m in corridors 0.5 m wide.
        text = "jump of the pose within 3 s that odometry does not explain, m, from which a person must confirm it"
        jump_m = parameter(self, "pose_jump_m", PoseLimits.jump_m, text, 0.1, 100.0)
        text = "the same for the heading, rad"
        jump_rad = parameter(self, "pose_jump_rad", PoseLimits.jump_rad, text, 0.1, 3.2)
        self._limits = PoseLimits(timeout_s, lost_s, jump_m, jump_rad, self.config.robot.wheel_speed_mps)
        self._jump = SavedJump(self)
        autostart = parameter(self, "autostart", True, "configure and activate at the start")

        self._driver: GoalDriver | None = None  # None if not configured
        self._fault = ""  # reason why configuring failed
        self._loaded: tuple[str, Policy] | None = None  # name and policy, used once the parameter is set
        self.add_on_set_parameters_callback(self._check_parameters)
        self.add_post_set_parameters_callback(self._use_loaded)
        if autostart:
            if self.trigger_configure() != TransitionCallbackReturn.SUCCESS:
                raise ValueError(self._fault or "cannot be configured")
            self.trigger_activate()

    def acts(self) -> bool:
        self._passive = parameter(self, "shadow", False, "decide and log while another planner drives; send nothing")
        return not self._passive

    def destroy_node(self) -> None:
        """Destroy the node and its state machine."""
        super().destroy_node()
        destroy_state_machine(self)

    def on_configure(self, state: Any) -> TransitionCallbackReturn:
        try:
            if self._home is not None and len(self._home) != 3:
                raise ValueError(f"parameter home: {len(self._home)} numbers, must be x, y, heading")
            home = None if self._home is None else tuple(self._home)
            policy = self.get_parameter("policy").value
            selection = Selection(self.config, self.map, policy, home, self._limits, self.once)
            self._driver = GoalDriver(self, selection, self._jump, self._rate, self._passive)
        except _UNUSABLE as error:
            self._fault = str(error)
            self.get_logger().error(self._fault)
            return TransitionCallbackReturn.FAILURE
        except Exception:  # rclpy would discard the exception silently
            self.get_logger().error(traceback.format_exc())
            raise
        return super().on_configure(state)

    def on_activate(self, state: Any) -> TransitionCallbackReturn:
        assert self._driver is not None
        self._driver.activate()
        selection = self._driver.selection
        what = f"policy {selection.spec} on map {selection.view.assets.occupancy.name}"
        self.get_logger().info(f"{what}{', a shadow: nothing is sent' if self._passive else ''}")
        return super().on_activate(state)

    def on_deactivate(self, state: Any) -> TransitionCallbackReturn:
        assert self._driver is not None
        self._driver.deactivate()
        return super().on_deactivate(state)

    def on_cleanup(self, state: Any) -> TransitionCallbackReturn:
        assert self._driver is not None
        self._driver.destroy()
        self._driver = None
        return super().on_cleanup(state)

    def on_shutdown(self, state: Any) -> TransitionCallbackReturn:
        if self._driver is not None:
            self._driver.deactivate()
        return super().on_shutdown(state)

    def last_messages(self) -> Iterable[Any]:
        return () if self._driver is None else self._driver.last_messages()

    def _check_parameters(self, parameters: list[Parameter]) -> SetParametersResult:
        """Load a new policy; refuse it outside the menu or if it cannot be used."""
        for change in parameters:
            if change.name != "policy" or self._driver is None:
                continue
            selection = self._driver.selection
            state = selection.executor.game_state
            if state not in ("menu", None):
                return SetParametersResult(successful=False, reason=f"policy: the game is in state {state!r}, not menu")
            HEART.beat(LONG_S)
            try:
                policy = rehearse(make_policy(change.value), selection.view, self.config, current().perf_counter)
                self._loaded = change.value, policy
            except _UNUSABLE as error:
                return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _use_loaded(self, parameters: list[Parameter]) -> None:
        if self._loaded is not None and self._driver is not None:
            self._driver.selection.spec, self._driver.selection.policy = self._loaded
            self.once.over(POLICY_FAILS)
            self.get_logger().info(f"policy {self._loaded[0]}")
        self._loaded = None


main = partial(run, GoalSelector, NAME)

if __name__ == "__main__":
    sys.exit(main())
