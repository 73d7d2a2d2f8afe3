"""Write ``docs/robot_reference.md`` and ``config/game.yaml`` from one instance of every node.

Run ``python -m tools.robot_reference``, with ROS's message types installed. The text above the page's table of topics
and above the first parameter is written by hand.
"""

import importlib
import inspect
import json
import os
import sys
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from textwrap import wrap
from typing import Any
from unittest.mock import MagicMock

import rclpy
from rclpy.action import get_action_client_names_and_types_by_node as client_names_and_types
from rclpy.action import get_action_server_names_and_types_by_node as server_names_and_types
from rclpy.logging import get_logger_effective_level, set_logger_level
from rclpy.parameter import Parameter
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions

from pacman_env.command_line.command import Parser, run_command
from pacman_env.ros.bags.record import RECORDED
from pacman_env.ros.game_nodes import GAME, MODULES, ORIGINAL, SELECTOR
from pacman_env.ros.node import BAD_START, BaseNode
from pacman_env.ros.nodes.wait_for_amcl_pose import FOUND, NOT_FOUND
from pacman_env.ros.process import STOOD_STILL
from pacman_env.ros.supervisor import doctor, operator, up
from pacman_env.ros.supervisor.checks import CHECKS
from pacman_env.ros.topics import LATCHED, PROCESSES, RECEIVED_LATCHED
from tools.common import ROOT, add_check, table, update

PAGE = ROOT / "docs" / "robot_reference.md"
PARAMETERS = ROOT / "config" / "game.yaml"
_SENT = "start, reset, continue, stop, release"
#: Exit statuses: command, status, meaning.
STATUSES = [
    ["every node", "0", "stopped by a signal"],
    ["every node", f"{BAD_START}", "bad arguments or parameters, or another node or robot is there already"],
    ["every node", f"{STOOD_STILL}", "it stood still for so long that others may have lost it: start it again"],
    ["`wait_for_amcl_pose`", f"{FOUND}", "the robot has a pose"],
    ["`wait_for_amcl_pose`", f"{NOT_FOUND}", "no pose within `timeout_s`, or stopped before"],
    ["`pacman-env ros`", "2", "bad arguments, or a missing package"],
    ["`pacman-env ros up`", "0", "stopped as asked, or all `--rounds` are played"],
    ["`pacman-env ros up`", f"{up.NODE_LOST}", "a process could not be kept alive"],
    ["`pacman-env ros up`", f"{up.HAD_TO_KILL}", "a process did not stop and was killed"],
    [f"`pacman-env ros` {_SENT}", f"{operator.DONE}", "done"],
    [f"`pacman-env ros` {_SENT}", f"{operator.REFUSED}", "refused; `stop`: a node that drives has not obeyed yet"],
    [f"`pacman-env ros` {_SENT}, status", f"{operator.NO_ANSWER}", "no game, or no answer within `--wait`"],
    ["`pacman-env ros status`", f"{operator.DONE}", "everything was received"],
    [
        "`pacman-env ros status`",
        f"{operator.INCOMPLETE}",
        "a node or value is absent or pending, or the game is silent",
    ],
    ["`pacman-env ros doctor`", "0", "nothing is BAD"],
    ["`pacman-env ros doctor`", f"{doctor.NOT_READY}", "a check is BAD"],
]
_EVERY_NODE_HAS = ("use_sim_time", "start_type_description_service", "qos_overrides.")
_OWN = ("rcl_interfaces/", "type_description_interfaces/", "lifecycle_msgs/", "rosgraph_msgs/")  # types of ROS itself
_TYPES = {1: "bool", 2: "int", 3: "float", 4: "string", 8: "float array", 9: "string array"}
_End = tuple[str, str, str, str]  # name, type, role, and QoS, "service" or "action"


@dataclass
class _Parameter:
    name: str
    type: str
    default: Any  # None: not set
    limits: str
    meaning: str


@dataclass
class Described:
    purpose: str
    parameters: list[_Parameter]
    ends: list[_End]


def describe(name: str, **overrides: Any) -> Described:
    """Create a node and describe it; rclpy must be initialised, with ``map_yaml`` among its arguments."""
    module = importlib.import_module(MODULES[name])
    kinds = [one for one in vars(module).values() if isinstance(one, type) and issubclass(one, BaseNode)]
    make: Any = next(kind for kind in kinds if kind.__module__ == module.__name__)
    given: dict[str, Any] = {"parameter_overrides": [Parameter(one, value=value) for one, value in overrides.items()]}
    if name in (GAME, SELECTOR):
        given["ask"] = MagicMock()  # takes the place of the process with the policies
    node = make(**given)
    try:
        declared = list(node._parameters)  # rclpy has no public list of parameters within a process
        purpose = (inspect.getdoc(module) or "").split("\n\n")[0]
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


