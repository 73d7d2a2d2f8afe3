"""A network of a process's own, and the loss of packets on it: a namespace of the kernel, and its packet filter.

Linux as root, with ``nft`` (Debian's package nftables); the kernel needs no netem. Who is who is told by UDP ports, so
everybody has to speak UDP: shared memory goes around every network.
"""

from __future__ import annotations

import contextlib
import ctypes
import fcntl
import os
import shutil
import socket
import struct
import subprocess
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from pathlib import Path

_CLONE_NEWNET = 0x40000000  # linux/sched.h
_SIOCGIFFLAGS, _SIOCSIFFLAGS, _IFF_UP = 0x8913, 0x8914, 0x1  # linux/sockios.h, linux/if.h
_TABLE = "campaign"


@dataclass(frozen=True)
class Loss:
    """A share of the packets that go to or come from these ports; None: of all packets."""

    ports: frozenset[int] | None
    percent: int


def why_not() -> str:
    """What is missing here for a network with losses; empty: nothing."""
    for command, package in (("unshare", "util-linux"), ("nft", "nftables")):
        if shutil.which(command) is None:
            return f"no command {command} (Debian's package {package})"
    some = rules([Loss(frozenset({7400}), 30), Loss(None, 30)], {7401})
    tried = subprocess.run(["unshare", "-n", "nft", "-f", "-"], input=some, check=False, capture_output=True, text=True)
    return (tried.stderr.strip().splitlines() or ["nft failed"])[0] if tried.returncode else ""


def enter_own_network() -> None:
    """Leave the machine's network for one that has nothing but the loopback; so does every process started then.

    Raises:
        OSError: that is not permitted.
    """
    if ctypes.CDLL(None, use_errno=True).unshare(_CLONE_NEWNET) != 0:
        error = ctypes.get_errno()
        raise OSError(error, f"no network namespace: {os.strerror(error)}")
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as any_socket:
        request = struct.pack("16sh14x", b"lo", 0)
        (flags,) = struct.unpack_from("h", fcntl.ioctl(any_socket, _SIOCGIFFLAGS, request), 16)
        fcntl.ioctl(any_socket, _SIOCSIFFLAGS, struct.pack("16sh14x", b"lo", flags | _IFF_UP))


def ports_of(process: int, proc: Path = Path("/proc")) -> frozenset[int]:
    """The UDP ports that a process receives on or sends from; none of one that has gone."""
    inodes, ports = set(), set()
    with contextlib.suppress(OSError):
        for descriptor in (proc / str(process) / "fd").iterdir():
            with contextlib.suppress(OSError):  # closed meanwhile
                target = os.readlink(descriptor)
                if target.startswith("socket:["):
                    inodes.add(target[len("socket:[") : -1])
        for line in (proc / str(process) / "net" / "udp").read_text().splitlines()[1:]:
            fields = line.split()
            if fields[9] in inodes:
                ports.add(int(fields[1].rpartition(":")[2], 16))
    return frozenset(ports)


def rules(losses: Sequence[Loss], spared: Collection[int]) -> str:
    """What ``nft -f -`` takes: these losses in place of those before.

    Args:
        losses: what is lost.
        spared: ports from and to which every packet arrives.
    """
    lines = ["meta l4proto != udp accept"]
    if spared:
        lines += [f"udp {side} {_set(spared)} accept" for side in ("sport", "dport")]
    for loss in losses:
        drop = "drop" if loss.percent == 100 else f"numgen random mod 100 < {loss.percent} drop"
        if loss.ports is None:
            lines.append(drop)
        elif loss.ports:
            lines += [f"udp {side} {_set(loss.ports)} {drop}" for side in ("sport", "dport")]
    # At the input, where a packet vanishes: at the output its sender would get an error.
    chain = "\n".join(["type filter hook input priority 0; policy accept;", *lines])
    return f"table inet {_TABLE}\ndelete table inet {_TABLE}\ntable inet {_TABLE} {{\nchain loss {{\n{chain}\n}}\n}}\n"


def apply(losses: Sequence[Loss], spared: Collection[int]) -> None:
    """Lose that from now on, in the network of this process.

    Raises:
        OSError: nft has failed.
    """
    done = subprocess.run(["nft", "-f", "-"], input=rules(losses, spared), check=False, capture_output=True, text=True)
    if done.returncode:
        raise OSError(f"nft: {done.stderr.strip()}")


def _set(ports: Collection[int]) -> str:
    return "{ " + ", ".join(map(str, sorted(ports))) + " }"
