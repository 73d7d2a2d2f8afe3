"""Compare policies in the same rounds: ``pacman-env compare``.

``rounds`` plays, stores and summarizes the rounds; ``table``, ``plot`` and ``evaluation.replay`` show them.
"""

import argparse
import itertools
import json
import re
import shutil
import sys
from collections.abc import Sequence
from pathlib import Path

from pacman_env.command_line.command import Parser, count, run_command, whole_number
from pacman_env.episodes.rollout import episode_seeds
from pacman_env.evaluation.compare.table import WIDTH, groups, render, verdict
from pacman_env.evaluation.rounds import scenarios
from pacman_env.evaluation.rounds.kept import play_left
from pacman_env.evaluation.rounds.play import Matchup
from pacman_env.evaluation.rounds.summary import describe_rounds, make_row
from pacman_env.executors.choice import add_executor_arguments, without_executor
from pacman_env.files import prepare, write_text

_VIDEO_SUFFIXES = (".mp4", ".gif")
#: A list of plain values in JSON, which is written on one line, and a line break in it.
_LIST, _BREAK = re.compile(r"\[\n\s+([^][{}]*?)\n\s+\]"), re.compile(r"\n\s+")


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
    policies = ("clyde_aware", "ppo", "lookahead", "nearest", "random_pellet")
    scenarios.add_policy_arguments(parser, policies, "policies; all are compared with the first")
    scenarios.add_game_arguments(parser, several=True)
    add("--episodes", type=count(), default=200, metavar="N", help="rounds or games per map, speed and policy (200)")
    add("--seed", type=whole_number(0), default=0, metavar="S", help="seed that generates all round seeds (0)")
    add_executor_arguments(parser)
    add("--threads", type=whole_number(0), default=1, metavar="N", help="threads of each process; 0: one per core (1)")
    add("--resume", action="store_true", help="load the stored rounds and play only the missing ones")
    parts = "folder of the stored rounds (OUT.parts next to the JSON file, or results/compare.parts)"
    add("--parts", type=Path, metavar="FOLDER", help=parts)
    add("--json", type=Path, metavar="OUT", help="write the results to this file")
    add("--plot", type=Path, metavar="OUT", help="plot (.png; next to the JSON file, or results/compare.png)")
    add("--video", type=Path, metavar="OUT", help="write a video (.mp4, .gif) of the first round on the first map")
    return parser


def _compare(arguments: argparse.Namespace) -> None:
    from pacman_env.evaluation.compare.plot import save_plot

    configs = scenarios.game_configs(arguments)
    config = configs[0]
    policies = scenarios.named_policies(scenarios.distinct("--policies", arguments.policies))
    maps = scenarios.named_scenarios(scenarios.from_arguments(arguments), configs[:1])
    scenarios.warn_of_short_time(maps, config)
    json_path, plot_path, video_path = _outputs(arguments)
    seeds = episode_seeds(arguments.seed, arguments.episodes)
    work = list(itertools.product(maps.items(), configs, policies.items()))
    matchups = [Matchup(scenario, one, spec, seeds, arguments.threads) for (_, scenario), one, (spec, _) in work]
    parts = arguments.parts or (arguments.json or Path("results/compare")).with_suffix(".parts")
    played = play_left(parts, matchups, arguments, "game" if config.endless else "episode")
    rows = []
    for k, (((place, _), one, (_, policy)), result) in enumerate(zip(work, played, strict=True)):
        first = k - k % len(policies)  # the first policy in the same rounds
        about = {"map": place, "policy": policy, "clyde_speed": one.clyde.speed_mps}
        others = None if k == first else [played[first][0]]
        rows.append(make_row(about, [result], others, endless=one.endless))
    settings = f"preset {arguments.preset}, execution {arguments.execution}, seed {arguments.seed}"
    settings = ", ".join([settings, *arguments.set])
    width, power = shutil.get_terminal_size((WIDTH, 24)).columns, config.power.pellets > 0
    print(f"{settings}\n\n{render(rows, width, power=power)}")
    if json_path is not None:
        by_name, rules = {name: spec for spec, name in policies.items()}, (arguments.preset, arguments.execution)
        content = describe_rounds("compare", config, rules, arguments.seed, seeds, maps, by_name)
        content["arguments"] = {k: v for k, v in without_executor(arguments).items() if k not in ("parts", "resume")}
        text = json.dumps(content | {"rows": rows}, indent=2, default=str, allow_nan=False)
        write_text(json_path, _LIST.sub(lambda match: f"[{_BREAK.sub(' ', match[1])}]", text) + "\n")
    rounds = "endless games" if config.endless else "rounds"
    heading = f"Same {len(seeds)} {rounds} for every policy  ({settings})"
    save_plot(rows, plot_path, "\n".join(filter(None, [verdict(rows) if len(groups(rows)) == 1 else "", heading])))
    if video_path is not None:
        from pacman_env.evaluation.replay import film_games, record_games

        height = 720 if len(policies) == 1 and video_path.suffix.lower() == ".mp4" else 480  # GIFs grow large
        film_games(record_games(next(iter(maps.values())), config, policies, seeds[0]), video_path, height)
    written = [path for path in (json_path, plot_path, video_path) if path is not None]
    print(f"\nwritten: {', '.join(map(str, written))}")


def _outputs(arguments: argparse.Namespace) -> tuple[Path | None, Path, Path | None]:
    plot = arguments.plot
    if plot is None:
        plot = arguments.json.with_suffix(".png") if arguments.json else Path("results/compare.png")
    video = arguments.video
    if plot.suffix.lower() != ".png":
        raise ValueError(f"--plot {plot}: must end in .png")
    if video is not None and video.suffix.lower() not in _VIDEO_SUFFIXES:
        raise ValueError(f"--video {video}: must end in {' or '.join(_VIDEO_SUFFIXES)}")
    if arguments.json == plot:
        raise ValueError(f"--json {plot}: must differ from --plot")
    return arguments.json and prepare(arguments.json), prepare(plot), video and prepare(video)


if __name__ == "__main__":
    sys.exit(main())
