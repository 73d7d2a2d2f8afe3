"""Whom a node can meet: its ROS domain, this machine alone or the network, and who else does what only one may do.

What is set here is read by the middleware when a process creates its first node: call it before. ROS is not imported.
"""

from __future__ import annotations

import contextlib
import os
import time
from collections.abc import Iterable, Iterator, MutableMapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

import yaml

from .supervisor.game_nodes import SIMULATOR

COSTMAPS = ("local_costmap", "global_costmap")  # names of nodes
HIGHEST_DOMAIN = 232  # of DDS, by its formula for ports
_NAMES_S = 1.0
_PLACELESS, _NOBODY = "_NODE_NAMESPACE_UNKNOWN_", "_NODE_NAME_UNKNOWN_"  # ROS's words
NAMELESS = "a node without a name"
_RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
BEYOND = ("ROS_DISCOVERY_SERVER", "ROS_STATIC_PEERS", "ROS_SUPER_CLIENT")  # other ways to others


def domain_of(text: str) -> int:
    """A ROS domain from a command line or an environment; an empty text is domain 0, as for ROS.

    Raises:
        ValueError: no whole number from 0 to 232.
    """
    if not text:
        return 0
    if not (text.isascii() and text.isdigit() and int(text) <= HIGHEST_DOMAIN):
        raise ValueError(f"ROS_DOMAIN_ID {text!r}: must be a whole number, 0 to {HIGHEST_DOMAIN}")
    return int(text)


def join(domain: int | None, this_machine: bool) -> int:
    """Choose what nodes made from now on can meet; returns the domain.

    Args:
        domain: None: that of the environment.
        this_machine: nobody on another one.

    Raises:
        ValueError: there is no such domain.
    """
    number = domain_of(os.environ.get("ROS_DOMAIN_ID", "") if domain is None else str(domain))
    os.environ["ROS_DOMAIN_ID"] = str(number)
    if this_machine:
        stay_on_this_machine()
    return number


def stay_on_this_machine(environment: MutableMapping[str, str] | None = None) -> None:
    """Keep nodes that are created from now on from meeting any on another machine, a real robot above all."""
    environment = os.environ if environment is None else environment
    environment[_RANGE] = "LOCALHOST"
    for name in BEYOND:
        environment.pop(name, None)


@contextlib.contextmanager
def undiscovered() -> Iterator[None]:
    """A context of rclpy that is made in the block meets no other: its nodes meet one another alone."""
    before = os.environ.get(_RANGE)
    os.environ[_RANGE] = "OFF"
    try:
        yield
    finally:
        if before is None:
            del os.environ[_RANGE]
        else:
            os.environ[_RANGE] = before


def simulated(arguments: Sequence[str]) -> bool:
    """Whether ROS arguments ask for simulated time, themselves or by a file of parameters; unreadable ones do not."""
    pairs = list(pairwise(arguments))
    given = [text for flag, text in pairs if flag in ("-p", "--param")]
    said = [value.strip().lower() for name, _, value in (text.partition(":=") for text in given) if _is_clock(name)]
    if said:
        return said[-1] in ("true", "yes", "on")
    return any(_asks(_content(text)) for flag, text in pairs if flag == "--params-file")


def _is_clock(name: str) -> bool:
    return name.rpartition(":")[2].strip() == "use_sim_time"


def _content(path: str) -> Any:
    try:
        return yaml.safe_load(Path(path).read_text())
    except (OSError, ValueError, yaml.YAMLError):
        return None  # ROS will say what is wrong


def _asks(content: Any) -> bool:
    if not isinstance(content, dict):
        return False
    return content.get("use_sim_time") is True or any(_asks(value) for value in content.values())


def unheard_by(node: Any, topic: str) -> list[str]:
    """Which of Nav2's two costmaps do not listen to a cloud; a simulated robot listens for both.

    Args:
        node: of rclpy.
        topic: the cloud's, relative to the node's namespace.
    """
    names = {info.node_name for info in node.get_subscriptions_info_by_topic(node.resolve_topic_name(topic))}
    known = SIMULATOR in names or _NOBODY in names  # a node that was frozen has lost its name for others
    return [] if known else [name for name in COSTMAPS if name not in names]


def publishers(node: Any, topics: Iterable[str]) -> list[str]:
    """Which other nodes publish on any of these topics: ``/robot_15/motion_control (odom)``.

    Args:
        node: of rclpy; its own publishers are left out.
        topics: names, relative to the node's namespace or absolute.
    """
    found = _publishers(node, topics)
    end = time.monotonic() + _NAMES_S
    while any(NAMELESS in who for who in found) and time.monotonic() < end:  # names come after what they have
        time.sleep(0.05)
        found = _publishers(node, topics)
    return found


def full_name(name: str, namespace: str) -> str:
    """A node's name with its namespace; what ROS says of one whose name it does not know is put in words."""
    return NAMELESS if name == _NOBODY or namespace == _PLACELESS else f"{namespace.rstrip('/')}/{name}"


def _publishers(node: Any, topics: Iterable[str]) -> list[str]:
    own = node.get_name(), node.get_namespace()
    found = set()
    for topic in topics:
        for info in node.get_publishers_info_by_topic(node.resolve_topic_name(topic)):
            who = info.node_name, info.node_namespace
            if who != own:
                found.add(f"{full_name(*who)} ({topic})")
    return sorted(found)
