"""Compare policies in the same rounds: ``pacman-env compare``.

``cells`` chooses the rounds, ``rounds`` plays, stores and summarizes them, ``results`` describes them as plain data.
``text_table``, ``plot``, ``league_table``, ``heat_map``, ``html_page`` and ``evaluation.replay`` show the results.
"""

import argparse
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pacman_env.command_line.command import Parser, count, run_command, whole_number
from pacman_env.command_line.game_options import add_game_option
from pacman_env.episodes.rollout import episode_seeds
from pacman_env.evaluation.compare import heat_map, league_table
from pacman_env.evaluation.compare.cells import EPISODES, Cell, make_cells, places
from pacman_env.evaluation.compare.results import as_json, describe, make_rows
from pacman_env.evaluation.compare.text_table import WIDTH, groups, render, verdict
from pacman_env.evaluation.rounds import scenarios
from pacman_env.evaluation.rounds.matchups import Matchup
from pacman_env.evaluation.rounds.stored_rounds import play_left
from pacman_env.executors.executor_options import add_executor_arguments
from pacman_env.files import prepare, write_text

POLICIES = ("clyde_aware", "ppo", "lookahead", "nearest", "random_pellet")
_SUFFIXES = {"plot": (".png",), "video": (".mp4", ".gif"), "html": (".html",), "markdown": (".md",)}


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(make_parser(), argv, _compare)


def make_parser() -> Parser:
    parser = Parser(
        prog="pacman-env compare",
        description="Let policies play the same rounds and compare them. Decision times are measured for one"
        " situation and the policy alone, without simulator and observation. All other results are the same"
        " for any number of workers and threads.",
    )
    add = parser.add_argument
    scenarios.add_policy_arguments(parser, POLICIES, "policies; all are compared with the first")
    scenarios.add_game_arguments(parser, several=True)
    suite = "play the cells of this suite, on test levels and the maps of --map (slam: the league's): full, brief, ..."
    add("--suite", metavar="NAME", help=suite)
    add("--suites", type=Path, metavar="FILE", help="YAML file of the suites (eval/suites/leaderboard.yaml)")
    rounds = f"rounds or games per map, speed and policy ({EPISODES}, or the suite's)"
    add("--episodes", type=count(), metavar="N", help=rounds)
    add_game_option(parser, "--seed")
    add_executor_arguments(parser)
    add("--threads", type=whole_number(0), default=1, metavar="N", help="threads of each process; 0: one per core (1)")
    add("--resume", action="store_true", help="load the stored rounds and play only the missing ones")
    parts = "folder of the stored rounds (OUT.parts next to the JSON file, or results/compare.parts)"
    add("--parts", type=Path, metavar="FOLDER", help=parts)
    add("--json", type=Path, metavar="OUT", help="write the results to this file")
    add("--plot", type=Path, metavar="OUT", help="plot (.png; next to the JSON file, or results/compare.png)")
    add("--video", type=Path, metavar="OUT", help="write a video (.mp4, .gif) of the first round on the first map")
    add("--html", type=Path, metavar="OUT", help="write a page of the results (.html)")
    add("--markdown", type=Path, metavar="OUT", help="write the league table of --suite (.md), and an .svg file")
    return parser


def _compare(arguments: argparse.Namespace) -> None:
    written = _outputs(arguments)
    policies = scenarios.named_policies(scenarios.distinct("--policies", arguments.policies))
    cells = make_cells(arguments)
    maps = {name: scenario for name, (scenario, _) in places(cells).items()}
    scenarios.warn_of_short_time(maps, cells[0].config)
    matchups = [
        Matchup(scenario, cell.config, spec, episode_seeds(arguments.seed, cell.rounds), arguments.threads)
        for cell in cells
        for scenario in cell.scenarios.values()
        for spec in policies
    ]
    parts = arguments.parts or (arguments.json or Path("results/compare")).with_suffix(".parts")
    played = play_left(parts, matchups, arguments, "game" if cells[0].config.endless else "episode")
    content = describe(arguments, make_parser(), cells, policies)
    content["rows"] = rows = make_rows(cells, list(policies.values()), played)
    if "json" in written:
        write_text(written["json"], as_json(content))
    settings = f"preset {arguments.preset}, execution {arguments.execution}, seed {arguments.seed}"
    settings = ", ".join([settings, *arguments.set])
    if arguments.suite:
        blocks = [f"suite {arguments.suite}, {settings}", *league_table.summary(rows), *league_table.tables(content)]
        print("\n\n".join(blocks))
    else:
        width, power = shutil.get_terminal_size((WIDTH, 24)).columns, cells[0].config.power.pellets > 0
        print(f"{settings}\n\n{render(rows, width, power=power)}")
    _write_views(content, written, settings)
    if "video" in written or "html" in written:
        _write_films(content, written, cells[0], policies)
    print(f"\nwritten: {', '.join(map(str, written.values()))}")


def _write_views(content: dict[str, Any], written: dict[str, Path], settings: str) -> None:
    """Write the plot, or the league table with its heat map."""
    rows = content["rows"]
    if "plot" in written:
        from pacman_env.evaluation.compare.plot import save_plot

        rounds = f"{rows[0]['episodes']} {'endless games' if rows[0]['kind'] == 'endless' else 'rounds'}"
        heading = f"Same {rounds} for every policy  ({settings})"
        title = [verdict(rows), heading] if len(groups(rows)) == 1 else [heading]
        save_plot(rows, written["plot"], "\n".join(filter(None, title)))
    if "markdown" in written:
        write_text(written["svg"], heat_map.draw(rows))
        write_text(written["markdown"], league_table.render(content, written["svg"].name))


def _write_films(content: dict[str, Any], written: dict[str, Path], cell: Cell, policies: dict[str, str]) -> None:
    """Write the film, and the page that contains the film and its first frame."""
    video, poster = written.get("video"), None
    if video is not None:
        from pacman_env.evaluation.replay import film_games, first_frame, record_games

        height = 720 if len(policies) == 1 and video.suffix.lower() == ".mp4" else 480  # GIFs grow large
        games = record_games(next(iter(cell.scenarios.values())), cell.config, policies, int(content["seeds"][0]))
        poster = first_frame(games, height)
        film_games(games, video, height)
    if "html" in written:
        from pacman_env.evaluation.compare.html_page import render_page

        write_text(written["html"], render_page(content, written.get("plot"), video, poster))


def _outputs(arguments: argparse.Namespace) -> dict[str, Path]:
    """Return the files to write by option; raises ValueError for a wrong one. A suite has no plot."""
    files = {name: getattr(arguments, name) for name in ("json", *_SUFFIXES)}
    if arguments.suite is None and files["plot"] is None:
        files["plot"] = arguments.json.with_suffix(".png") if arguments.json else Path("results/compare.png")
    wanted = {name: path for name, path in files.items() if path is not None}
    for name, suffixes in _SUFFIXES.items():
        if name in wanted and wanted[name].suffix.lower() not in suffixes:
            raise ValueError(f"--{name} {wanted[name]}: must end in {' or '.join(suffixes)}")
    for name, other in (("plot", True), ("markdown", False)):
        if name in wanted and (arguments.suite is not None) == other:
            raise ValueError(f"--{name}: must {'not ' if other else ''}be combined with --suite")
    if "markdown" in wanted:
        wanted["svg"] = wanted["markdown"].with_suffix(".svg")
    for name, path in wanted.items():
        if wanted.get("json") == path and name != "json":
            raise ValueError(f"--json {path}: must differ from --{name}")
    return {name: prepare(path) for name, path in wanted.items()}


if __name__ == "__main__":
    sys.exit(main())
