"""What the game's nodes cost a computer: ``python -m eval.benchmarks.node_load``.

The whole game is started as ``pacman-env ros up --sim`` starts it, in real time, and watched while a round runs: time
on the processor and memory of every process, and the goal selector's own decision times, from the look at the pose to
the goal handed to the middleware. The simulated robot stands for base, lidar, AMCL and Nav2, and is counted apart.
"""

from __future__ import annotations

import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import psutil

from eval.command import status_of
from eval.compare.arguments import at_least
from eval.files import prepare, write_json
from pacman_env import __version__
from pacman_env.cli.main import Parser
from pacman_env.world.maps.occupancy import load_map

PATIENCE_S = 300.0  # the first start compiles
SELECTOR_CPU_PERCENT, SELECTOR_MB, DECISION_MS, SYSTEM_CPU_PERCENT = 5.0, 250.0, 20.0, 25.0  # what is promised


def measure(map_source: str, policy: str, seconds: float, domain: int, say: Callable[[str], None]) -> dict[str, Any]:
    """All figures of ``seconds`` of running rounds.

    Args:
        map_source: a YAML file or the name of a shipped map.
        policy: a name of the registry, or an .onnx file.
        seconds: how long the processes are watched.
        domain: ROS_DOMAIN_ID.
        say: told what is going on.

    Raises:
        ValueError: a map or policy that cannot be played.
        RuntimeError: a game that does not come to run.
        ModuleNotFoundError: rclpy is absent.
    """
    import rclpy
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.signals import SignalHandlerOptions

    from pacman_env.ros.supervisor.game_nodes import (
        GAME,
        REFEREE,
        SELECTOR,
        SIMULATOR,
        STOP_ORDER,
        Game,
        full_namespace,
    )
    from pacman_env.ros.supervisor.processes import Crew
    from pacman_env.ros.supervisor.status_line import Watcher
    from pacman_env.ros.supervisor.up import check, environment

    game = Game(map_source, policy, sim=True, extra={REFEREE: {"start_show_s": 0.0, "memory": ""}})
    check(game, domain)
    os.environ.update(environment(game, domain))
    context = rclpy.Context()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    watcher = Watcher(full_namespace(game.namespace), policy, True, context)
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(watcher)
    names = (SIMULATOR, *GAME, SELECTOR)
    with tempfile.TemporaryDirectory() as logs:
        crew = Crew(Path(logs), dict(os.environ), say)

        def wait(condition: Callable[[], Any], what: str) -> None:
            end = time.monotonic() + PATIENCE_S
            while not condition():
                crew.tend()
                executor.spin_once(timeout_sec=0.1)
                if time.monotonic() > end:
                    raise RuntimeError(f"waited {PATIENCE_S:g} s for {what}")

        try:
            for name in names:
                crew.start(name, game.arguments(name))
            wait(lambda: watcher.pose_age_s is not None, "a pose")
            wait(watcher.start_game, "the referee")
            wait(lambda: watcher.state == "running", "the round")
            wait(lambda: watcher.condition.get("decisions", {}).get("count"), "a decision")
            say(f"running, watched for {seconds:g} s")
            processes = {name: psutil.Process(number) for name, number in crew.processes().items()}
            before = {name: processes[name].cpu_times() for name in names}
            began = time.monotonic()
            wait(lambda: time.monotonic() - began >= seconds, "the end")
            lasted = time.monotonic() - began
            nodes = {}
            for name in names:
                after = processes[name].cpu_times()
                spent = after.user + after.system - before[name].user - before[name].system
                memory = processes[name].memory_info().rss / 1e6
                nodes[name] = {"cpu_percent": 100.0 * spent / lasted, "memory_mb": memory}
            decisions = watcher.condition.get("decisions", {})
        finally:
            crew.stop(STOP_ORDER)
            watcher.destroy_node()
            rclpy.shutdown(context=context)
    return {
        "map": game.map,
        "map_hash": load_map(map_source).hash,
        "policy": policy,
        "seconds": lasted,
        "nodes": nodes,
        "system_cpu_percent": sum(node["cpu_percent"] for name, node in nodes.items() if name != SIMULATOR),
        "decisions": decisions,
        "version": __version__,
    }


def report(figures: dict[str, Any]) -> str:
    """The figures as a table, with what is promised."""
    lines = [f"{'node':<20}  cpu % of a core  memory MB"]
    for name, node in figures["nodes"].items():
        lines.append(f"{name:<20}  {node['cpu_percent']:15.1f}  {node['memory_mb']:9.0f}")
    decisions = figures["decisions"]
    lines += [
        f"{'all but sim_robot':<20}  {figures['system_cpu_percent']:15.1f}  (promised: below {SYSTEM_CPU_PERCENT:g})",
        f"goal_selector: promised are less than {SELECTOR_CPU_PERCENT:g} % and {SELECTOR_MB:g} MB",
    ]
    if decisions.get("count"):
        lines.append(
            f"from pose to goal sent: median {decisions['median_ms']:.1f} ms, 99 % within {decisions['p99_ms']:.1f} ms"
            f" (promised: {DECISION_MS:g}), longest of {decisions['count']}: {decisions['longest_ms']:.1f} ms"
        )
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    """The command; returns the exit status: 0, or 2 after one line on stderr."""
    parser = Parser(prog="eval.benchmarks.node_load", description=__doc__)
    parser.add_argument("--map", default="house", metavar="FILE_OR_NAME")
    parser.add_argument("--policy", default="ppo", help="a name or an .onnx file")
    parser.add_argument("--seconds", type=at_least(1), default=60, metavar="S")
    parser.add_argument("--domain-id", type=at_least(1), default=77, metavar="N", help="ROS_DOMAIN_ID of the game")
    parser.add_argument("--json", type=Path, metavar="OUT", help="write the figures")
    arguments = parser.parse_args(argv)

    def work() -> None:
        if arguments.json:
            prepare(arguments.json)

        def say(text: str) -> None:
            print(text, file=sys.stderr)

        figures = measure(arguments.map, arguments.policy, arguments.seconds, arguments.domain_id, say)
        print(report(figures))
        if arguments.json:
            write_json(arguments.json, figures)

    return status_of(parser.prog, work)


if __name__ == "__main__":
    sys.exit(main())
