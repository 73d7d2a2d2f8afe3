"""Write an HTML page that compares policies: ``pacman-env report``.

``plan`` chooses the rounds, ``rounds`` plays, stores and summarizes them, ``numbers`` combines and ``page`` shows them.
"""

import argparse
import datetime
import json
import shlex
import sys
from collections.abc import Iterator, Sequence
from itertools import chain, zip_longest
from pathlib import Path
from typing import Any
from urllib.parse import quote

import msgspec

from pacman_env.command_line.command import Parser, finite_number, run_command, whole_number
from pacman_env.config import ConfigError, located, make_config
from pacman_env.episodes.rollout import episode_seeds
from pacman_env.evaluation.report.numbers import Results
from pacman_env.evaluation.report.plan import ReportPlan, check_single_rounds, matchups, parse_variant
from pacman_env.evaluation.rounds import scenarios
from pacman_env.evaluation.rounds.kept import play_left
from pacman_env.evaluation.rounds.scenarios import Levels
from pacman_env.evaluation.rounds.summary import describe_rounds
from pacman_env.executors.choice import add_executor_arguments
from pacman_env.files import prepare, write_text
from pacman_env.policies.learned import PRETRAINED
from pacman_env.policies.metadata import read_planner

_SPEEDS = tuple(round(0.15 + 0.05 * k, 2) for k in range(10))
#: Defaults of arguments, by ``--quick``.
_NUMBERS = {
    False: {"episodes": 200, "endless": 100, "speeds": _SPEEDS},
    True: {"episodes": 24, "endless": 12, "speeds": (0.15, 0.35, 0.6)},
}
_NO_REFUGES = "without refuges=refuges.spread=0,refuges.nooks=0"
_LONGEST_FACT = 80  # characters


def main(argv: Sequence[str] | None = None) -> int:
    argv = sys.argv[1:] if argv is None else argv
    command = shlex.join(["pacman-env", "report", *argv])
    return run_command(make_parser(), argv, lambda arguments: _report(arguments, command))


def make_parser() -> Parser:
    parser = Parser(
        prog="pacman-env report",
        description="Let policies play the same rounds and write one HTML page about them: completion per map and over"
        " Clyde's speeds, endless games, rounds that only one of two completes, variants of the settings, and decision"
        " times (of the policy alone, for one situation). All other results are the same for any number of"
        " workers.",
    )
    policies = ("ppo", "clyde_aware", "lookahead", "nearest", "random_pellet")
    scenarios.add_policy_arguments(parser, policies, "policies in the order of the page")
    add = parser.add_argument
    add("--baseline", default="clyde_aware", metavar="POLICY", help="policy to compare the others with (%(default)s)")
    scenarios.add_scenario_arguments(parser, several=True)
    scenarios.add_rule_arguments(parser)
    add("--clyde-speed", type=finite_number(), default=0.25, metavar="V", help="speed outside the curve, m/s (0.25)")
    add("--speeds", nargs="+", type=finite_number(), metavar="V", help="speeds in the curve, m/s (0.15 0.2 ... 0.6)")
    variants = "play the rounds also with other settings, such as 'slow=robot.speed_mps=0.2,preset=ideal'; repeatable;"
    variants += " without a value: no variants (the other preset; no refuges)"
    add("--variant", action="append", nargs="*", metavar="NAME=SETTINGS", help=variants)
    add("--episodes", type=whole_number(2), metavar="N", help="rounds per map, speed, variant and policy (200)")
    add("--endless", type=whole_number(0), metavar="N", help="number of endless games per map and policy (100)")
    add("--seed", type=whole_number(0), default=0, metavar="S", help="seed that generates all round seeds (0)")
    add_executor_arguments(parser)
    add("--resume", action="store_true", help="load the stored rounds and play only the missing ones")
    add("--parts", type=Path, metavar="FOLDER", help="folder of the stored rounds (OUT.parts next to the page)")
    add("--replays", type=whole_number(0), default=1, metavar="K", help="films of rounds that only one completed (1)")
    add("--quick", action="store_true", help="play less by default: 24 rounds, 12 endless games, three speeds")
    add("--out", type=Path, default=Path("results/report.html"), metavar="OUT", help="page (%(default)s)")
    add("--json", type=Path, metavar="OUT", help="write the results to this file")
    return parser


def _report(arguments: argparse.Namespace, command: str) -> None:
    plan = _plan(arguments)
    report = _header(plan, arguments, command)
    page, json_path = arguments.out, arguments.json
    if page.suffix.lower() != ".html":
        raise ValueError(f"--out {page}: must end in .html")
    if json_path == page:
        raise ValueError(f"--json {page}: must differ from --out")
    for path in filter(None, (page, json_path)):
        prepare(path)
    scenarios.warn_of_short_time(plan.maps, plan.config)
    work = matchups(plan)
    played = play_left(arguments.parts or page.with_suffix(".parts"), list(work.values()), arguments)
    report |= Results(plan, dict(zip(work, played, strict=True))).numbers()
    _write(report, page, json_path)  # before the films, so that a failing film loses no numbers
    films = _films(plan, report["pair"], arguments.replays, page)
    if films:
        _write(report, page, json_path)  # again, with their links
    written = [path for path in (page, json_path, *films) if path is not None]
    print(f"written: {', '.join(map(str, written))}")


