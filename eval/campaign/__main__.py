"""Randomised games of the robot's nodes with everything going wrong: ``pacman-env campaign --games 200``.

The nodes that ``pacman-env ros up --sim`` starts run as processes; a recorder beside them makes the simulated robot's
faults begin and end, interferes from outside, freezes nodes, kills them, has their packets lost, and judges each game
(``verdict``). What happens in a game is drawn from its seed (``schedule``); when exactly the processes hear of it is
the machine's business, so a game that is repeated with ``--only`` need not go the same way. Needs ROS, and for the loss
of packets Linux, root and nft: the games are played on a network of their own.

Outages last 1 to 60 s, in wall time divided by ``--speed``, and so do the middleware's lease of 20 s, its announcements
and its heartbeats: at ten times speed a node that is frozen for 30 s stands still for 3 s, 30 s of the robot's, and is
taken for gone after 2 s. What the nodes themselves do in wall time (repeats and calls every 2 s) is as it is.

A game hangs when nothing has been wrong for two minutes, no fault and no show, and there is no progress: neither
another state, nor a pellet, nor half a metre of motion, unless the planner waits for a Clyde who stands. One that is
not over 600 s after its last fault is broken off with ``game/reset``, which must lead to the menu.
"""

from __future__ import annotations

import argparse
import itertools
import multiprocessing
import shutil
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict
from pathlib import Path

from pacman_env.cli.command import Parser, finite_number, run_command, whole_number
from pacman_env.config import make_config
from pacman_env.files import prepare, write_json
from pacman_env.ros.simulated_robot.sim_faults import FAULTS
from pacman_env.ros.supervisor.child import end_with_parent
from pacman_env.ros.supervisor.game_nodes import SELECTOR, SIMULATOR
from pacman_env.ros.supervisor.warm_up import GHOSTS, Part, rehearse

from . import network
from .games import NETWORK, Verdict, blocks, play
from .schedule import EVERY_NODE, INTERFERENCES, LOSS, NODES, OUTAGES, schedule
from .system import FIRST_POLICY, first_domain, require_ros

VIOLATED = 1  # exit status
_WIDTH = 34  # of the names in the table
OUTCOMES = ("complete", "lost", "reset", "home failed", "never")


def table(verdicts: Sequence[Verdict]) -> list[str]:
    """Games by fault kind, as lines."""
    head = f"{'':{_WIDTH}} {'games':>6}" + "".join(f" {name:>11}" for name in OUTCOMES) + f" {'violations':>10}"
    rows = {"all games": list(verdicts), "nothing": [v for v in verdicts if not v.happened]}
    rows |= {kind: [v for v in verdicts if kind in v.happened] for kind in (*FAULTS, *INTERFERENCES, *OUTAGES)}
    rows |= {
        f"{kind} of {node}": [v for v in verdicts if any(one[:2] == (kind, node) for one in v.outages)]
        for kind, node in itertools.product(OUTAGES, (*NODES, EVERY_NODE))
        if kind == LOSS or node != EVERY_NODE
    }
    several = [v for v in verdicts if len(set(v.happened) & FAULTS.keys()) > 1]
    rows |= {"several faults": several}
    lines = [head]
    for name, games in rows.items():
        ends = "".join(f" {sum(v.outcome == how for v in games):11d}" for how in OUTCOMES)
        lines.append(f"{name:{_WIDTH}} {len(games):6d}{ends} {sum(len(v.violations) for v in games):10d}")
    return lines


def run(arguments: argparse.Namespace) -> int:
    """Play, tell, and write; the exit status.

    Raises:
        ValueError: no ROS, or the figures cannot be written.
    """
    require_ros()
    if NETWORK not in arguments.without and (reason := network.why_not()):
        raise ValueError(f"no network with losses: {reason}; --without {NETWORK} plays without them")
    seeds = arguments.only or list(range(arguments.seed, arguments.seed + arguments.games))
    folder = arguments.logs or Path(tempfile.mkdtemp(prefix="campaign_"))
    began = time.monotonic()
    if arguments.json:
        prepare(arguments.json)
    head = f"{'seed':>5} {'ground':14} {'policy':11} {'outcome':11} {'robot':>6} {'wall':>5} {'lag':>5}"
    print(f"{head} faults, interferences")
    shares = [[s for b in list(blocks(seeds))[k :: arguments.jobs] for s in b] for k in range(arguments.jobs)]
    policies = dict.fromkeys([FIRST_POLICY, *(schedule(seed).policy for seed in seeds)])
    for part in (Part((GHOSTS, SIMULATOR)), *(Part((SELECTOR,), policy) for policy in policies)):
        rehearse(part, "house", make_config("robot"))  # a planner that compiles while it plays delays all others
    first = first_domain() if arguments.domain is None else arguments.domain
    tasks = [(share, arguments.speed, folder, first + k, arguments.without) for k, share in enumerate(shares) if share]
    with ProcessPoolExecutor(len(tasks), multiprocessing.get_context("spawn"), end_with_parent) as pool:
        futures = [pool.submit(play, *task) for task in tasks]
        verdicts = sorted((v for future in futures for v in future.result()), key=lambda v: v.seed)
    print(*table(verdicts), sep="\n")
    wrong = [v for v in verdicts if v.violations]
    for verdict in wrong:
        print(*(f"seed {verdict.seed}: {line}" for line in verdict.violations), sep="\n")
        print(f"repeat: pacman-env campaign --only {verdict.seed}")
    print(f"{len(verdicts)} games in {time.monotonic() - began:.0f} s, {len(wrong)} with violations")
    if wrong:
        print(f"logs: {folder}")
    elif not arguments.logs:
        shutil.rmtree(folder)
    if arguments.json:
        write_json(arguments.json, {"seeds": seeds, "speed": arguments.speed, "games": [asdict(v) for v in verdicts]})
    return VIOLATED if wrong else 0


def main(argv: Sequence[str] | None = None) -> int:
    """Play; returns the exit status: 1 after violations."""
    parser = Parser(prog="pacman-env campaign", description=__doc__)
    parser.add_argument("--games", type=whole_number(1), default=200, metavar="N")
    parser.add_argument("--seed", type=whole_number(0), default=0, metavar="S", help="of the first game")
    parser.add_argument("--only", type=whole_number(0), nargs="+", metavar="SEED", help="just these")
    parser.add_argument(
        "--speed", type=finite_number(1, 10), default=10.0, metavar="X", help="of the simulated clock, 1 to 10"
    )
    parser.add_argument(
        "--jobs", type=whole_number(1), default=1, metavar="N", help="systems at once, about a core each"
    )
    parser.add_argument(
        "--without", nargs="+", choices=[NETWORK], default=[], help="kinds of trouble that need what is missing here"
    )
    parser.add_argument("--domain", type=whole_number(0, 101), metavar="ID", help="ROS_DOMAIN_ID, of the first system")
    parser.add_argument("--logs", type=Path, metavar="FOLDER", help="kept there; else only after violations")
    parser.add_argument("--json", type=Path, metavar="OUT", help="write the verdicts")
    return run_command(parser, argv, run, "ros")


if __name__ == "__main__":
    sys.exit(main())
