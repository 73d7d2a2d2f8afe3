"""How long a game takes to start and to stop: ``python -m benchmarks.start_stop``, also beside another checkout.

``pacman-env ros up --sim --start`` runs as a process of its own, without a start show: first with an empty cache, as on
a new machine, then with the cache that it has left. Watched from outside: the first line that it prints, the menu, the
robot's first motion, and the time from Ctrl-C to its end.
"""

import argparse
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from benchmarks.harness import ROOT, Option, benchmark, in_checkout

PATIENCE_S = 600.0
DRIVES_MPS = 0.05
COLUMNS = ("first line", "menu", "drives", "stop")


def measure(root: Path, cache: Path, map_source: str, policy: str, domain: int) -> dict[str, float]:
    """Seconds from the command to each of the moments, and from Ctrl-C to the end; ValueError if it does not drive."""
    from pacman_env.ros.discovery import join
    from pacman_env.ros.supervisor.operator import StatusLine
    from pacman_env.ros.topics import ODOMETRY

    join(domain, this_machine=True)
    status_line = StatusLine("robot_15", sim=False)
    moments: dict[str, float] = {}
    began = time.monotonic()

    def note(name: str) -> None:
        moments.setdefault(name, time.monotonic() - began)

    def on_odometry(message: Any) -> None:
        if abs(message.twist.twist.linear.x) > DRIVES_MPS:
            note("drives")

    ODOMETRY.subscription(status_line, on_odometry)
    with tempfile.TemporaryDirectory() as logs:
        options = ["--map", map_source, "--policy", policy, "--sim", "--start", "--set", "show.start_s=0"]
        options += ["--logs", logs, "--domain-id", str(domain)]
        game = in_checkout(root, "-m", "pacman_env.cli.main", "ros", "up", *options, PACMAN_ENV_CACHE=str(cache))
        with subprocess.Popen(**game, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as process:
            output: list[str] = []
            reader = threading.Thread(target=_read, args=(process, output, lambda: note("first line")), daemon=True)
            reader.start()
            try:
                while "drives" not in moments:
                    status_line.spin(0.05)
                    if status_line.state is not None:
                        note("menu")
                    if process.poll() is not None or time.monotonic() - began > PATIENCE_S:
                        raise ValueError(f"the game of {root} does not drive: {' '.join(output[-3:])}")
                stopped = time.monotonic()
                process.send_signal(signal.SIGINT)
                process.wait(PATIENCE_S)
                moments["stop"] = time.monotonic() - stopped
            finally:
                if process.poll() is None:
                    process.kill()
                reader.join()
                status_line.close()
    return moments


def _read(process: subprocess.Popen[str], output: list[str], on_line: Callable[[], None]) -> None:
    assert process.stdout is not None
    for line in process.stdout:
        on_line()
        output.append(line.strip())


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    roots = {"this": ROOT} | ({"before": arguments.before} if arguments.before else {})
    rows: list[dict[str, Any]] = []
    print(f"{'checkout':<9} {'cache':<6}" + "".join(f" {name:>11}" for name in COLUMNS) + "   s")
    with tempfile.TemporaryDirectory() as folder:
        for cache in ("cold", "warm"):
            for name, root in roots.items():
                place = Path(folder) / name
                moments = measure(root, place, arguments.map, arguments.policy, arguments.domain_id)
                rows.append({"checkout": name, "cache": cache, **moments})
                print(f"{name:<9} {cache:<6}" + "".join(f" {moments[column]:11.1f}" for column in COLUMNS), flush=True)
    return {"policy": arguments.policy, "rows": rows}


BEFORE: Option = ("before", {"nargs": "?", "type": Path, "metavar": "CHECKOUT", "help": "also measure this version"})
main = benchmark("start_stop", __doc__, run, "--policy", "--domain-id", BEFORE, extra="ros")

if __name__ == "__main__":
    sys.exit(main())
