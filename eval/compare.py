"""Policies compared on the same rounds: ``python -m eval.compare``. Arguments, order of work, result files.

Rounds are played in ``episodes``, counted in ``rows``, shown by ``report_table``, ``plot`` and ``video``.
"""

from __future__ import annotations

import argparse
import itertools
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from eval.arguments import at_least
from eval.episodes import episode_seeds
from eval.files import prepare, replaced
from eval.parallel import Block, play_all
from eval.report_table import render
from eval.rows import Row, make_row
from pacman_env import __version__
from pacman_env.cli import ERROR_STATUS, Parser
from pacman_env.config import EXECUTIONS, PRESETS, Config, ConfigError, make_config
from pacman_env.policies.registry import make_policy, policy_names
from pacman_env.settings import parse_settings
from pacman_env.sim.assets import MapAssets, map_assets

SCHEMA = 1
_VIDEO_SUFFIXES = (".mp4", ".gif")


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        prog="eval.compare",
        description="Let policies play the same rounds and compare them. Decision times are those of the"
        " policy alone for one situation, without simulator and observation. All numbers but these times are"
        " the same for any number of workers.",
        formatter_class=argparse.ArgumentDefaultsHelpFormatter,
    )
    add = parser.add_argument
    add("--map", nargs="+", default=["house"], metavar="FILE_OR_NAME", help="maps to play on")
    add(
        "--policies",
        nargs="+",
        default=["clyde_aware", "nearest", "random"],
        metavar="POLICY",
        help=f"the first is what the others are compared with; names: {', '.join(policy_names())}",
    )
    add("--preset", choices=sorted(PRESETS), default="robot", help="robot and localization")
    add("--execution", choices=sorted(EXECUTIONS), default="robust", help="how goals are executed")
    add("--clyde-speed", nargs="+", type=float, default=[0.25], metavar="V", help="m/s")
    add("--clyde-spawn", choices=("connected", "anywhere"), help="Clyde's cells at the start (preset's)")
    add("--clyde-spawn-distance", type=float, metavar="M", help="from the robot, at least, m (preset's)")
    add("--spacing", type=float, metavar="M", help="of the pellets, m (preset's)")
    add("--time-limit", type=float, metavar="S", help="of a round, s (preset's)")
    add(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="any field of the configuration, such as nav2.abort_rate=0.01; may be given again",
    )
    add("--episodes", type=at_least(1), default=200, metavar="N", help="rounds per map, speed and policy")
    add("--seed", type=at_least(0), default=0, metavar="S", help="the rounds' seeds are drawn from it")
    add("--workers", type=at_least(1), default=1, metavar="N", help="processes")
    add("--json", type=Path, metavar="OUT", help="write the numbers")
    add("--plot", type=Path, metavar="OUT", help="PNG; else beside the JSON, else results/compare.png")
    add(
        "--video",
        type=Path,
        metavar="OUT",
        help="film (.mp4, .gif) of the first map's first round",
    )
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run the comparison; returns the exit status: 0, or 2 after one line on stderr.

    Raises:
        SystemExit: after ``--help`` and bad arguments, as argparse does.
    """
    parser = _parser()
    arguments = parser.parse_args(argv)
    try:
        _compare(arguments)
    except ModuleNotFoundError as error:
        print(f"{parser.prog}: needs {error.name}: pip install 'pacman_env[eval]'", file=sys.stderr)
        return ERROR_STATUS
    except (ValueError, OSError) as error:  # MapError and ConfigError are ValueErrors
        print(f"{parser.prog}: {error}", file=sys.stderr)
        return ERROR_STATUS
    return 0


def _compare(arguments: argparse.Namespace) -> None:
    from tqdm import tqdm

    configs = _configs(arguments)
    policies = list(dict.fromkeys(arguments.policies))
    for policy in policies:
        make_policy(policy)
    maps = _maps(arguments.map, configs[0])
    json_path, plot_path, video_path = _outputs(arguments)
    seeds = episode_seeds(arguments.seed, arguments.episodes)
    blocks = [
        Block(source, config, policy, seeds)
        for (source, _), config, policy in itertools.product(maps, configs, policies)
    ]
    with tqdm(total=len(blocks) * len(seeds), unit="episode", mininterval=1.0, file=sys.stderr) as bar:
        played = play_all(blocks, arguments.workers, bar.update)
    names = {source: assets.occupancy.name for source, assets in maps}
    rows = _rows(blocks, played, names)
    what = f"preset {arguments.preset}, execution {arguments.execution}, seed {arguments.seed}"
    what = ", ".join([what, *arguments.set])
    print(f"{what}\n\n{render(rows)}")
    if json_path is not None:
        _write_json(json_path, rows, maps, configs[0], arguments)
    _draw(plot_path, rows, f"Same {len(seeds)} rounds for every policy  ({what})")
    if video_path is not None:
        _film(video_path, maps[0][1], configs[0], policies, seeds[0])
    written = [path for path in (json_path, plot_path, video_path) if path is not None]
    print(f"\nwritten: {', '.join(map(str, written))}")


def _configs(arguments: argparse.Namespace) -> list[Config]:
    """One configuration per speed of Clyde's."""
    changes = parse_settings(arguments.set)
    if "clyde.speed_mps" in changes:
        raise ConfigError("clyde.speed_mps: give it as --clyde-speed")
    for name, value in (
        ("clyde.spawn", arguments.clyde_spawn),
        ("clyde.spawn_distance_m", arguments.clyde_spawn_distance),
        ("pellets.spacing_m", arguments.spacing),
        ("time_limit_s", arguments.time_limit),
    ):
        if value is not None:
            if name in changes:
                raise ConfigError(f"{name}: given twice")
            changes[name] = value
    speeds = dict.fromkeys(arguments.clyde_speed)
    configs = [
        make_config(arguments.preset, arguments.execution, **changes, **{"clyde.speed_mps": speed}) for speed in speeds
    ]
    config = configs[0]
    for name, value, wrong in (
        ("action", config.action, config.action != "goal"),
        ("endless", config.endless, config.endless),
        ("clyde.ghosts", config.clyde.ghosts, "policy" in config.clyde.ghosts),
    ):
        if wrong:
            raise ConfigError(f"{name} = {value!r}: policies that name goals are compared over single rounds")
    return configs