def _parameter(node: Any, name: str) -> _Parameter:
    descriptor = node.describe_parameter(name)
    value = {"map_yaml": "", "settings": None}.get(name, node.get_parameter_or(name).value)
    low_high = [*descriptor.floating_point_range, *descriptor.integer_range]
    limits = f"{low_high[0].from_value:g} to {low_high[0].to_value:g}" if low_high else ""
    return _Parameter(name, _TYPES.get(descriptor.type, ""), value, limits, descriptor.description)


def _qos(profile: Any) -> str:
    reliable = profile.reliability != ReliabilityPolicy.BEST_EFFORT
    latched = profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    depth = LATCHED.depth if latched and profile.depth == RECEIVED_LATCHED.depth else profile.depth  # the sender's
    return f"{'reliable' if reliable else 'best effort'}{', latched' if latched else ''}, depth {depth}"


def describe_all(*arguments: str) -> dict[str, Described]:
    """Describe all nodes, which are created with these ROS arguments."""
    context_arguments = ["--ros-args", *arguments, "-r", "__ns:=/robot", "-p", "map_yaml:=house"]
    settings = f'["clyde.ghosts={",".join(4 * ["wander"])}", "power.pellets=1"]'  # all topics that nodes can have
    context_arguments += ["-p", f"settings:={settings}", "--log-level", "fatal", "--disable-external-lib-logs"]
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    level = get_logger_effective_level("")
    rclpy.init(args=context_arguments, signal_handler_options=SignalHandlerOptions.NO)
    try:
        nodes = {name: describe(name) for name in MODULES}
        nodes[GAME].ends = sorted({*nodes[GAME].ends, *describe(GAME, selector=ORIGINAL).ends})
    finally:
        rclpy.shutdown()
        set_logger_level("", level)  # the level belongs to the process, not to the context
    return nodes


def page(nodes: dict[str, Described]) -> str:
    text = PAGE.read_text(encoding="utf-8").partition("| Topic |")[0] + _ends(nodes)
    for name, node in nodes.items():
        text += f"\n## {name}\n\n{node.purpose}\n"
        rows = [[f"`{one.name}`", one.type, _default(one), one.limits, one.meaning] for one in node.parameters]
        text += "\n" + table(("Parameter", "Type", "Default", "Range", "Meaning"), rows) if rows else ""
    text += "\n## Exit statuses\n\n" + table(("Command", "Status", "Meaning"), STATUSES)
    text += "\n## Checks of `pacman-env ros doctor`\n\nWhat is BAD is best remedied in this order.\n\n"
    return text + table(("Check", "Question"), [[check.name, check.question] for check in CHECKS])


def _default(parameter: _Parameter) -> str:
    if parameter.name == "map_yaml":
        return "to be given"
    return "" if parameter.default is None else f"`{parameter.default}`" if parameter.default != "" else '`""`'


def parameter_file(nodes: dict[str, Described]) -> str:
    text = PARAMETERS.read_text(encoding="utf-8").partition("\n/**/")[0]
    for name, node in nodes.items():
        lines = []
        for one in node.parameters:
            shown = "[]" if one.default is None else json.dumps(one.default)
            limits = f" ({one.limits})" if one.limits else ""
            lines += wrap(f"{one.meaning}{limits}", 120, initial_indent="    # ", subsequent_indent="    #   ")
            lines += [f"    {'# ' if one.default is None else ''}{one.name}: {shown}"]
        if lines:
            text += "\n".join([f"\n/**/{name}:", "  ros__parameters:", *lines, ""])
    return text


def _ends(nodes: dict[str, Described]) -> str:
    recorded = {f"`{topic.name}`" for topic in RECORDED}
    started = (PROCESSES.name, PROCESSES.type_name, "publishes", _qos(PROCESSES.qos))
    topics = _rows({**nodes, "ros up": Described("", [], [started])}, ("publishes", "subscribes"))
    rows = ([*row, "yes" if row[0] in recorded else ""] for row in topics)
    text = table(("Topic", "Type", "QoS", "From", "To", "Recorded"), rows)
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
    parser = Parser(
        prog="python -m tools.robot_reference", description="Write docs/robot_reference.md, config/game.yaml."
    )
    parser.add_argument("page", nargs="?", type=Path, default=PAGE, help="the reference (%(default)s)")
    parser.add_argument("parameters", nargs="?", type=Path, default=PARAMETERS, help="the parameters (%(default)s)")
    add_check(parser)

    def write(given: Any) -> int:
        nodes = describe_all()
        pages = {given.page: page(nodes), given.parameters: parameter_file(nodes)}
        complaint = "is not what the nodes declare: run scripts/robot_reference"
        return max([update(path, text, given.check, complaint) for path, text in pages.items()])

    return run_command(parser, argv, write, "ros")


if __name__ == "__main__":
    sys.exit(main())
