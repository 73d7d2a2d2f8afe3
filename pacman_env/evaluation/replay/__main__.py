"""One round again, every policy side by side: ``pacman-env replay SEED`` and the comparison's arguments.

Writes a film, or a page with the film in it, and prints what happened and when each policy changed its goal.
"""

from __future__ import annotations

import argparse
import base64
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pacman_env.cli.command import Parser, run_command, whole_number
from pacman_env.evaluation.compare.arguments import add_game_arguments, game_configs
from pacman_env.evaluation.compare.policies import add_policy_arguments, named_policies
from pacman_env.evaluation.compare.scenarios import open_scenario, scenario_name, scenarios
from pacman_env.evaluation.replay.recording import RecordedGame, film, save_video
from pacman_env.evaluation.templates import render
from pacman_env.files import prepare, replaced

_SUFFIXES = (".mp4", ".gif", ".html")
_HEIGHT = 480  # px


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="pacman-env replay",
        description="Play one round of a comparison again with each policy and film it. Give the same arguments as"
        " there: map or levels, Clyde's speed, and whatever else the game was changed by.",
    )
    parser.add_argument(
        "seed",
        type=whole_number(0, 2**64 - 1),
        metavar="SEED",
        help="of the round, as in 'seeds' of the comparison's JSON",
    )
    add_policy_arguments(parser, ("clyde_aware", "nearest"), "from left to right")
    add_game_arguments(parser, several=False)
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help=f"one of {', '.join(_SUFFIXES)} (results/replay-SEED.mp4)"
    )
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(_parser(), argv, _replay)


def _replay(arguments: argparse.Namespace) -> None:
    config = game_configs(arguments)[0]
    policies = named_policies(arguments.policies)
    wanted = scenarios(arguments)
    if len(wanted) > 1:
        raise ValueError("--levels: not beside --map, a round is played on one of them")
    source = open_scenario(wanted[0], config)
    out = arguments.out or Path(f"results/replay-{arguments.seed}.mp4")
    if out.suffix not in _SUFFIXES:
        raise ValueError(f"--out {out}: must end in one of {', '.join(_SUFFIXES)}")
    prepare(out)
    games = [RecordedGame(source, config, spec, np.uint64(arguments.seed), name) for spec, name in policies.items()]
    level = f", level {games[0].level}" if arguments.levels else ""
    speed = f"Clyde at {config.clyde.speed_mps:g} m/s"
    title = f"Round {arguments.seed} on {scenario_name(wanted[0], config)}{level}, {speed}"
    _write(out, games, title, config.execution.tick_s)
    print(title)
    for game in games:
        print(f"\n{game.name}: {game.outcome()}")
        for change in game.changes:
            print(f"  {change.when:>8}  {change.goal}: {change.why}")
    print(f"\nwritten: {out}")


def _write(out: Path, games: Sequence[RecordedGame], title: str, tick_s: float) -> None:
    """Play the games to their end, filming them."""
    frames = film(games, _HEIGHT)
    if out.suffix != ".html":
        save_video(frames, out, tick_s)
        return
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "film.mp4"
        save_video(frames, path, tick_s)
        video = base64.b64encode(path.read_bytes()).decode()
    text = render("replay.html.j2", title=title, video=video, games=games)
    with replaced(out) as temporary:
        temporary.write_text(text)


if __name__ == "__main__":
    sys.exit(main())
