"""rclpy's private attributes: one module uses them, and nodes work without them."""

import ast
from pathlib import Path
from types import SimpleNamespace

from rclpy.parameter import Parameter

from pacman_env import ros
from pacman_env.ros import rclpy_private

OWN = {"self", "cls", "os"}  # os._exit


def private_uses(file: Path) -> list[str]:
    """List the private attributes of other objects that a module uses."""
    found = (node for node in ast.walk(ast.parse(file.read_text())) if isinstance(node, ast.Attribute))
    names = ((ast.unparse(node.value), node.attr) for node in found)
    return [f"{owner}.{name}" for owner, name in names if name[0] == "_" and name[:2] != "__" and owner not in OWN]


def test_one_module_alone_uses_private_attributes() -> None:
    files = sorted(Path(ros.__file__).parent.rglob("*.py"))
    assert [file.name for file in files if private_uses(file)] == [Path(rclpy_private.__file__).name]


def test_nodes_work_without_private_attributes() -> None:
    rclpy_private.accept_integers(SimpleNamespace(), "speed")
    rclpy_private.destroy_state_machine(SimpleNamespace())
    node = SimpleNamespace(_parameter_overrides={"speed": Parameter("speed", Parameter.Type.INTEGER, 4)})
    rclpy_private.accept_integers(node, "speed")
    assert node._parameter_overrides["speed"].value == 4.0
