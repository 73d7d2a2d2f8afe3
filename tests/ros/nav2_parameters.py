"""The parameters that Nav2 declares, read from its sources: ``python -m tests.ros.nav2_parameters --sources FOLDER``.

Writes ``tests/ros/golden/nav2_parameters.json``, which ``config/nav2.yaml`` is held against: for every node and every
plugin type the names and, where the source says them literally, defaults; with ``--turtlebot`` also the values of
TurtleBot 4's own file. Both folders are git repositories, bare or not; the commit that was read is written beside.

Nav2 is C++ that declares names at run time, so this is a reading of calls, not a compiler: a name begins with the
plugin's own name (then it is relative to it) or with a string (then it is the node's), and a part that only a run
tells, such as the name of a source of observations, is ``*``.
"""

from __future__ import annotations

import argparse
import json
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from pacman_env.cli.command import Parser, run_command

DATA = Path(__file__).with_name("golden") / "nav2_parameters.json"

#: The folder and the classes that declare the parameters of a node; what a class inherits comes with it.
NODES = {
    "bt_navigator": ("nav2_bt_navigator", "BtNavigator", "BtActionServer"),
    "controller_server": ("nav2_controller", "ControllerServer", "TwistPublisher"),
    "local_costmap": ("nav2_costmap_2d", "Costmap2DROS"),
    "global_costmap": ("nav2_costmap_2d", "Costmap2DROS"),
    "planner_server": ("nav2_planner", "PlannerServer"),
    "smoother_server": ("nav2_smoother", "SmootherServer"),
    "behavior_server": ("nav2_behaviors", "BehaviorServer", "TwistPublisher", "TwistSubscriber"),
    "waypoint_follower": ("nav2_waypoint_follower", "WaypointFollower"),
    "velocity_smoother": ("nav2_velocity_smoother", "VelocitySmoother", "TwistPublisher", "TwistSubscriber"),
    "collision_monitor": ("nav2_collision_monitor", "CollisionMonitor", "TwistPublisher", "TwistSubscriber"),
    "docking_server": ("nav2_docking", "DockingServer", "Controller", "Navigator", "DockDatabase", "TwistPublisher"),
}
#: Types that no pluginlib file lists: the collision monitor makes them itself, by the words of ``type``.
BUILT_IN = {
    "polygon": "Polygon",
    "circle": "Circle",
    "velocity_polygon": "VelocityPolygon",
    "scan": "Scan",
    "pointcloud": "PointCloud",
    "range": "Range",
    "polygon_source": "PolygonSource",
}
#: Classes that declare for a plugin and that it does not inherit.
_PARTS = {
    "MPPIController": [
        *("Optimizer", "PathHandler", "TrajectoryVisualizer", "NoiseGenerator", "CriticManager"),
        *("AckermannMotionModel", "ParametersHandler"),
    ]
}
_EVERY_NODE = {"use_sim_time": False}  # declared by rclcpp
_OWN_NAMES = {"name", "name_", "plugin_name", "plugin_name_", "base_name", "behavior_name_", "source_name_"}
_OWN_NAMES |= {"polygon_name_", "getName()", "this->getName()", "node_name_"}
_DECLARATION = re.compile(
    r"\b(declare_parameter_if_not_declared|declare_parameter|declareParameter)\s*(?:<[^()]*?>)?\("
)
_GETTER = re.compile(r"auto (\w+) = \w+(?:->|\.)getParamGetter\(([^;]*)\);")
_METHOD = re.compile(r"^(?:\w[\w:<>,&*~ ]*[ &*])?(\w+)(?:<[\w, ]+>)?::~?\w+\(", re.MULTILINE)
_CLASS = re.compile(r"^(?:class|struct) (\w+)\s*(?:final)?\s*(?::([^{;]*))?\{", re.MULTILINE)
_COMMENT = re.compile(r'("(?:\\.|[^"\\])*")|//[^\n]*|/\*.*?\*/', re.DOTALL)


@dataclass
class Class:
    """What one C++ class declares: names relative to the plugin, and names of the node."""

    bases: list[str] = field(default_factory=list)
    relative: dict[str, Any] = field(default_factory=dict)
    absolute: dict[str, Any] = field(default_factory=dict)


Classes = dict[str, dict[str, Class]]  # by the folder of a package, then by name


class Repository:
    """A revision of a git repository."""

    def __init__(self, folder: Path, revision: str) -> None:
        self.folder, self.revision = folder, revision
        self.commit = self._git("rev-parse", f"{revision}^{{commit}}").strip()

    def _git(self, *words: str) -> str:
        done = subprocess.run(["git", "-C", str(self.folder), *words], capture_output=True, text=True)
        if done.returncode:
            raise ValueError(f"{self.folder}: git {words[0]}: {done.stderr.strip()}")
        return done.stdout

    def names(self) -> list[str]:
        """Of all files."""
        return self._git("ls-tree", "-r", "--name-only", self.commit).splitlines()

    def text(self, name: str) -> str:
        """Of one file."""
        return self._git("show", f"{self.commit}:{name}")


