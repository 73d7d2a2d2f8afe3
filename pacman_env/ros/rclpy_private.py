"""All uses of rclpy's private attributes, as rclpy 7 (ROS 2 Jazzy) has them.

Lock-step cannot do without them and refuses other versions; nodes in processes of their own do without what is absent.
"""

from importlib import metadata
from typing import Any

from rclpy.action import ActionClient, ActionServer
from rclpy.parameter import Parameter
from rclpy.subscription import Subscription

KNOWN_MAJOR = "7"


def require_known_version() -> None:
    """Raise ValueError if rclpy says that it is another version than the one whose private attributes are known."""
    try:
        version = metadata.version("rclpy")
    except metadata.PackageNotFoundError:  # built without metadata: the attributes are tried
        return
    if version.partition(".")[0] != KNOWN_MAJOR:
        raise ValueError(f"lock-step: needs rclpy {KNOWN_MAJOR} (ROS 2 Jazzy), here is rclpy {version}")


# Of any node


def accept_integers(node: Any, name: str) -> None:
    """``speed:=4`` is an integer, or an array of them, for ROS: have it mean 4.0 before the parameter is declared."""
    overrides = getattr(node, "_parameter_overrides", {})  # without them rclpy refuses the integer in words of its own
    given = overrides.get(name)
    if given is not None and given.type_ is Parameter.Type.INTEGER:
        overrides[name] = Parameter(name, Parameter.Type.DOUBLE, float(given.value))
    elif given is not None and given.type_ is Parameter.Type.INTEGER_ARRAY:
        overrides[name] = Parameter(name, Parameter.Type.DOUBLE_ARRAY, [float(n) for n in given.value])


def destroy_state_machine(node: Any) -> None:
    """Destroy what would keep a lifecycle node and its logger's name after ``destroy_node``."""
    machine = getattr(node, "_state_machine", None)
    if machine is not None:
        machine.destroy_when_not_in_use()


# Of lock-step alone


def activate_ros_time(clock: Any) -> None:
    clock._set_ros_time_is_active(True)


def takes_message_alone(sub: Subscription) -> bool:
    """Whether the callback takes the message without its times."""
    return sub._callback_type is Subscription.CallbackType.MessageOnly


def has_goals(server: ActionServer) -> bool:
    return bool(server._goal_handles)


def expire_goals(server: ActionServer) -> Any:
    """Forget the goals that ended 15 minutes ago, and return them; rcl raises an error for a server without goals."""
    return server._handle.expire_goals(len(server._goal_handles)) if has_goals(server) else ()


#: Flags of rclpy's ends of actions, which a wait set would set. A wait set takes a millisecond each time, an attempt to
#: take what is not there a microsecond.
_READY = {
    ActionServer: ("_is_goal_request_ready", "_is_cancel_request_ready", "_is_result_request_ready"),
    ActionClient: (
        *("_is_goal_response_ready", "_is_cancel_response_ready", "_is_result_response_ready"),
        *("_is_feedback_ready", "_is_status_ready"),
    ),
}


def mark_ready(waitable: ActionServer | ActionClient) -> None:
    """Have ``take_data`` try everything that may have come for an action's end."""
    if isinstance(waitable, ActionServer):
        waitable._is_goal_expired = False
    for flag in _READY[type(waitable)]:
        setattr(waitable, flag, True)


def run_callbacks_in(executor: Any, *futures: Any) -> None:
    """Have futures call back by an executor of ours."""
    for future in futures:
        future._set_executor(executor)


def futures_of(waitable: ActionServer | ActionClient) -> Any:
    return waitable._futures
