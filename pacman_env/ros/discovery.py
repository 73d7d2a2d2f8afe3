"""Control which nodes can be discovered: ROS domain, this machine or the network, other publishers.

The middleware reads these settings when a process creates its first node. ROS is not imported."""

import contextlib
import os
import re
import time
from collections.abc import Iterable, MutableMapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from pacman_env.files import user_folder

from .game_nodes import SIMULATOR

COSTMAPS = ("local_costmap", "global_costmap")  # node names
HIGHEST_DOMAIN = 232  # highest domain of DDS, from its formula for ports
_NAMES_S = 1.0
_UNKNOWN_NAMESPACE, _UNKNOWN_NAME = "_NODE_NAMESPACE_UNKNOWN_", "_NODE_NAME_UNKNOWN_"  # ROS's words
NAMELESS = "a node without a name"
_TRUE = ("true", "yes", "on", "y")  # in lower case, as ROS reads them
_SIMULATED = re.compile(rf"""^[^#\n]*\buse_sim_time["']?\s*:\s*({"|".join(_TRUE)})\b""", re.IGNORECASE | re.MULTILINE)
TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
PROFILES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE")
_UDP_ALONE = Path(__file__).with_name("udp_alone.xml")
#: Environment variables that make nodes discover other machines.
BEYOND = ("ROS_DISCOVERY_SERVER", "ROS_SUPER_CLIENT", "ROS_STATIC_PEERS")


def domain_of(text: str) -> int:
    """Parse a ROS domain from a command line or the environment; an empty text is domain 0, as in ROS."""
    if text and not (text.isascii() and text.isdigit() and int(text) <= HIGHEST_DOMAIN):
        raise ValueError(f"ROS_DOMAIN_ID {text!r}: must be a whole number, 0 to {HIGHEST_DOMAIN}")
    return int(text or 0)


def join(domain: int | None, this_machine: bool) -> int:
    """Set the domain of new nodes and return it; ``domain`` None: the domain of the environment.

    If ``this_machine``, the new nodes do not discover other machines.
    """
    number = domain_of(os.environ.get("ROS_DOMAIN_ID", "") if domain is None else str(domain))
    os.environ["ROS_DOMAIN_ID"] = str(number)
    avoid_shared_memory()
    provide_log_folder()
    if this_machine:
        stay_on_this_machine()
    return number


def stay_on_this_machine(environment: MutableMapping[str, str] = os.environ) -> None:
    """Prevent nodes created later from discovering other machines, such as a real robot."""
    environment["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
    for name in BEYOND:
        environment.pop(name, None)


def provide_log_folder() -> None:
    """Set a folder for ROS's logs if the user has no home, because ROS creates no node without one."""
    if not any(os.environ.get(name) for name in ("ROS_LOG_DIR", "ROS_HOME")):
        try:
            Path(os.environ["HOME"], ".ros", "log").mkdir(parents=True, exist_ok=True)  # as ROS does
        except (KeyError, OSError):
            os.environ["ROS_LOG_DIR"] = str(user_folder("log") / "ros")


def avoid_shared_memory(environment: MutableMapping[str, str] = os.environ) -> None:
    """Make nodes created later communicate by UDP only, unless the user's environment or profile decides.

    Fast DDS 2.14 does not notice that a process was killed while reading its shared-memory port: it deletes the port
    when the process restarts, but older processes may write to the deleted port forever.
    """
    if not (environment.get("RMW_IMPLEMENTATION") or "rmw_fastrtps").startswith("rmw_fastrtps"):
        return
    files = [environment[name] for name in PROFILES if environment.get(name)]
    profiles = ""
    for file in files:
        with contextlib.suppress(OSError):
            profiles += Path(file).read_text(errors="replace")
    if TRANSPORTS in environment or "ransport" in profiles:
        return
    environment[TRANSPORTS] = "UDPv4"
    if not files:  # with LOCALHOST, ROS adds shared memory; with this profile it has no port
        environment[PROFILES[0]] = str(_UDP_ALONE)


def users_environment() -> dict[str, str]:
    """Return the environment without the profile that :func:`avoid_shared_memory` has set."""
    return {name: value for name, value in os.environ.items() if value != str(_UDP_ALONE)}


def simulated(arguments: Sequence[str]) -> bool:
    """Return True if ROS arguments, or a readable parameter file among them, set simulated time."""
    pairs = list(pairwise(arguments))
    assignments = [text.partition(":=") for flag, text in pairs if flag in ("-p", "--param")]
    values = [value for name, _, value in assignments if name.rpartition(":")[2].strip() == "use_sim_time"]
    if values:
        return values[-1].strip().lower() in _TRUE
    for file in (Path(text) for flag, text in pairs if flag == "--params-file"):
        with contextlib.suppress(OSError, ValueError):  # ROS reports the error
            if _SIMULATED.search(file.read_text()):
                return True
    return False


def costmaps_without(node: Any, topic: str) -> list[str]:
    """Return the costmaps of Nav2 that do not subscribe to the cloud on ``topic``.

    The list is empty if a simulated robot exists, because it replaces both costmaps.
    """
    names = {info.node_name for info in node.get_subscriptions_info_by_topic(node.resolve_topic_name(topic))}
    is_covered = SIMULATOR in names or _UNKNOWN_NAME in names  # an unknown name may be a frozen costmap
    return [] if is_covered else [name for name in COSTMAPS if name not in names]


def publishers(node: Any, topics: Iterable[str]) -> list[str]:
    """List the other nodes that publish any of these topics, such as ``/robot_15/motion_control (odom)``."""
    own = node.get_name(), node.get_namespace()
    end = time.monotonic() + _NAMES_S
    while True:
        names = {
            f"{full_name(*node_name)} ({topic})"
            for topic in topics
            for info in node.get_publishers_info_by_topic(node.resolve_topic_name(topic))
            if (node_name := (info.node_name, info.node_namespace)) != own
        }
        if time.monotonic() >= end or not any(NAMELESS in name for name in names):
            return sorted(names)
        time.sleep(0.05)  # names are discovered after endpoints


def full_name(name: str, namespace: str) -> str:
    """Return a node's name with its namespace, or a placeholder if ROS does not know the name."""
    is_named = name != _UNKNOWN_NAME and namespace != _UNKNOWN_NAMESPACE
    return f"{namespace.rstrip('/')}/{name}" if is_named else NAMELESS
