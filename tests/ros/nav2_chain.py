"""What becomes of a parameter file between ``ros2 launch`` and Nav2's nodes.

The steps are those of public sources, written anew: turtlebot4_navigation's ``nav2.launch.py`` (2.1.1) and Nav2's
``navigation_launch.py`` (1.3.13) for the namespace, ``RewrittenYaml`` of nav2_common, ``ParameterFile`` of launch_ros
(jazzy, 0.26) for ``$(...)`` in the file. Whoever reads the file after that is rcl itself, and so it is here: in rclpy.
"""

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import rclpy
import yaml
from rclpy.context import Context
from rclpy.node import Node
from rclpy.signals import SignalHandlerOptions

#: Each costmap and the node that it lives in the process of; the costmap's own node lies below a namespace of its name.
COSTMAPS = {"local_costmap": "controller_server", "global_costmap": "planner_server"}
_SUBSTITUTION = re.compile(r"(?<!\\)\$\(([a-z][\w-]*)(?: ([^\s()'\"]+| *\"(?:[^\"$]|\$(?!\()|\$\(var [\w-]+\))*\"))?\)")


@cache
def nav2_yaml() -> dict[str, Any]:
    """The parameters of each node and costmap of the files in ``config/``, as they are written."""
    folder = Path(__file__).resolve().parents[2] / "config"
    files = [yaml.safe_load((folder / name).read_text()) for name in ("nav2.yaml", "localization.yaml")]
    return {name: node.get(name, node)["ros__parameters"] for file in files for name, node in file.items()}


def flat(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    """Parameters with their names joined with dots."""
    if not isinstance(value, dict):
        yield name, value
        return
    for key, inner in value.items():
        yield from flat(inner, f"{name}.{key}" if name else str(key))


@dataclass(frozen=True)
class Launched:
    """What a launch file makes of its argument ``namespace``."""

    variables: dict[str, str]  # that ``$(var ...)`` finds
    namespace: str  # of Nav2's nodes
    remappings: tuple[tuple[str, str], ...] = ()


def turtlebot4(namespace: str) -> Launched:
    """``ros2 launch turtlebot4_navigation nav2.launch.py``: completes the name, and leads two topics of the lidar."""
    full = namespace if not namespace or namespace.startswith("/") else f"/{namespace}"
    remappings = tuple((f"{full}/{costmap}/scan", f"{full}/scan") for costmap in COSTMAPS)
    return Launched({"namespace": full}, full or "/", remappings)


def nav2_bringup(namespace: str) -> Launched:
    """``ros2 launch nav2_bringup navigation_launch.py``, below a pushed namespace: hands the argument on as it is."""
    return Launched({"namespace": namespace}, f"/{namespace.strip('/')}")


def written(source: Path, launched: Launched, folder: Path) -> Path:
    """The file that Nav2's processes get as ``--params-file``."""
    content = yaml.safe_load(source.read_text())
    root = launched.variables["namespace"]
    text = yaml.dump({root: content} if root else content)
    path = folder / "launch_params"
    path.write_text(substituted(text, launched.variables))
    yaml.safe_load(path.read_text())  # ParameterFile refuses what is no YAML any more
    return path


def substituted(text: str, variables: dict[str, str]) -> str:
    """``text`` after launch's substitutions ``var`` and ``eval``; a variable that is not set is an error."""

    def perform(match: re.Match[str]) -> str:
        kind, argument = match.group(1), (match.group(2) or "").strip()
        if argument.startswith('"'):
            argument = substituted(argument[1:-1], variables)
        if kind == "var":
            return variables[argument]
        if kind == "eval":
            return str(eval(argument, {}, {**vars(math), "math": math}))
        raise ValueError(f"no rule for the substitution {match.group()!r}")

    return re.sub(r"\\(.)", r"\1", _SUBSTITUTION.sub(perform, text))


@contextmanager
def costmap_node(name: str, launched: Launched, parameters: Path, domain: int) -> Iterator[Node]:
    """The node of one costmap, in a process as launch starts it; rcl reads ``parameters`` when it is made."""
    process = [("__node", COSTMAPS[name]), ("__ns", launched.namespace), ("/tf", "tf"), ("/tf_static", "tf_static")]
    words = ["--ros-args", "--params-file", str(parameters)]
    for before, after in (*launched.remappings, *process):
        words += ["-r", f"{before}:={after}"]
    context = Context()
    rclpy.init(args=words, context=context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
    parent = launched.namespace.rstrip("/")
    own = ["--ros-args", "-r", f"__ns:={parent}/{name}", "-r", f"{name}:__node:={name}"]
    try:
        node = Node(name, context=context, cli_args=own, enable_rosout=False, start_parameter_services=False)
        yield node
        node.destroy_node()
    finally:
        rclpy.shutdown(context=context)


def subscribed_topics(node: Node) -> set[str]:
    """The full names of the topics of every source of the costmap's layers, as its node declares them.

    Subscribed to on the costmap's own node: only from Kilted on does a layer start from the namespace above it.
    """

    def declared(name: str, default: Any) -> Any:
        return node.declare_parameter(name, default).value or default

    found = set()
    for layer in declared("plugins", ["static_layer"]):
        for source in declared(f"{layer}.observation_sources", "").split():
            found.add(node.resolve_topic_name(declared(f"{layer}.{source}.topic", source)))
    return found