def _maps(sources: Sequence[str], config: Config) -> list[tuple[str, MapAssets]]:
    maps = [(source, map_assets(source, config)) for source in dict.fromkeys(sources)]
    names = [assets.occupancy.name for _, assets in maps]
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"two maps are called {name}: the results could not be told apart")
    return maps


def _outputs(arguments: argparse.Namespace) -> tuple[Path | None, Path, Path | None]:
    """Paths of JSON, plot and video, all known to be writable before the work begins."""
    plot = arguments.plot
    if plot is None:
        plot = arguments.json.with_suffix(".png") if arguments.json else Path("results/compare.png")
    video = arguments.video
    if plot.suffix != ".png":
        raise ValueError(f"--plot {plot}: must end in .png")
    if video is not None and video.suffix not in _VIDEO_SUFFIXES:
        raise ValueError(f"--video {video}: must end in {' or '.join(_VIDEO_SUFFIXES)}")
    if arguments.json == plot:
        raise ValueError(f"--json {plot}: is the plot's file too")
    return arguments.json and prepare(arguments.json), prepare(plot), video and prepare(video)


def _rows(blocks: Sequence[Block], played: Sequence[tuple[Any, Any]], names: dict[str, str]) -> list[Row]:
    rows = []
    first: dict[tuple[str, float], Any] = {}
    for block, (records, decision_ms) in zip(blocks, played, strict=True):
        speed = block.config.clyde.speed_mps
        reference = first.get((block.map, speed))
        first.setdefault((block.map, speed), records)
        rows.append(
            make_row(
                map_name=names[block.map],
                policy=block.policy,
                clyde_speed=speed,
                records=records,
                decision_ms=decision_ms,
                first=reference,
            )
        )
    return rows


def _write_json(
    path: Path,
    rows: list[Row],
    maps: Sequence[tuple[str, MapAssets]],
    config: Config,
    arguments: argparse.Namespace,
) -> None:
    """Write the rows and all that is needed to get them again.

    ``config`` is that of the first of Clyde's speeds; each row has its own.
    """
    result = {
        "schema": SCHEMA,
        "version": __version__,
        "seed": arguments.seed,
        "preset": arguments.preset,
        "execution": arguments.execution,
        "maps": [
            {"name": assets.occupancy.name, "source": source, "hash": assets.occupancy.hash} for source, assets in maps
        ],
        "arguments": vars(arguments),
        "config": config.as_dict(),
        "rows": rows,
    }
    with replaced(path) as temporary:
        temporary.write_text(json.dumps(result, indent=2, default=str, allow_nan=False) + "\n")


def _draw(path: Path, rows: list[Row], title: str) -> None:
    from eval.plot import save_plot

    save_plot(rows, path, title)


def _film(path: Path, assets: MapAssets, config: Config, policies: Sequence[str], seed: Any) -> None:
    from eval.video import round_frames, save_video

    height = 720 if len(policies) == 1 and path.suffix == ".mp4" else 480  # GIFs grow large
    save_video(round_frames(assets, config, policies, seed, height=height), path, config.execution.tick_s)


if __name__ == "__main__":
    sys.exit(main())
