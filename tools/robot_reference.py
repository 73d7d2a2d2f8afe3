"""Write ``docs/robot_reference.md`` from one instance of every node: ``python -m tools.robot_reference``."""

import inspect
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rclpy
from rclpy.action import get_action_client_names_and_types_by_node as client_names_and_types
from rclpy.action import get_action_server_names_and_types_by_node as server_names_and_types
from rclpy.logging import get_logger_effective_level, set_logger_level
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from pacman_env.command_line.command import Parser, run_command
from pacman_env.ros.bags.record import RECORDED
from pacman_env.ros.game_nodes import NODES
from pacman_env.ros.node_classes import node_class
from pacman_env.ros.supervisor.checks import CHECKS
from pacman_env.ros.topics import LATCHED, RECEIVED_LATCHED
from tools.common import ROOT, add_check, table, update

PAGE = ROOT / "docs" / "robot_reference.md"
INTRO = """# Robot reference: nodes, topics, parameters

Written by `scripts/robot_reference` from the nodes themselves; [robot.md](robot.md) describes their use. All names
are relative, so that the robot's namespace applies (`/robot_15/game_state`); parameters are given as
`--ros-args -p NAME:=VALUE`, and are read once, at the start, unless their meaning states otherwise.
"""
_EVERY_NODE_HAS = ("use_sim_time", "start_type_description_service", "qos_overrides.")
_OWN = ("rcl_interfaces/", "type_description_interfaces/", "lifecycle_msgs/", "rosgraph_msgs/")  # types of ROS itself
_TYPES = {1: "bool", 2: "int", 3: "float", 4: "string", 8: "float array", 9: "string array"}
_End = tuple[str, str, str, str]  # name, type, role, and QoS, "service" or "action"


@dataclass
class Described:
    purpose: str
    parameters: list[list[str]]
    ends: list[_End]


def describe(name: str) -> Described:
    """Create a node and describe it; rclpy must be initialised, with ``map_yaml`` among its arguments."""
    node: Any = node_class(name)()  # type: ignore[call-arg]
    try:
        declared = list(node._parameters)  # rclpy has no public list of parameters within a process
        purpose = (inspect.getdoc(sys.modules[type(node).__module__]) or "").split("\n\n")[0]
        parameters = [_parameter(node, one) for one in declared if not one.startswith(_EVERY_NODE_HAS)]
        return Described(purpose.replace("\n", " ").replace("``", "`"), parameters, sorted({*_ends_of(node)}))
    finally:
        node.destroy_node()


def _ends_of(node: Any) -> Iterator[_End]:
    ends = [(end.topic_name, end.msg_type, "publishes", _qos(end.qos_profile)) for end in node.publishers]
    ends += [(end.topic_name, end.msg_type, "subscribes", _qos(end.qos_profile)) for end in node.subscriptions]
    ends += [(end.srv_name, end.srv_type, "serves", "service") for end in node.services]
    ends += [(end.srv_name, end.srv_type, "calls", "service") for end in node.clients]
    rows: list[Any] = [(name, f"{kind.__module__.split('.')[0]}/{kind.__name__}", *more) for name, kind, *more in ends]
    arguments = node, node.get_name(), node.get_namespace()
    for role, names_and_types in (("serves", server_names_and_types), ("calls", client_names_and_types)):
        rows += [(name, kind.replace("/action/", "/"), role, "action") for name, (kind,) in names_and_types(*arguments)]
    for name, kind, role, qos in rows:
        if not kind.startswith(_OWN) and "/_action/" not in name:
            yield name.removeprefix(node.get_namespace().rstrip("/") + "/"), kind, role, qos


def _parameter(node: Any, name: str) -> list[str]:
    descriptor = node.describe_parameter(name)
    value = node.get_parameter_or(name).value
    low_high = [*descriptor.floating_point_range, *descriptor.integer_range]
    limits = f"{low_high[0].from_value:g} to {low_high[0].to_value:g}" if low_high else ""
    shown = "" if value is None else f"`{value}`" if value != "" else '`""`'
    shown = {"map_yaml": "to be given", "settings": ""}.get(name, shown)
    return [f"`{name}`", _TYPES.get(descriptor.type, ""), shown, limits, descriptor.description]


def _qos(profile: Any) -> str:
    reliable = profile.reliability != ReliabilityPolicy.BEST_EFFORT
    latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    depth = LATCHED.depth if latched and profile.depth == RECEIVED_LATCHED.depth else profile.depth  # the sender's
    return f"{'reliable' if reliable else 'best effort'}{', latched' if latched else ''}, depth {depth}"


def page() -> str:
    context_arguments = ["--ros-args", "-r", "__ns:=/robot", "-p", "map_yaml:=house", "--disable-external-lib-logs"]
    settings = f'["clyde.ghosts={",".join(4 * ["wander"])}", "power.pellets=1"]'  # all topics that nodes can have
    context_arguments += ["-p", f"settings:={settings}", "--log-level", "fatal"]
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    level = get_logger_effective_level("")
    rclpy.init(args=context_arguments, signal_handler_options=SignalHandlerOptions.NO)
    try:
        nodes = {name: describe(name) for name in NODES}
    finally:
        rclpy.shutdown()
        set_logger_level("", level)  # the level belongs to the process, not to the context
    text = INTRO + _ends(nodes)
    for name, node in nodes.items():
        text += f"\n## {name}\n\n{node.purpose}\n"
        if node.parameters:
            text += "\n" + table(("Parameter", "Type", "Default", "Range", "Meaning"), node.parameters)
    text += "\n## Checks of `pacman-env ros doctor`\n\nWhat is BAD is best remedied in this order.\n\n"
    return text + table(("Check", "Question"), [[check.name, check.question] for check in CHECKS])


def _ends(nodes: dict[str, Described]) -> str:
    recorded = {f"`{topic.name}`" for topic in RECORDED}
    topics = _rows(nodes, ("publishes", "subscribes"))
    text = "\n## Topics\n\nA topic without a sender or receiver here belongs to Nav2, AMCL, the base or RViz. "
    text += "Of a latched topic of depth 1 a subscription stores the last 10.\n\n"
    rows = ([*row, "yes" if row[0] in recorded else ""] for row in topics)
    text += table(("Topic", "Type", "QoS", "From", "To", "Recorded"), rows)
    text += "\n## Services and actions\n\n"
    return text + table(("Name", "Type", "Kind", "Served by", "Called by"), _rows(nodes, ("serves", "calls")))


def _rows(nodes: dict[str, Described], roles: Iterable[str]) -> list[list[str]]:
    """Return rows of name, type, QoS or kind, and the nodes that have each role."""
    users: dict[tuple[str, str, str], dict[str, list[str]]] = {}
    for node, described in nodes.items():
        for name, kind, role, qos in described.ends:
            if role in roles:
                users.setdefault((name, kind, qos), {role: [] for role in roles})[role].append(node)
    return [
        [f"`{name}`", f"`{kind}`", qos, *(", ".join(by_role[role]) or "-" for role in roles)]
        for (name, kind, qos), by_role in sorted(users.items())
    ]


def main(argv: Sequence[str] | None = None) -> int:
    parser = Parser(prog="python -m tools.robot_reference", description="Write docs/robot_reference.md.")
    parser.add_argument("page", nargs="?", type=Path, default=PAGE, help="the file (%(default)s)")
    add_check(parser)
    complaint = "is not what the nodes declare: run scripts/robot_reference"
    return run_command(parser, argv, lambda given: update(given.page, page(), given.check, complaint), "ros")


if __name__ == "__main__":
    sys.exit(main())
