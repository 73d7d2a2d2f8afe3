"""Rounds of the robot's nodes beside the simulator's: ``python -m tests.system.campaign.robot_rounds``.

The nodes that ``pacman-env ros up --sim`` starts play over the simulated robot in lock-step
(``pacman_env.ros.lock_step``): games of one round each, from the menu over home back to the menu, as fast as the
machine can. The same seed gives the same rounds, however many jobs there are. The simulator plays rounds of its own:
the two share the rules and the configuration, not what is drawn, so shares are compared, not rounds. Needs ROS.
"""

from __future__ import annotations

import argparse
import math
import shutil
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from pacman_env import __version__
from pacman_env.cli.command import Parser, finite_number, run_command, whole_number
from pacman_env.config import Config, make_config, parse_settings
from pacman_env.episodes.rollout import episode_seeds, play
from pacman_env.episodes.statistics import wilson
from pacman_env.files import prepare, write_json
from pacman_env.game.execution import COMPLETE
from pacman_env.ros import topics
from pacman_env.ros.lock_step.deliveries import NodeFailed
from pacman_env.sim.maps.assets import map_assets
from tests.system.campaign.recorded_game import RecordedGame
from tests.system.campaign.statistics import difference
from tests.system.campaign.workers import errors, logged, pool, require_ros

#: A game's second round would be faster than its first; each game begins at Clyde's base speed.
ONE_ROUND = ("clyde.speed_step_mps=0.0",)
ROUNDS_TOGETHER = 10  # are played by the same nodes
ANSWER_S = 10.0  # simulated, as all below
GAME_S = 900.0  # a game that takes longer is an error of the nodes


@dataclass(frozen=True)
class Task:
    """Rounds that the same nodes play. Plain data: it travels to other processes."""

    policy: str
    clyde_speed_mps: float
    rounds: int
    seed: int
    map: str
    settings: tuple[str, ...]
    folder: str


@dataclass(frozen=True)
class RobotRound:
    policy: str
    clyde_speed_mps: float
    end: str  # complete, dead, timeout or not started
    collected: int
    time_s: float  # simulated, from the state running to the state after it


def play_task(task: Task) -> list[RobotRound]:
    """The rounds, one after the other.

    Raises:
        ValueError: a node has failed, or logged an error.
    """
    folder = Path(task.folder) / f"{task.policy.replace('/', '_')}-{task.clyde_speed_mps:g}-{task.seed}"
    folder.mkdir(parents=True)
    log = folder / "nodes.log"
    limit_s = _config(task.settings).time_limit_s
    try:
        with logged(log), RecordedGame(task.map, task.seed, folder, task.settings) as game:
            played = [play_round(game, task.policy, task.clyde_speed_mps, limit_s) for _ in range(task.rounds)]
    except NodeFailed as failed:
        raise ValueError(f"{failed}; log: {log}") from failed
    if found := errors(log.read_text(errors="replace")):
        raise ValueError(f"{found[0]}; log: {log}")
    return played


def _config(settings: Sequence[str], clyde_speed_mps: float = 0.25) -> Config:
    return make_config("robot", "robust", **parse_settings(settings)).with_fields(
        **{"clyde.speed_mps": clyde_speed_mps}
    )


