"""Randomised games of the robot's nodes with everything going wrong: ``python -m tests.system.campaign --games 300``.

The nodes that ``pacman-env ros up --sim`` starts play in lock-step (``pacman_env.ros.lock_step``); a recorder beside
them makes the simulated robot's faults begin and end, interferes from outside, freezes nodes, kills them, has their
packets lost, all at simulated moments, and judges each game (``verdict``). What happens in a game is drawn from its
seed (``schedule``). Ten consecutive seeds are played one after another by the same nodes on one arena. A game that is
repeated with ``--only`` is the same game, message for message: those before it of the same ten are played again, too.
Its transcript is a hash of all messages that a node has handled. Needs ROS.

A game hangs when nothing has been wrong for two minutes, no fault and no show, and there is no progress: neither
another state, nor a pellet, nor half a metre of motion, unless the planner waits for a Clyde that stands. One that is
not over 600 s after its last fault is broken off with ``game/reset``, which must lead to the menu. All times are
simulated.
"""

from __future__ import annotations

import argparse
import itertools
import shutil
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures.process import BrokenProcessPool
from dataclasses import asdict
from pathlib import Path

from pacman_env.cli.command import Parser, run_command, whole_number
from pacman_env.files import prepare, write_json
from pacman_env.ros.supervisor.game_nodes import SELECTOR, SIMULATOR, GameSetup
from pacman_env.ros.supervisor.preparation import GHOSTS, Part
from pacman_env.ros.supervisor.warm_up import rehearse
from tests.system.campaign.results import Verdict, blocks, table
from tests.system.campaign.schedule import POLICIES
from tests.system.campaign.workers import pool, require_ros

VIOLATED = 1  # exit status


def run(arguments: argparse.Namespace) -> int:
    """Play, print, and write; the exit status.

    Raises:
        ValueError: no ROS, the figures cannot be written, or a process has ended.
    """
    require_ros()
    from tests.system.campaign.games import play  # imports ROS

    seeds = sorted(set(arguments.only or range(arguments.seed, arguments.seed + arguments.games)))
    folder = arguments.logs or Path(tempfile.mkdtemp(prefix="campaign_"))
    began = time.monotonic()
    if arguments.json:
        prepare(arguments.json)
    print(f"{'seed':>5} {'arena':14} {'policy':11} {'outcome':11} {'robot':>6} {'transcript':10} faults, interferences")
    parts = list(blocks(seeds))
    for part in (Part((GHOSTS, SIMULATOR)), *(Part((SELECTOR,), policy) for policy in POLICIES)):
        rehearse(part, GameSetup("house"))  # compiled once, not by each job
    verdicts: list[Verdict] = []
    try:
        with pool(min(arguments.jobs, len(parts))) as workers:
            for played in workers.map(play, parts, itertools.repeat(folder)):
                for verdict in played:
                    print(
                        verdict.line(),
                        *(f"      VIOLATION {line}" for line in verdict.violations),
                        sep="\n",
                        flush=True,
                    )
                verdicts += played
    except BrokenProcessPool as broken:
        raise ValueError(f"a process has ended; logs: {folder}") from broken
    print(*table(verdicts), sep="\n")
    wrong = [v for v in verdicts if v.violations]
    for verdict in wrong:
        print(*(f"seed {verdict.seed}: {line}" for line in verdict.violations), sep="\n")
        print(f"repeat: python -m tests.system.campaign --only {verdict.seed}")
    print(f"{len(verdicts)} games in {time.monotonic() - began:.0f} s, {len(wrong)} with violations")
    if wrong:
        print(f"logs: {folder}")
    elif not arguments.logs:
        shutil.rmtree(folder)
    if arguments.json:
        write_json(arguments.json, {"seeds": seeds, "games": [asdict(v) for v in verdicts]})
    return VIOLATED if wrong else 0


def main(argv: Sequence[str] | None = None) -> int:
    """Play; returns the exit status: 1 after violations."""
    parser = Parser(prog="python -m tests.system.campaign", description=__doc__)
    parser.add_argument("--games", type=whole_number(1), default=300, metavar="N")
    parser.add_argument("--seed", type=whole_number(0), default=0, metavar="S", help="of the first game")
    parser.add_argument("--only", type=whole_number(0), nargs="+", metavar="SEED", help="just these")
    parser.add_argument("--jobs", type=whole_number(1), default=1, metavar="N", help="processes, a core each")
    parser.add_argument("--logs", type=Path, metavar="FOLDER", help="kept there; else only after violations")
    parser.add_argument("--json", type=Path, metavar="OUT", help="write the verdicts")
    return run_command(parser, argv, run, "ros")


if __name__ == "__main__":
    sys.exit(main())
