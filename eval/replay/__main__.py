"""One round again, every policy side by side: ``pacman-env replay SEED`` and the comparison's arguments.

Writes a film, or a page with the film in it, and tells what happened and when each policy changed its goal.
"""

from __future__ import annotations

import argparse
import base64
import sys
import tempfile
from collections.abc import Sequence
from html import escape
from pathlib import Path

import numpy as np

from pacman_env.cli.command import Parser, run_command, whole_number
from pacman_env.files import prepare, replaced

from ..compare.arguments import add_game_arguments, game_configs
from ..compare.policies import add_policy_arguments, named_policies
from ..compare.scenarios import open_scenario, scenario_name, scenarios
from .recording import RecordedGame, film, save_video

_SUFFIXES = (".mp4", ".gif", ".html")
_HEIGHT = 480  # px
_STYLE = """
:root { color-scheme: light dark; font: 16px/1.5 system-ui, sans-serif }
body { margin: 2rem auto; max-width: 80rem; padding: 0 1rem }
video { width: 100%; background: #1b1f2b }
h1 { font-size: 1.3rem } h2 { font-size: 1.1rem; margin-top: 2rem }
.scroll { overflow-x: auto }
table { border-collapse: collapse; font-size: .9rem }
th, td { border-bottom: 1px solid #8886; padding: .2rem .8rem .2rem 0; text-align: left; vertical-align: top }
td:first-child { white-space: nowrap; text-align: right; font-variant-numeric: tabular-nums }
td:nth-child(2) { white-space: nowrap }
"""
_EXPLANATION = (
    "Each line below is a decision to go somewhere else, with the policy's own explanation: a higher score is better;"
    " what follows it are the terms that it is made of. Pellets and refuges are counted from 0."
)


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
    """Record the round; returns the exit status."""
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
        text = page(title, path.read_bytes(), games)
    with replaced(out) as temporary:
        temporary.write_text(text)


def page(title: str, video: bytes, games: Sequence[RecordedGame]) -> str:
    """The film, an MP4, and the decisions of the games in it, played to their end; it needs nothing beside it."""
    data = base64.b64encode(video).decode()
    parts = [
        '<!doctype html>\n<html lang="en">\n<meta charset="utf-8">',
        '<meta name="viewport" content="width=device-width, initial-scale=1">',
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n<h1>{escape(title)}</h1>",
        f'<video controls autoplay muted loop src="data:video/mp4;base64,{data}"></video>',
        f"<p>{_EXPLANATION}</p>",
    ]
    for game in games:
        rows = "\n".join(
            f"<tr><td>{change.when}<td>{escape(change.goal)}<td>{escape(change.why)}" for change in game.changes
        )
        parts.append(
            f"<h2>{escape(game.name)}: {escape(game.outcome())}</h2>\n"
            f'<div class="scroll"><table>\n<tr><th>time<th>goal<th>why\n{rows}\n</table></div>'
        )
    return "\n".join(parts) + "\n</html>\n"


if __name__ == "__main__":
    sys.exit(main())
