"""Write the league table of policies: ``pacman-env leaderboard``.

``suites`` chooses the cells, ``rounds`` plays, stores and summarizes the rounds, ``numbers`` compares, ``page`` shows.
"""

import argparse
import functools
import itertools
import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from numpy.typing import NDArray

from pacman_env import __version__
from pacman_env.command_line.command import Parser, run_command, whole_number
from pacman_env.config import Config, preset_names
from pacman_env.episodes.rollout import episode_seeds
from pacman_env.evaluation.leaderboard import numbers
from pacman_env.evaluation.leaderboard.heat_map import draw
from pacman_env.evaluation.leaderboard.numbers import CellResult, LeagueTable, MapEntry, PolicyEntry
from pacman_env.evaluation.leaderboard.page import render
from pacman_env.evaluation.leaderboard.suites import (
    EXECUTION,
    PRESET,
    SUITES,
    TEST_LEVELS,
    Cell,
    Suite,
    cells,
    choose_suite,
    configs,
)
from pacman_env.evaluation.rounds import scenarios
from pacman_env.evaluation.rounds.kept import describe_policy, play_left
from pacman_env.evaluation.rounds.play import Matchup
from pacman_env.evaluation.rounds.scenarios import Scenario
from pacman_env.executors.choice import add_executor_arguments
from pacman_env.files import commit, prepare, write_text
from pacman_env.policies.metadata import dump, read
from pacman_env.policies.registry import make_policy, policy_names

POLICIES = ("ppo", "lookahead", "clyde_aware", "nearest")
_PLANNER, _APART, _SUITE = "ppo", ("search",), "full"
_FOLDER = Path("results/leaderboard")


@dataclass(frozen=True)
class LeaguePlan:
    """Rounds to play: every policy on every map of every cell."""

    suite: Suite
    preset: str
    maps: dict[str, Scenario]  # the given maps by name
    policies: dict[str, str]  # names in results by spec
    hashes: dict[str, str | None]  # hashes of planner files by spec
    planner: str  # name of the planner
    apart: frozenset[str]  # names of policies that do not count among the best others
    seed: int

    @functools.cached_property
    def cells(self) -> list[Cell]:
        return cells(self.suite, self.maps, self.preset)

    @functools.cached_property
    def places(self) -> dict[str, tuple[Scenario, Config]]:
        """Return every scenario by name, with a configuration to open it."""
        places: dict[str, tuple[Scenario, Config]] = {}
        for cell in self.cells:
            for name, one in cell.scenarios.items():
                places.setdefault(name, (one, cell.config))
        return places

    def matchups(self) -> list[Matchup]:
        """Return all matchups: by cell, then by map, then by policy."""
        return [
            Matchup(scenario, cell.config, spec, episode_seeds(self.seed, cell.rounds))
            for cell in self.cells
            for scenario in cell.scenarios.values()
            for spec in self.policies
        ]


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(make_parser(), argv, _leaderboard)


def make_parser() -> Parser:
    parser = Parser(
        prog="pacman-env leaderboard",
        description="Let policies play the same rounds in the cells of a suite (ghosts, their speed, maps) and write"
        " the league table as a page and as JSON. Played rounds are stored: --resume continues an interrupted run and"
        " plays only missing rounds. The results are the same for any number of workers.",
    )
    add = parser.add_argument
    files = f"names ({', '.join(policy_names())}) or .onnx files; without: {' '.join(POLICIES)}"
    add("--policies", nargs="+", default=list(POLICIES), metavar="POLICY", help=f"policies, in this order: {files}")
    add("--planner", default=_PLANNER, metavar="POLICY", help="policy compared with the best other (%(default)s)")
    apart = f"policies that do not count as best other policy ({' '.join(_APART)})"
    add("--apart", nargs="*", default=list(_APART), metavar="POLICY", help=apart)
    add("--maps", nargs="+", default=[], metavar="FILE_OR_NAME", help="maps: names, YAML files or folders (none)")
    add("--suite", default=_SUITE, metavar="NAME", help="suite: full, or quick, which takes a minute (%(default)s)")
    add("--suites", type=Path, metavar="FILE", help="YAML file of the suites (eval/suites/leaderboard.yaml)")
    presets = ", ".join(preset_names())
    add("--preset", choices=preset_names(), default=PRESET, metavar="NAME", help=f"one of {presets} (%(default)s)")
    add("--seed", type=whole_number(0), default=0, metavar="S", help="seed that generates all round seeds (0)")
    add_executor_arguments(parser)
    add("--resume", action="store_true", help="load the stored rounds and play only the missing ones")
    add("--parts", type=Path, default=_FOLDER, metavar="FOLDER", help="folder of the stored rounds (%(default)s)")
    add("--json", type=Path, default=Path(f"{_FOLDER}.json"), metavar="OUT", help="results (%(default)s)")
    add("--out", type=Path, default=Path(f"{_FOLDER}.md"), metavar="OUT", help="page, with an .svg file (%(default)s)")
    add("--from", type=Path, dest="source", metavar="JSON", help="play nothing; write the page from these results")
    return parser