def play_round(game: RecordedGame, policy: str, speed_mps: float, limit_s: float) -> RobotRound:
    """One game from the menu to the menu; a round that is not over after ``limit_s`` is broken off.

    Raises:
        NodeFailed: the nodes do not answer, end, or do not end the game.
    """
    recorder = game.recorder

    def wait(condition: Callable[[], object], for_s: float, what: str) -> None:
        if not game.until(condition, for_s):
            raise NodeFailed(f"no {what} within {for_s:g} s, state {recorder.state}: {recorder.condition}")
        if ends := game.tend():
            raise NodeFailed("; ".join(ends))

    recorder.forget()
    answer = game.do(lambda: recorder.set_policy(policy))
    wait(answer.done, ANSWER_S, "answer of the goal selector")
    (result,) = answer.result().results
    if not result.successful:
        raise NodeFailed(f"policy {policy} was refused: {result.reason}")
    game.do(lambda: recorder.set_base_speed(speed_mps))
    wait(
        lambda: math.isclose(recorder.last(topics.CLYDE_SPEED.name) or 0.0, speed_mps, abs_tol=1e-6),
        ANSWER_S,
        f"Clyde's speed of {speed_mps:g} m/s",
    )
    started = recorder.instant()
    answer = game.do(recorder.start)
    wait(answer.done, ANSWER_S, "answer to game/start")
    if not answer.result().success:
        raise NodeFailed(f"game/start was refused in the menu: {answer.result().message}")
    wait(lambda: recorder.state != "menu", ANSWER_S, "game")
    late = False

    def over() -> bool:
        nonlocal late
        if recorder.state == "running" and recorder.time_s - recorder.state_since_s > limit_s and not late:
            late = True
            game.do(recorder.reset)
        return recorder.state == "menu"

    wait(over, GAME_S + limit_s, "end of the game")
    recorded = [record for record in recorder.records if record.at >= started]
    states = [(r.at, r.value) for r in recorded if r.topic == topics.GAME_STATE.name]
    names = [name for _, name in states]
    running = names.index("running") if "running" in names else -1
    if running < 0:
        return RobotRound(policy, speed_mps, "not started", 0, 0.0)
    begin, end = states[running][0], states[running + 1][0]
    collected = max((r.value for r in recorded if r.topic == topics.PELLETS_COLLECTED.name), default=0)
    how = "timeout" if late else {"complete": "complete", "dying": "dead"}.get(names[running + 1], "not started")
    return RobotRound(policy, speed_mps, how, int(collected), round((end - begin) * 1e-9, 3))


def row(robot: Sequence[RobotRound], config: Config, source: str, policy: str, seed: int, episodes: int) -> dict:
    """Both sides of a policy at one of Clyde's speeds."""
    episode, _ = play(map_assets(source, config), config, policy, episode_seeds(seed, episodes))
    complete = episode["end"] == COMPLETE
    begun = [r for r in robot if r.end != "not started"]
    won = [r for r in begun if r.end == "complete"]
    least, most = wilson(int(complete.sum()), episodes)
    share = len(won) / max(len(begun), 1)
    return {
        "policy": policy,
        "clyde_speed_mps": config.clyde.speed_mps,
        "robot_rounds": len(begun),
        "robot_not_started": len(robot) - len(begun),
        "robot_complete": share,
        "robot_interval": wilson(len(won), len(begun)) if begun else (0.0, 1.0),
        "robot_collected": float(np.mean([r.collected for r in begun])) if begun else 0.0,
        "robot_round_s": float(np.median([r.time_s for r in won])) if won else math.nan,
        "simulator_rounds": episodes,
        "simulator_complete": float(complete.mean()),
        "simulator_interval": (least, most),
        "simulator_collected": float(episode["collected"].mean()),
        "simulator_round_s": float(np.median(episode["time_s"][complete])) if complete.any() else math.nan,
        "inside": least <= share <= most,
        "difference": difference(len(won), len(begun), int(complete.sum()), episodes) if begun else (0.0, (-1.0, 1.0)),
    }


def table(rows: Sequence[dict]) -> list[str]:
    head = "policy", "Clyde m/s", "robot %", "simulator %", "inside", "difference", "pellets", "a completed round, s"
    lines = [f"| {' | '.join(head)} |", "|---" * len(head) + "|"]
    for r in rows:

        def share(side: str, r: dict = r) -> str:
            least, most = r[f"{side}_interval"]
            return f"{100 * r[f'{side}_complete']:.1f} [{100 * least:.1f}, {100 * most:.1f}] of {r[f'{side}_rounds']}"

        by, (least, most) = r["difference"]
        lines.append(
            f"| `{r['policy']}` | {r['clyde_speed_mps']:g} | {share('robot')} | {share('simulator')} |"
            f" {'yes' if r['inside'] else 'no'} | {100 * by:+.1f} [{100 * least:+.1f}, {100 * most:+.1f}] |"
            f" {r['robot_collected']:.1f}, {r['simulator_collected']:.1f} |"
            f" {r['robot_round_s']:.0f}, {r['simulator_round_s']:.0f} |"
        )
    return lines


