"""The load of the game's nodes on a computer: ``python -m benchmarks.node_load``.

The whole game is started as ``pacman-env ros up --sim`` starts it, in real time, and watched while a round runs: time
on the processor and memory of every process, and the goal selector's own decision times, from reading the pose to
handing the goal to the middleware. The simulated robot stands for base, lidar, AMCL and Nav2, and is counted apart.
"""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil

from benchmarks.harness import benchmark, count, log
from pacman_env.world.maps.occupancy import load_map

PATIENCE_S = 300.0  # the first start compiles
#: Promised of the goal selector, of a decision, of all nodes together, and of those that only pass messages on.
SELECTOR_CPU_PERCENT, SELECTOR_MB, DECISION_MS, SYSTEM_CPU_PERCENT, LIGHT_MB = 5.0, 250.0, 20.0, 25.0, 75.0
LIGHT_NODES = ("pellet_manager", "audio_node", "game_light_node", "game_event_mapper", "game_controller")


def measure(map_source: str, policy: str, seconds: float, domain: int, composed: bool) -> dict[str, Any]:
    """All figures of ``seconds`` of running rounds; RuntimeError for a game that does not come to run."""
    from pacman_env.ros.discovery import join
    from pacman_env.ros.supervisor.game_nodes import MOVERS, REFEREE, SELECTOR, SIMULATOR, WAIT, GameSetup
    from pacman_env.ros.supervisor.operator import StatusLine
    from pacman_env.ros.supervisor.processes import ProcessGroup
    from pacman_env.ros.supervisor.up import check
    from pacman_env.ros.topics import START_GAME

    extra: dict[str, Any] = {REFEREE: {"state_file": ""}}
    setup = GameSetup(map_source, policy, sim=True, settings=("show.start_s=0",), extra=extra, composed=composed)
    check(setup)
    join(domain, setup.sim)
    status_line = StatusLine(setup.namespace, setup.sim, setup.policy)
    names = (*(name for name in setup.first_processes if name != WAIT), SELECTOR)
    with tempfile.TemporaryDirectory() as logs:
        processes = ProcessGroup(setup.command, Path(logs), dict(os.environ), log)

        def wait(condition: Callable[[], Any], what: str) -> None:
            end = time.monotonic() + PATIENCE_S
            while not condition():
                processes.tend()
                status_line.spin(0.1)
                if time.monotonic() > end:
                    raise RuntimeError(f"waited {PATIENCE_S:g} s for {what}")

        try:
            for name in names:
                processes.start(name)
            wait(lambda: status_line.pose_age_s is not None, "a pose")
            wait(lambda: status_line.ready and status_line.request(START_GAME), "the referee")
            wait(lambda: status_line.state == "running", "the round")
            wait(lambda: status_line.condition.get("decisions", {}).get("count"), "a decision")
            log(f"running, watched for {seconds:g} s")
            found = {name: psutil.Process(number) for name, number in processes.ids().items()}
            before = {name: found[name].cpu_times() for name in names}
            began = time.monotonic()
            wait(lambda: time.monotonic() - began >= seconds, "the end")
            lasted = time.monotonic() - began
            nodes = {}
            for name in names:
                after = found[name].cpu_times()
                spent = after.user + after.system - before[name].user - before[name].system
                memory = found[name].memory_full_info()
                used = {"memory_mb": memory.rss / 1e6, "shared_out_mb": memory.pss / 1e6}
                nodes[name] = {"cpu_percent": 100.0 * spent / lasted, **used}
            decisions = status_line.condition.get("decisions", {})
        finally:
            processes.stop(MOVERS, (SIMULATOR,))
            status_line.close()
    return {
        "map": setup.map,
        "map_hash": load_map(map_source).hash,
        "policy": policy,
        "seconds": lasted,
        "nodes": nodes,
        "system": {key: sum(nodes[name][key] for name in names if name != SIMULATOR) for key in nodes[SELECTOR]},
        "decisions": decisions,
    }


def run(arguments: argparse.Namespace) -> dict[str, Any]:
    figures = measure(arguments.map, arguments.policy, arguments.seconds, arguments.domain_id, arguments.composed)
    print(f"{'process':<20}  cpu % of a core  memory MB  its share of shared pages counted MB")
    for name, node in {**figures["nodes"], "all but sim_robot": figures["system"]}.items():
        print(f"{name:<20}  {node['cpu_percent']:15.1f}  {node['memory_mb']:9.0f}  {node['shared_out_mb']:9.0f}")
    print(f"all but sim_robot: promised are less than {SYSTEM_CPU_PERCENT:g} %")
    if not arguments.composed:
        print(f"{', '.join(LIGHT_NODES)}: promised are at most {LIGHT_MB:g} MB each")
    print(f"goal_selector: promised are less than {SELECTOR_CPU_PERCENT:g} % and {SELECTOR_MB:g} MB")
    if (decisions := figures["decisions"]).get("count"):
        text = "from pose to goal sent: median {median_ms:.1f} ms, 99 % within {p99_ms:.1f} ms"
        print(text.format(**decisions), end="")
        print(f" (promised: {DECISION_MS:g}), longest of {decisions['count']}: {decisions['longest_ms']:.1f} ms")
    return figures


_COMPOSED = ("--composed", {"action": "store_true", "help": "as ros up --composed"})
main = benchmark("node_load", __doc__, run, "--policy", "--domain-id", count("--seconds", 60), _COMPOSED, extra="ros")

if __name__ == "__main__":
    sys.exit(main())
