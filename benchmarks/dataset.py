"""The speed of writing a data set beside only playing its rounds: ``python -m benchmarks.dataset``.

The same rounds on one map by the same policy are played in turns: without any observation, as a comparison does; in
PacManBotFlat with its observations, which are thrown away; and written by ``pacman-env dataset`` for Minari, as
Parquet, and as both. A rate is rounds per second of processor time, of one process; the ratios are those of a turn, and
their median is printed. What is written is read again by both libraries and counted.
"""

import argparse
import contextlib
import sys
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.harness import Option, benchmark, count, log, median_and_range, turns
from pacman_env.envs.arguments import EnvArguments
from pacman_env.episodes.rollout import play
from pacman_env.evaluation.dataset import __main__ as dataset
from pacman_env.evaluation.dataset.recording import record, round_seeds, tasks_of

NAME = "pacman-env/benchmark-v0"
FORMATS = {"minari": ["minari"], "parquet": ["parquet"], "both": ["minari", "parquet"]}


def measure(arguments: argparse.Namespace) -> dict[str, Any]:
    env = EnvArguments(arguments.map, flat=True)
    config, _ = env.make_config()
    source, seeds = env.make_source(config), round_seeds(arguments.seed, arguments.episodes)
    tasks = tasks_of(arguments.policy, env, seeds)

    def played() -> None:
        play(source, config, arguments.policy, seeds)

    def observed() -> None:
        for task in tasks:
            record(task)

    def written(formats: list[str]) -> None:
        with tempfile.TemporaryDirectory() as folder:
            given = [NAME, "--policy", arguments.policy, "--map", arguments.map, "--episodes", str(len(seeds))]
            given += ["--seed", str(arguments.seed), "--root", folder, "--format", *formats]
            with contextlib.redirect_stdout(sys.stderr):
                status = dataset.main(given)
            if status:
                raise OSError(f"pacman-env dataset: exit status {status}")
            _check(Path(folder) / NAME, formats, len(seeds))

    ways: dict[str, Callable[[], None]] = {"played": played, "observed": observed}
    ways |= {name: partial(written, formats) for name, formats in FORMATS.items()}
    play(source, config, arguments.policy, seeds[:64])  # compiles
    record(tasks[0])
    times = turns(arguments.rounds, *(partial(_seconds, way) for way in ways.values()))
    rates = [[len(seeds) / one for one in turn] for turn in times]
    figures: dict[str, Any] = {"policy": arguments.policy, "episodes": len(seeds)}
    print(f"{len(seeds)} rounds by {arguments.policy} on {arguments.map}, rounds per second of processor time:")
    for k, name in enumerate(ways):
        rate, least, most = median_and_range([turn[k] for turn in rates])
        of_played, of_observed = (median_and_range([turn[k] / turn[beside] for turn in rates])[0] for beside in (0, 1))
        figures[name] = {"rate": rate, "least": least, "most": most, "of_played": of_played, "of_observed": of_observed}
        print(
            f"  {name:<9} {rate:7.1f} ({least:.1f} to {most:.1f}), "
            f"{of_played:.2f} of only playing, {of_observed:.2f} of playing with observations"
        )
    return figures


def _seconds(way: Callable[[], None]) -> float:
    began = time.process_time()
    way()
    return time.process_time() - began


def _check(folder: Path, formats: list[str], rounds: int) -> None:
    if "minari" in formats:
        import minari

        assert minari.MinariDataset(folder / "data").total_episodes == rounds
    if "parquet" in formats:
        import pyarrow.parquet

        assert pyarrow.parquet.read_metadata(folder / "rounds.parquet").num_rows == rounds
    size = sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())
    log(f"{'+'.join(formats)}: {size / 1e6:.0f} MB")


POLICY: Option = ("--policy", {"default": "lookahead", "help": "a name or an .onnx file (%(default)s)"})
EPISODES = count("--episodes", 10_000, "rounds of a turn (%(default)s)")
main = benchmark(
    "dataset", __doc__, measure, POLICY, "--seed", EPISODES, count("--rounds", 1, "turns"), extra="dataset"
)

if __name__ == "__main__":
    sys.exit(main())
