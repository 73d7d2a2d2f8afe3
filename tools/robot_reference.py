"""``docs/robot_reference.md``, written from the running code: ``python -m tools.robot_reference``.

Every node is made once and asked what it declares, publishes and hears. Needs ROS (extra ``ros``, docs/robot.md);
no other tool does.
"""

from __future__ import annotations

import argparse
import importlib
import inspect
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import rclpy
from rclpy.logging import get_logger_effective_level, set_logger_level
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from pacman_env.cli.command import Parser, run_command
from pacman_env.ros.bags.record import RECORDED
from pacman_env.ros.node import BaseNode
from pacman_env.ros.supervisor.checks import CHECKS
from pacman_env.ros.supervisor.game_nodes import NODES, module_of
from pacman_env.ros.topics import LATCHED, RECEIVED_LATCHED, RosAction
from tools.reference import table, update

PAGE = Path(__file__).resolve().parents[1] / "docs" / "robot_reference.md"
INTRO = """# Robot reference: nodes, topics, parameters

Written by `scripts/robot_reference` from the nodes themselves; [robot.md](robot.md) says how they are used. All names
are relative, so that the robot's namespace applies (`/robot_15/game_state`); parameters are given as
`--ros-args -p NAME:=VALUE`, and are read once, at the start, where their meaning says nothing else.
"""
_EVERY_NODE_HAS = ("use_sim_time", "start_type_description_service", "qos_overrides.")
_OWN = ("rcl_interfaces/", "type_description_interfaces/", "lifecycle_msgs/", "rosgraph_msgs/")  # of ROS itself
_ENDS_OF_ACTIONS = {"server": "serves", "client": "calls", "goal_client": "calls"}  # methods of ``RosAction``
_PART_OF_ACTION = "/_action/"
_TYPES = {1: "bool", 2: "int", 3: "float", 4: "string", 8: "float array", 9: "string array"}


@dataclass
class Described:
    """One node as text."""

    purpose: str
    parameters: list[list[str]] = field(default_factory=list)
    ends: list[tuple[str, str, str, str]] = field(default_factory=list)  # name, type, kind of end, QoS


def describe(name: str) -> Described:
    """Make a node and ask it; rclpy must be initialised, with ``map_yaml`` among its arguments."""
    module = importlib.import_module(module_of(name))
    made = next(
        one
        for one in vars(module).values()
        if inspect.isclass(one) and one.__module__ == module.__name__ and _is_node(one)
    )
    with _noted_actions() as actions:
        node: Any = made()
    try:
        found = Described((inspect.getdoc(module) or "").split("\n\n")[0].replace("\n", " ").replace("``", "`"))
        found.parameters = [_parameter(node, one) for one in _declared(node)]
        for ends, kind in ((node.publishers, "publishes"), (node.subscriptions, "hears")):
            for end in ends:
                found.ends.append((_bare(end.topic_name, node), _type(end.msg_type), kind, _qos(end.qos_profile)))
        for ends, kind in ((node.services, "serves"), (node.clients, "calls")):
            for end in ends:
                found.ends.append((_bare(end.srv_name, node), _type(end.srv_type), kind, "service"))
        ends = {end for end in found.ends if not end[1].startswith(_OWN) and _PART_OF_ACTION not in end[0]}
        found.ends = sorted({*ends, *actions})
    finally:
        node.destroy_node()
    return found


@contextmanager
def _noted_actions() -> Iterator[list[tuple[str, str, str, str]]]:
    """The ends of actions that are made meanwhile: rclpy does not know an action's name afterwards."""
    noted: list[tuple[str, str, str, str]] = []
    before = {name: getattr(RosAction, name) for name in _ENDS_OF_ACTIONS}

    def noting(name: str, kind: str) -> Any:
        def make(action: RosAction, *arguments: Any, **options: Any) -> Any:
            noted.append((action.name, action.type_name, kind, "action"))
            return before[name](action, *arguments, **options)

        return make

    try:
        for name, kind in _ENDS_OF_ACTIONS.items():
            setattr(RosAction, name, noting(name, kind))
        yield noted
    finally:
        for name, method in before.items():
            setattr(RosAction, name, method)


def _is_node(one: type) -> bool:
    return issubclass(one, BaseNode)


def _declared(node: Any) -> list[str]:
    names = list(node._parameters)  # rclpy has no public list of them within a process
    return [name for name in names if not name.startswith(_EVERY_NODE_HAS)]