def _parts(rounds: int) -> list[int]:
    """How many rounds the same nodes play, in all so many."""
    return [min(ROUNDS_TOGETHER, rounds - k) for k in range(0, rounds, ROUNDS_TOGETHER)]


def _result(task: Task, rounds: Sequence[RobotRound]) -> str:
    won = sum(r.end == "complete" for r in rounds)
    return f"{task.policy}, Clyde at {task.clyde_speed_mps:g} m/s, seed {task.seed}: {won} of {len(rounds)} complete"


def run(arguments: argparse.Namespace) -> int:
    """Play, print, and write.

    Raises:
        ValueError: no ROS, a configuration or policy that there is not, nodes that failed, or figures that cannot be
            written.
    """
    require_ros()
    settings = (*ONE_ROUND, *arguments.set)
    config = _config(settings)
    assets = map_assets(arguments.map, config)
    if arguments.json:
        prepare(arguments.json)
    folder = arguments.logs or Path(tempfile.mkdtemp(prefix="robot_rounds_"))
    folder.mkdir(parents=True, exist_ok=True)
    map_yaml = str(assets.occupancy.save(folder / "map.yaml"))
    tasks = [
        Task(policy, speed_mps, rounds, arguments.seed + k, map_yaml, settings, str(folder))
        for policy in arguments.policies
        for speed_mps in arguments.clyde_speed
        for k, rounds in enumerate(_parts(arguments.rounds))
    ]
    began = time.monotonic()
    played: list[RobotRound] = []
    try:
        with pool(min(arguments.jobs, len(tasks))) as workers:
            for task, rounds in zip(tasks, workers.map(play_task, tasks), strict=True):
                played += rounds
                print(f"{len(played)} rounds: {_result(task, rounds)}", flush=True)
    except BrokenProcessPool as broken:
        raise ValueError(f"a process has ended; logs: {folder}") from broken
    print(f"{len(played)} rounds in {time.monotonic() - began:.0f} s")
    rows = []
    for policy in arguments.policies:
        for speed_mps in arguments.clyde_speed:
            own = [r for r in played if (r.policy, r.clyde_speed_mps) == (policy, speed_mps)]
            one = _config(settings, speed_mps)
            rows.append(row(own, one, arguments.map, policy, arguments.seed, arguments.episodes))
    print(*table(rows), sep="\n")
    if arguments.json:
        facts = {
            "version": __version__,
            "map": arguments.map,
            "map_hash": assets.occupancy.hash,
            "seed": arguments.seed,
        }
        facts |= {"configuration": config.hash, "settings": settings, "rows": rows}
        write_json(arguments.json, {**facts, "rounds": [asdict(r) for r in played]})
    if not arguments.logs:
        shutil.rmtree(folder)
    return 0


def main(argv: Sequence[str] | None = None) -> int:
    parser = Parser(prog="python -m tests.system.campaign.robot_rounds", description=__doc__)
    parser.add_argument("--map", default="house", help="name or YAML file")
    parser.add_argument("--policies", nargs="+", default=["ppo", "clyde_aware"], metavar="POLICY")
    parser.add_argument(
        "--clyde-speed",
        nargs="+",
        type=finite_number(0.01, 1),
        default=[0.25, 0.45],
        metavar="M/S",
        help="in each round",
    )
    parser.add_argument(
        "--rounds", type=whole_number(1), default=100, metavar="N", help="of the nodes, of each policy and speed"
    )
    parser.add_argument(
        "--episodes", type=whole_number(1), default=1000, metavar="N", help="of the simulator, likewise"
    )
    parser.add_argument("--seed", type=whole_number(0), default=0, metavar="S")
    parser.add_argument("--set", nargs="+", default=[], metavar="NAME=VALUE", help="configuration fields of both sides")
    parser.add_argument("--jobs", type=whole_number(1), default=1, metavar="N", help="processes, a core each")
    parser.add_argument("--logs", type=Path, metavar="FOLDER", help="kept there; else only after a failure")
    parser.add_argument("--json", type=Path, metavar="OUT", help="write the figures and every round")
    return run_command(parser, argv, run, "ros")


if __name__ == "__main__":
    sys.exit(main())