def _write(report: dict[str, Any], page: Path, json_path: Path | None) -> None:
    from pacman_env.evaluation.report.page import render_page

    if json_path is not None:
        write_text(json_path, json.dumps(report, allow_nan=False) + "\n")
    write_text(page, render_page(report))


def _plan(arguments: argparse.Namespace) -> ReportPlan:
    for name, value in _NUMBERS[arguments.quick].items():
        if getattr(arguments, name) is None:
            setattr(arguments, name, value)
    words = arguments.preset, arguments.execution
    config = make_config(*words, **scenarios.rule_changes(arguments) | {"clyde.speed_mps": arguments.clyde_speed})
    settings = (*arguments.set, f"clyde.speed_mps={arguments.clyde_speed!r}")
    check_single_rounds(config)
    scenarios.check_speed(config)
    speeds = tuple(sorted(set(arguments.speeds)))
    for speed in speeds:
        config.with_fields(**{"clyde.speed_mps": speed})
    other = "robot" if arguments.preset == "ideal" else "ideal"
    given = [f"preset {other}=preset={other}", _NO_REFUGES]
    if arguments.variant is not None:
        given = [text for texts in arguments.variant for text in texts]
    variants = tuple(parse_variant(text, *words, settings) for text in given)
    names = [variant.name for variant in variants]
    for variant in variants:
        with located(f"--variant {variant.name}"):
            check_single_rounds(variant.config)
        if names.count(variant.name) > 1:
            raise ConfigError(f"--variant {variant.name}: given twice")
    policies = scenarios.named_policies([*scenarios.distinct("--policies", arguments.policies), arguments.baseline])
    wanted = scenarios.from_arguments(arguments)
    return ReportPlan(
        maps=scenarios.named_scenarios(wanted, [config, *(variant.config for variant in variants)]),
        policies={name: spec for spec, name in policies.items()},
        baseline=policies[arguments.baseline],
        preset=arguments.preset,
        execution=arguments.execution,
        settings=tuple(arguments.set),
        config=config,
        speeds=speeds,
        variants=variants,
        seed=arguments.seed,
        seeds=episode_seeds(arguments.seed, arguments.episodes),
        endless_seeds=episode_seeds(arguments.seed, arguments.endless),
    )


def _header(plan: ReportPlan, arguments: argparse.Namespace, command: str) -> dict[str, Any]:
    """Return everything needed to play the rounds again."""
    rules = (plan.preset, plan.execution)
    head = describe_rounds("report", plan.config, rules, plan.seed, plan.seeds, plan.maps, plan.policies)
    for place, scenario in zip(head["maps"], plan.maps.values(), strict=True):
        if not isinstance(scenario, Levels):
            place["pellets"] = scenarios.open_scenario(scenario, plan.config).first.pellets
    for policy in head["policies"]:
        policy |= {"baseline": policy["name"] == plan.baseline, "facts": model_facts(policy["spec"])}
    return head | {
        "date": f"{datetime.datetime.now(datetime.UTC):%Y-%m-%d %H:%M} UTC",
        "command": command,
        "episodes": len(plan.seeds),
        "endless_games": len(plan.endless_seeds),
        "settings": list(plan.settings),
        "clyde_speed": plan.speed,
        "speeds": list(plan.speeds),
        "variants": [
            {"name": one.name, "settings": one.settings, "clyde_speed": one.config.clyde.speed_mps}
            for one in plan.variants
        ],
        "quick": arguments.quick,
    }


def _films(plan: ReportPlan, pair: dict[str, Any] | None, wanted: int, page: Path) -> list[Path]:
    """Film the pair's first rounds, won and lost in turn, next to the page; add a link to each round."""
    if pair is None or wanted == 0:
        return []
    from pacman_env.evaluation.replay import film_games, record_games

    paths = []
    folder = page.with_name(f"{page.stem}_films")
    policies = {plan.policies[name]: name for name in (pair["policy"], pair["baseline"])}
    in_turn = [row for row in chain.from_iterable(zip_longest(pair["wins"], pair["losses"])) if row is not None]
    try:
        for row in in_turn[:wanted]:
            path = prepare(folder / f"{row['map'].replace(':', '-')}-{row['seed']}.mp4")
            film_games(record_games(plan.maps[row["map"]], plan.config, policies, int(row["seed"])), path)
            row["film"] = quote(f"{path.parent.name}/{path.name}")
            paths.append(path)
    finally:
        if folder.is_dir() and not any(folder.iterdir()):  # the first film failed
            folder.rmdir()
    return paths


def model_facts(spec: str) -> dict[str, str]:
    """Return the metadata of ``FILE.onnx`` or the shipped planner by dotted name; {} for other policies."""
    path = PRETRAINED if spec == "ppo" else Path(spec)
    return dict(_flat(msgspec.to_builtins(read_planner(path)[0]))) if path.suffix.lower() == ".onnx" else {}


def _flat(facts: dict[str, Any], prefix: str = "") -> Iterator[tuple[str, str]]:
    for name, value in facts.items():
        if isinstance(value, dict):
            yield from _flat(value, f"{prefix}{name}.")
        else:
            words = ", ".join(map(str, value)) if isinstance(value, tuple) else str(value)
            yield prefix + name, words if len(words) <= _LONGEST_FACT else words[: _LONGEST_FACT - 1] + "…"


if __name__ == "__main__":
    sys.exit(main())