def main(argv: Sequence[str] | None = None) -> int:
    """Read the sources and write the data."""
    return run_command(_parser(), argv, _run)


def _parser() -> Parser:
    parser = Parser(prog="python -m tests.ros.nav2_parameters", description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--sources", type=Path, required=True, help="git repository of navigation2")
    parser.add_argument("--revision", default="HEAD", help="of the sources: a branch, tag or commit")
    parser.add_argument("--turtlebot", type=Path, help="git repository with turtlebot4_navigation")
    parser.add_argument("--turtlebot-revision", default="HEAD", help="of that")
    parser.add_argument("--output", type=Path, default=DATA)
    return parser


def _run(options: argparse.Namespace) -> int:
    sources = Repository(options.sources, options.revision)
    content = declared(sources)
    if options.turtlebot:
        content["turtlebot4"] = turtlebot_values(Repository(options.turtlebot, options.turtlebot_revision))
    elif options.output.is_file():
        content["turtlebot4"] = json.loads(options.output.read_text())["turtlebot4"]
    options.output.write_text(json.dumps(content, indent=1, sort_keys=True) + "\n")
    print(f"{len(content['nodes'])} nodes, {len(content['plugins'])} plugin types of {sources.commit}")
    return 0


def declared(sources: Repository) -> dict[str, Any]:
    """Nodes and plugin types with the parameters that they declare, and where that was read."""
    names = [name for name in sources.names() if not re.search(r"(^|/)(test|tests|nav2_system_tests)/", name)]
    classes: Classes = {}
    for name in names:
        if name.endswith((".cpp", ".hpp")):
            read(sources.text(name), classes.setdefault(name.partition("/")[0], {}))
    nodes = {}
    for node, (folder, *parts) in NODES.items():
        found = [gathered(part, folder, classes) for part in (*parts, "LifecycleNode")]
        nodes[node] = _EVERY_NODE | {name: value for one in found for name, value in one.absolute.items()}
        nodes[node] |= {name: value for one in found for name, value in one.relative.items()}
    plugins = {}
    for word, part in BUILT_IN.items():
        plugins[f"collision_monitor {word}"] = _merged([gathered(part, "nav2_collision_monitor", classes)])
    for name in names:
        if name.endswith(".xml") and not name.endswith("package.xml"):
            for tag in re.findall(r"<class\b[^>]*>", sources.text(name)):
                named: dict[str, str] = dict(re.findall(r"\b(name|type)=\"([\w:]+)", tag))
                last = named["type"].rpartition("::")[2]
                found = [gathered(one, name.partition("/")[0], classes) for one in (last, *_PARTS.get(last, ()))]
                plugins[named.get("name") or named["type"]] = _merged(found)  # a file for Nav2 says the name
    version = re.search(r"<version>(.*?)</version>", sources.text("navigation2/package.xml"))
    return {
        "source": {
            "repository": "https://github.com/ros-navigation/navigation2",
            "commit": sources.commit,
            "version": version.group(1) if version else None,
        },
        "nodes": nodes,
        "plugins": plugins,
    }


def turtlebot_values(repository: Repository) -> dict[str, Any]:
    """Every value of TurtleBot 4's file, by node and name."""
    (name,) = [n for n in repository.names() if n in ("config/nav2.yaml", "turtlebot4_navigation/config/nav2.yaml")]
    return {"commit": repository.commit, "values": by_node(yaml.safe_load(repository.text(name)))}


def by_node(content: dict[str, Any]) -> dict[str, dict[str, Any]]:
    """The values of a parameter file by node, names joined with dots."""
    inner = {node: one.get(node, one)["ros__parameters"] for node, one in content.items()}  # costmaps are nested
    return {node: dict(_flat(parameters)) for node, parameters in inner.items()}


def _flat(value: Any, name: str = "") -> Iterator[tuple[str, Any]]:
    if not isinstance(value, dict):
        yield name, value
        return
    for key, inner in value.items():
        yield from _flat(inner, f"{name}.{key}" if name else str(key))


def _merged(found: Sequence[Class]) -> dict[str, dict[str, Any]]:
    merged: dict[str, dict[str, Any]] = {"parameters": {}, "of_node": {}}
    for one in found:
        merged["parameters"] |= one.relative
        merged["of_node"] |= one.absolute
    return merged


def gathered(name: str, folder: str, classes: Classes, heirs: frozenset[str] = frozenset()) -> Class:
    """A class of a folder, or else of any, with all that it inherits; a base of the name of an heir is of a library."""
    homes = [folder, *sorted(classes)]
    home = next((home for home in homes if name in classes.get(home, ())), folder)
    own, whole = classes.get(home, {}).get(name, Class()), Class()
    for base in sorted(set(own.bases) - heirs - {name}):
        inherited = gathered(base, home, classes, heirs | {name})
        whole.relative |= inherited.relative
        whole.absolute |= inherited.absolute
    whole.relative |= own.relative
    whole.absolute |= own.absolute
    return whole


def read(text: str, classes: dict[str, Class]) -> None:
    """Add what one file of C++ says to ``classes``."""
    text = _COMMENT.sub(lambda match: match.group(1) or " ", text)
    owners = [(match.start(), match.group(1)) for match in _METHOD.finditer(text)]
    for match in _CLASS.finditer(text):
        owners.append((match.start(), match.group(1)))
        bases = [base.split("<")[0].rpartition("::")[2].strip() for base in (match.group(2) or "").split("public ")]
        classes.setdefault(match.group(1), Class()).bases += [
            base for base in (b.rstrip(", \n") for b in bases) if base
        ]
    owners.sort()

    def add(position: int, words: str, default: str, *, relative: bool = False, prefix: str = "") -> None:
        named = _name_of(words)
        owner = next((name for start, name in reversed(owners) if start < position), None)
        if named is None or owner is None:
            return
        begins_with_own, name = named
        into = classes.setdefault(owner, Class())
        (into.relative if relative or begins_with_own else into.absolute)[prefix + name] = _value_of(default)

    for match in _DECLARATION.finditer(text):
        arguments = list(_arguments(text, match.end()))
        if match.group(1) == "declare_parameter_if_not_declared":
            arguments = arguments[1:]
        if arguments:
            default = arguments[1] if len(arguments) > 1 else ""
            add(match.start(), arguments[0], default, relative=match.group(1) == "declareParameter")
    for getter in _GETTER.finditer(text):
        if "parent" in getter.group(2):
            continue  # of the controller that a critic belongs to, which declares it too
        start = getter.end()
        end = next((other.start() for other in _METHOD.finditer(text, start)), len(text))
        below = re.findall(r'"\.([\w.]+)"', getter.group(2))
        of_node = getter.group(2).strip() == "node_name_"
        for match in re.finditer(rf"\b{getter.group(1)}\(", text[start:end]):
            arguments = list(_arguments(text, start + match.end()))
            if len(arguments) >= 3:
                prefix = f"{below[0]}." if below else ""
                add(start, arguments[1], arguments[2], relative=not of_node, prefix=prefix)


def _arguments(text: str, start: int) -> Iterator[str]:
    """Of a call whose parenthesis opens before ``start``."""
    depth, begin, inside = 0, start, False
    for at in range(start, len(text)):
        sign = text[at]
        if sign == '"' and text[at - 1] != "\\":
            inside = not inside
        elif inside:
            continue
        elif sign in "({[":
            depth += 1
        elif sign in ")}]":
            if not depth:
                yield text[begin:at].strip()
                return
            depth -= 1
        elif sign == "," and not depth:
            yield text[begin:at].strip()
            begin = at + 1


def _name_of(words: str) -> tuple[bool, str] | None:
    """Whether a name begins with the plugin's own, and the rest of it."""
    words = re.sub(r"std::string\((\"[^\"]*\")\)", r"\1", words)
    parts = [part.strip() for part in words.split("+")]
    if not any(part.startswith('"') for part in parts):
        return None
    own = parts[0] in _OWN_NAMES
    name = "".join(part[1:-1] if part.startswith('"') else "*" for part in parts[own:])
    return own, name.lstrip(".")


def _value_of(default: str) -> Any:
    """A literal default; None where the source computes it or demands a value."""
    inner = re.sub(r"^(?:rclcpp::ParameterValue|std::string)\((.*)\)$", r"\1", default.strip(), flags=re.DOTALL)
    inner = re.sub(r"^(?:rclcpp::ParameterValue|std::string)\((.*)\)$", r"\1", inner.strip(), flags=re.DOTALL)
    array = re.fullmatch(r"std::vector<[\w:]+>(?:\(\s*)?\{(.*?)\}(?:\s*\))?", inner, re.DOTALL)
    if array:
        return [_value_of(one) for one in array.group(1).split(",")] if array.group(1).strip() else []
    inner = inner.strip()
    if inner in ("true", "false"):
        return inner == "true"
    if re.fullmatch(r'"[^"]*"', inner):
        return inner[1:-1]
    if re.fullmatch(r"-?\d+", inner):
        return int(inner)
    if re.fullmatch(r"-?\d*\.\d*(e-?\d+)?f?|-?\d+e-?\d+", inner):
        return float(inner.rstrip("f"))
    return None


if __name__ == "__main__":
    sys.exit(main())