def _leaderboard(arguments: argparse.Namespace) -> None:
    page = arguments.out
    if page.suffix.lower() != ".md":
        raise ValueError(f"--out {page}: must end in .md")
    if arguments.source is not None:
        table = read_table(arguments.source)
    else:
        if arguments.json.suffix.lower() != ".json":
            raise ValueError(f"--json {arguments.json}: must end in .json")
        plan = _plan(arguments)
        prepare(arguments.json)
        prepare(page)
        played = play_left(arguments.parts, plan.matchups(), arguments)
        table = _table(plan, [records for records, _ in played], arguments)
        write_text(arguments.json, dump(table, arguments.json))
    picture = page.with_suffix(".svg")
    write_text(prepare(picture), draw(table))
    write_text(prepare(page), render(table, picture.name))
    counts = ", ".join(f"{verdict} in {number}" for verdict, number in table.verdicts.items())
    print(f"{table.planner} against the best other policy, {len(table.cells)} cells: {counts}")
    written = [page, picture, *([] if arguments.source else [arguments.json])]
    print(f"written: {', '.join(map(str, written))}")


def read_table(path: Path) -> LeagueTable:
    """Read the numbers of a table; raises ValueError, with file and field, if they are invalid."""
    table = read(LeagueTable, path)
    names = [entry.name for entry in table.policies]
    if table.planner not in names:
        raise ValueError(f"{path}: planner = {table.planner!r}: must be one of policies")
    for number, cell in enumerate(table.cells):
        if [row.policy for row in cell.policies] != names:
            raise ValueError(f"{path}: cells[{number}].policies: must be {', '.join(names)}")
        if (cell.against is None) != (table.cells[0].against is None):
            raise ValueError(f"{path}: cells[{number}].against: must be null in all cells or in none")
    for number, place in enumerate(table.maps):
        if (place.start_level is None) != (place.num_levels is None):
            raise ValueError(f"{path}: maps[{number}]: must have both start_level and num_levels, or neither")
    if any(cell.group == TEST_LEVELS for cell in table.cells) and all(p.num_levels is None for p in table.maps):
        raise ValueError(f"{path}: maps: must hold the {TEST_LEVELS}, with start_level and num_levels")
    for number, row in enumerate(table.means):
        if row.least_cell >= len(table.cells):
            raise ValueError(f"{path}: means[{number}].least_cell = {row.least_cell}: there is no such cell")
    return table


def _plan(arguments: argparse.Namespace) -> LeaguePlan:
    suite = choose_suite(arguments.suites or SUITES, arguments.suite)
    hashes = {}
    for spec in arguments.policies:
        if scenarios.is_checkpoint(spec):
            raise ValueError(f"{spec}: must be a name or an .onnx file; pacman-env export makes one of a checkpoint")
        hashes[spec] = describe_policy(make_policy(spec), spec).get("sha256")
    names = scenarios.result_names(list(hashes))
    if arguments.planner not in names:
        raise ValueError(f"--planner {arguments.planner}: must be one of --policies {' '.join(names)}")
    for source in arguments.maps:
        if source.partition(":")[0] == "generated":
            raise ValueError(f"--maps {source}: test levels are in the suite")
    return LeaguePlan(
        suite=suite,
        preset=arguments.preset,
        maps=scenarios.named_scenarios(list(dict.fromkeys(arguments.maps)), configs(suite, arguments.preset)),
        policies=names,
        hashes=hashes,
        planner=names[arguments.planner],
        apart=frozenset(names[spec] for spec in arguments.apart if spec in names),
        seed=arguments.seed,
    )


def _table(plan: LeaguePlan, played: Sequence[NDArray], arguments: argparse.Namespace) -> LeagueTable:
    results, following = [], iter(played)  # rounds in the order of plan.matchups()
    for cell in plan.cells:
        rounds: dict[str, list[NDArray]] = {name: [] for name in plan.policies.values()}
        for _, name in itertools.product(cell.scenarios, rounds):
            rounds[name].append(next(following))
        others = {name: some for name, some in rounds.items() if name != plan.planner and name not in plan.apart}
        result = CellResult(
            group=cell.group,
            ghosts=cell.config.clyde.ghosts,
            speed_mps=cell.config.clyde.speed_mps,
            rounds=cell.rounds * len(cell.scenarios),
            policies=tuple(numbers.policy_in_cell(name, some) for name, some in rounds.items()),
            against=numbers.against(rounds[plan.planner], others),
        )
        results.append(result)
    entries = []
    for spec, name in plan.policies.items():
        entry = PolicyEntry(
            name=name,
            spec=spec,
            sha256=plan.hashes[spec],
            apart=name in plan.apart and name != plan.planner,
            command=_command(arguments, [spec], spec),
        )
        entries.append(entry)
    return LeagueTable(
        schema=numbers.SCHEMA,
        version=__version__,
        commit=commit(),
        command=_command(arguments, list(plan.policies), arguments.planner),
        suite=arguments.suite,
        suite_content=plan.suite,
        preset=plan.preset,
        execution=EXECUTION,
        seed=plan.seed,
        maps=tuple(MapEntry(**scenarios.describe_scenario(name, *place)) for name, place in plan.places.items()),
        planner=plan.planner,
        policies=tuple(entries),
        means=numbers.means(results),
        verdicts=numbers.verdicts(results),
        cells=tuple(results),
    )


def _command(arguments: argparse.Namespace, specs: list[str], planner: str) -> str:
    """Return the command that repeats the rounds of these policies, without options that do not affect the rounds."""
    words = ["pacman-env", "leaderboard", "--suite", arguments.suite]
    words += [] if arguments.suites is None else ["--suites", str(arguments.suites)]
    words += [] if arguments.preset == PRESET else ["--preset", arguments.preset]
    words += ["--seed", str(arguments.seed), "--policies", *specs, "--planner", planner]
    words += [] if len(specs) == 1 or arguments.apart == list(_APART) else ["--apart", *arguments.apart]
    words += ["--maps", *arguments.maps] if arguments.maps else []
    return shlex.join(words)


if __name__ == "__main__":
    sys.exit(main())