def _parameter(node: Any, name: str) -> list[str]:
    descriptor = node.describe_parameter(name)
    value = node.get_parameter_or(name).value
    low_high = [*descriptor.floating_point_range, *descriptor.integer_range]
    limits = f"{low_high[0].from_value:g} to {low_high[0].to_value:g}" if low_high else ""
    shown = "" if value is None else f"`{value}`" if value != "" else '`""`'
    shown = {"map_yaml": "to be given", "settings": ""}.get(name, shown)
    return [f"`{name}`", _TYPES.get(descriptor.type, ""), shown, limits, descriptor.description]


def _bare(name: str, node: Any) -> str:
    return name.removeprefix(node.get_namespace().rstrip("/") + "/")


def _type(kind: Any) -> str:
    return f"{kind.__module__.partition('.')[0]}/{kind.__name__}"


def _qos(profile: Any) -> str:
    reliable = profile.reliability != ReliabilityPolicy.BEST_EFFORT
    latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    depth = LATCHED.depth if latched and profile.depth == RECEIVED_LATCHED.depth else profile.depth  # as of its sender
    return f"{'reliable' if reliable else 'best effort'}{', latched' if latched else ''}, depth {depth}"


def page() -> str:
    context_arguments = ["--ros-args", "-r", "__ns:=/robot", "-p", "map_yaml:=house", "--disable-external-lib-logs"]
    context_arguments += ["-p", f'settings:=["clyde.ghosts={",".join(4 * ["wander"])}"]', "--log-level", "fatal"]
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    level = get_logger_effective_level("")
    rclpy.init(args=context_arguments, signal_handler_options=SignalHandlerOptions.NO)
    try:
        nodes = {name: describe(name) for name in NODES}
    finally:
        rclpy.shutdown()
        set_logger_level("", level)  # the level is the process's: it outlives the context that set it
    return INTRO + _topics(nodes) + "".join(_node(name, node) for name, node in nodes.items()) + _checks()


def _topics(nodes: dict[str, Described]) -> str:
    recorded = {topic.name for topic in RECORDED}
    rows: dict[tuple[str, str, str], dict[str, list[str]]] = {}
    for node, described in nodes.items():
        for name, kind, role, qos in described.ends:
            if qos not in ("service", "action"):
                by_role = rows.setdefault((name, kind, qos), {"publishes": [], "hears": []})
                by_role[role].append(node)
    head = ("Topic", "Type", "QoS", "From", "To", "Recorded")
    lines = [
        [f"`{name}`", f"`{kind}`", qos, *(", ".join(roles[r]) or "-" for r in roles), "yes" if name in recorded else ""]
        for (name, kind, qos), roles in sorted(rows.items())
    ]
    text = "\n## Topics\n\nA topic without a sender or receiver here belongs to Nav2, AMCL, the base or RViz. "
    text += "Of a latched topic of depth 1 a listener keeps the last 10.\n\n"
    text += table(head, lines) + "\n## Services and actions\n\n"
    calls: dict[tuple[str, str, str], dict[str, list[str]]] = {}
    for node, described in nodes.items():
        for name, kind, role, qos in described.ends:
            if qos in ("service", "action"):
                calls.setdefault((name, kind, qos), {"serves": [], "calls": []})[role].append(node)
    lines = [
        [f"`{name}`", f"`{kind}`", what, *(", ".join(roles[r]) or "-" for r in roles)]
        for (name, kind, what), roles in sorted(calls.items())
    ]
    return text + table(("Name", "Type", "Kind", "Served by", "Called by"), lines)


def _node(name: str, node: Described) -> str:
    text = f"\n## {name}\n\n{node.purpose}\n"
    if node.parameters:
        text += "\n" + table(("Parameter", "Type", "Default", "Range", "Meaning"), node.parameters)
    return text


def _checks() -> str:
    rows = [[check.name, check.question] for check in CHECKS]
    text = "\n## Checks of `pacman-env ros doctor`\n\nWhat is BAD is best remedied in this order.\n\n"
    return text + table(("Check", "Question"), rows)


def main(argv: Sequence[str] | None = None) -> int:
    """Write the page; returns the exit status: 1 where ``--check`` finds another one."""
    parser = Parser(prog="python -m tools.robot_reference", description="Write docs/robot_reference.md.")
    parser.add_argument("page", nargs="?", type=Path, default=PAGE, help="the file (%(default)s)")
    parser.add_argument("--check", action="store_true", help="write nothing, compare with what is there")
    return run_command(parser, argv, _write, "ros")


def _write(arguments: argparse.Namespace) -> int:
    before = arguments.page.read_text(encoding="utf-8") if arguments.page.is_file() else ""
    complaint = "is not what the nodes declare: run scripts/robot_reference"
    return update(arguments.page, before, page(), arguments.check, complaint)


if __name__ == "__main__":
    sys.exit(main())
