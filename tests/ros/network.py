"""Two machines on one cable, as far as the network goes: namespaces of this machine's own kernel. Needs root."""

from __future__ import annotations

import contextlib
import os
import shutil
import subprocess
from collections.abc import Iterator

from tests.ros.system import free_domain


def why_not() -> str:
    """Why there can be no namespaces here; empty: there can."""
    if shutil.which("ip") is None:
        return "no command ip (Debian's package iproute2)"
    tried = subprocess.run(["unshare", "-n", "true"], check=False, capture_output=True, text=True)
    return tried.stderr.strip() if tried.returncode else ""


@contextlib.contextmanager
def two_machines() -> Iterator[tuple[str, str]]:
    """Names of two namespaces, with the addresses 10.77.0.1 and 10.77.0.2."""
    with free_domain() as number:
        names = f"pacman{number}a", f"pacman{number}b"
        try:
            for name in names:
                _ip("netns", "add", name)
            _ip("link", "add", "cable", "netns", names[0], "type", "veth", "peer", "name", "cable", "netns", names[1])
            for last, name in enumerate(names, 1):
                _ip("-n", name, "addr", "add", f"10.77.0.{last}/24", "dev", "cable")
                for device in ("lo", "cable"):
                    _ip("-n", name, "link", "set", device, "up")
                _ip("-n", name, "route", "add", "224.0.0.0/4", "dev", "cable")
            yield names
        finally:
            for name in names:
                subprocess.run(["ip", "netns", "delete", name], check=False, capture_output=True)


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True)


def on_the_network() -> dict[str, str]:
    """The environment of a process that meets whoever is on the network."""
    kept = {name: value for name, value in os.environ.items() if name != "FASTRTPS_DEFAULT_PROFILES_FILE"}
    # No shared memory: it is this machine's, and would go around the cable.
    return kept | {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET", "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4"}
