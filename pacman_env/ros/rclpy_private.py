"""All uses of rclpy's private attributes, for rclpy 7 (ROS 2 Jazzy)."""

from typing import Any

from rclpy.action.server import GoalEvent
from rclpy.parameter import Parameter


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


def start_goal(goal: Any) -> None:
    """Set an accepted goal to EXECUTING without calling its callback."""
    goal._update_state(GoalEvent.EXECUTE)
