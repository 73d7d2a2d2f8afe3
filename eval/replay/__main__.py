"""One round again, every policy side by side: ``python -m eval.replay SEED`` and the comparison's arguments.

Writes a film, or a page with the film in it, and tells what happened and when each policy changed its goal.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from eval.command import status_of
from eval.compare.arguments import add_game_arguments, at_least, game_configs
from eval.compare.policies import add_policy_arguments, check_contestants, contestant_names
from eval.compare.scenarios import open_place, place_name, places
from eval.files import prepare, replaced
from eval.replay.page import page
from eval.replay.recording import Watched, film
from eval.replay.video import save_video
from pacman_env.cli.main import Parser

_SUFFIXES = (".mp4", ".gif", ".html")
_HEIGHT = 480  # px


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="eval.replay",
        description="Play one round of a comparison again with each policy and film it. Give the same arguments as"
        " there: map or levels, Clyde's speed, and whatever else the game was changed by.",
    )
    parser.add_argument(
        "seed", type=at_least(0, 2**64 - 1), metavar="SEED", help="of the round, as in 'seeds' of the comparison's JSON"
    )
    add_policy_arguments(parser, ("clyde_aware", "nearest"), "from left to right")
    add_game_arguments(parser, several=False)
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help=f"one of {', '.join(_SUFFIXES)} (results/replay-SEED.mp4)"
    )
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status: 0, or 2 after one line on stderr.

    Raises:
        SystemExit: after ``--help`` and bad arguments, as argparse does.
    """
    parser = _parser()
    arguments = parser.parse_args(argv)
    return status_of(parser.prog, lambda: _replay(arguments))


def _replay(arguments: argparse.Namespace) -> None:
    config = game_configs(arguments)[0]
    policies = list(dict.fromkeys(arguments.policies))
    check_contestants(policies, arguments.trust)
    wanted = places(arguments)
    if len(wanted) > 1:
        raise ValueError("--levels: not beside --map, a round is played on one of them")
    source = open_place(wanted[0], config)
    out = arguments.out or Path(f"results/replay-{arguments.seed}.mp4")
    if out.suffix not in _SUFFIXES:
        raise ValueError(f"--out {out}: must end in one of {', '.join(_SUFFIXES)}")
    prepare(out)
    games = [
        Watched(source, config, spec, np.uint64(arguments.seed), name, arguments.trust)
        for spec, name in contestant_names(policies).items()
    ]
    level = f", level {games[0].level}" if arguments.levels else ""
    speed = f"Clyde at {config.clyde.speed_mps:g} m/s"
    title = f"Round {arguments.seed} on {place_name(wanted[0], config)}{level}, {speed}"
    _write(out, games, title, config.execution.tick_s)
    print(title)
    for game in games:
        print(f"\n{game.name}: {game.outcome()}")
        for change in game.changes:
            print(f"  {change.when:>8}  {change.goal}: {change.why}")
    print(f"\nwritten: {out}")


def _write(out: Path, games: Sequence[Watched], title: str, tick_s: float) -> None:
    """Play the games to their end, filming them."""
    frames = film(games, _HEIGHT)
    if out.suffix != ".html":
        save_video(frames, out, tick_s)
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        save_video(frames, path, tick_s)
        text = page(title, path.read_bytes(), games)
    with replaced(out) as temporary:
        temporary.write_text(text)


if __name__ == "__main__":
    sys.exit(main())
