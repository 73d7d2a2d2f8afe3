"""All uses of rclpy's private attributes, for rclpy 7 (ROS 2 Jazzy).

Lock-step needs the attributes and refuses other versions. The nodes of a real game also work without them.
"""

from importlib import metadata
from typing import Any

from rclpy.action import ActionClient, ActionServer
from rclpy.action.server import GoalEvent
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription

KNOWN_MAJOR = "7"


def require_known_version() -> None:
    """Raise ValueError if rclpy reports a version whose private attributes are not known."""
    try:
        version = metadata.version("rclpy")
    except metadata.PackageNotFoundError:  # built without metadata: try the attributes
        return
    if version.partition(".")[0] != KNOWN_MAJOR:
        raise ValueError(f"lock-step: needs rclpy {KNOWN_MAJOR} (ROS 2 Jazzy), here is rclpy {version}")


# For all nodes


def accept_integers(node: Any, name: str) -> None:
    """Accept ``speed:=4`` as 4.0, and integer arrays as float arrays; call this before declaring the parameter."""
    overrides = getattr(node, "_parameter_overrides", {})  # without the attribute rclpy refuses the integer
    override = overrides.get(name)
    if override is not None and override.type_ is Parameter.Type.INTEGER:
        overrides[name] = Parameter(name, Parameter.Type.DOUBLE, float(override.value))
    elif override is not None and override.type_ is Parameter.Type.INTEGER_ARRAY:
        overrides[name] = Parameter(name, Parameter.Type.DOUBLE_ARRAY, [float(n) for n in override.value])


def destroy_state_machine(node: Any) -> None:
    """Destroy the state machine, which would keep a lifecycle node and its logger's name after ``destroy_node``."""
    machine = getattr(node, "_state_machine", None)
    if machine is not None:
        machine.destroy_when_not_in_use()


# For the simulated robot


def start_goal(goal: Any) -> None:
    """Set an accepted goal to EXECUTING without calling its callback."""
    goal._update_state(GoalEvent.EXECUTE)


# For lock-step only


def activate_ros_time(clock: Any) -> None:
    clock._set_ros_time_is_active(True)


def takes_message_alone(sub: Subscription) -> bool:
    """Return True if the callback takes the message without its timestamps."""
    return sub._callback_type is Subscription.CallbackType.MessageOnly


def has_goals(server: ActionServer) -> bool:
    return bool(server._goal_handles)


def expire_goals(server: ActionServer) -> Any:
    """Remove and return goals that ended at least 15 minutes ago; () if the server has no goals."""
    return server._handle.expire_goals(len(server._goal_handles)) if has_goals(server) else ()


#: Flags of rclpy's action clients and servers that a wait set would set. A wait set takes a millisecond each time; an
#: attempt to take missing data takes a microsecond.
_READY = {
    ActionServer: ("_is_goal_request_ready", "_is_cancel_request_ready", "_is_result_request_ready"),
    ActionClient: (
        *("_is_goal_response_ready", "_is_cancel_response_ready", "_is_result_response_ready"),
        *("_is_feedback_ready", "_is_status_ready"),
    ),
}


def mark_ready(waitable: ActionServer | ActionClient) -> None:
    """Make the next ``take_data`` look for every kind of message that an action client or server may receive."""
    if isinstance(waitable, ActionServer):
        waitable._is_goal_expired = False
    for flag in _READY[type(waitable)]:
        setattr(waitable, flag, True)


def run_callbacks_in(executor: Any, *futures: Any) -> None:
    """Make ``executor`` run the callbacks of these futures."""
    for future in futures:
        future._set_executor(executor)


def futures_of(waitable: ActionServer | ActionClient) -> Any:
    return waitable._futures
