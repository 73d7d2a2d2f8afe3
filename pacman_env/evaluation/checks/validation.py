"""Compare the simulator with the ten real trials and measure the effect of each cause: ``pacman-env validation``.

The reference is the original game: deployed scorer, executor as built, measured speed, AMCL's latched pose, the
experiment's costmaps, Clyde spawning anywhere. Every other row changes a single cause in the same rounds.
``--planner-answers`` compares the paths of the simulated Nav2 with recorded paths of another planner instead,
``--recorded-goals`` its driving with recorded goals.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pacman_env.command_line.command import Parser, count, run_command, whole_number
from pacman_env.config import make_config, parse_settings
from pacman_env.episodes.rollout import episode_seeds
from pacman_env.episodes.statistics import wilson
from pacman_env.evaluation.checks import planner_answers, recorded_goals
from pacman_env.evaluation.compare.table import with_interval
from pacman_env.evaluation.rounds.play import Matchup, play_all
from pacman_env.evaluation.rounds.summary import Row, make_row
from pacman_env.executors.base import Executor
from pacman_env.executors.choice import add_executor_arguments, executor_of
from pacman_env.files import prepare, write_text
from pacman_env.sim.maps.assets import map_assets

#: The ten trials of the milestone: rounds complete, rounds with at most one pellet missing.
TRIALS, TRIALS_COMPLETE, TRIALS_ALL_BUT_ONE = 10, 3, 6

_ORIGINAL = {
    "clyde.spawn": "anywhere",
    "clyde.spawn_distance_m": 0.0,
    "nav2.inflation_radius_m": 0.22,
    "nav2.inflation_scale": 2.0,
}
_PREEMPT = {"execution.on_abort": "back_off", "execution.switch": "preempt"}


@dataclass(frozen=True)
class ValidationVariant:
    cause: str
    name: str
    policy: str = "clyde_aware"
    changes: Mapping[str, Any] | None = None


VARIANTS = (
    ValidationVariant("reference", "the original as it was"),
    ValidationVariant("selector", "milestone's form of the scorer", "clyde_aware:documented"),
    ValidationVariant("selector", "nearest pellet", "nearest"),
    ValidationVariant("selector", "random pellet", "random_pellet"),
    ValidationVariant("belief", "fresh pose from TF, with AMCL's error", changes={"execution.pose_source": "tf"}),
    ValidationVariant("belief", "perfect localization", changes={"localization.perfect": True}),
    ValidationVariant("belief", "AMCL's error as its own filter has it in this house", changes={
        "localization.sigma_xy_m": 0.135, "localization.sigma_yaw_rad": 0.07, "localization.error_kept": 0.97}),
    ValidationVariant("belief", "rules tested 20 times a second", changes={"execution.check_period_s": 0.05}),
    ValidationVariant("executor", "pre-empt instead of cancel-then-send, back-off", changes=_PREEMPT),
    ValidationVariant("executor", "Nav2 plans at 2 Hz, takes goals at once", changes={
        "nav2.planner_period_s": 0.5, "nav2.accept_delay_s": 0.0}),
    ValidationVariant("navigator", "turns and starts as fast as the base", changes={
        "nav2.controller": "pure_pursuit"}),
    ValidationVariant("navigator", "turns as fast as the base", changes={
        "mppi.turn_radps": 1.9, "mppi.turn_response": 20.0, "mppi.standing_turn_radps": 1.9}),
    ValidationVariant("navigator", "reaches its speed at once", changes={"mppi.speed_response": 20.0}),
    ValidationVariant("navigator", "drives as fast in turns", changes={"mppi.standing_turn_radps": 100.0}),
    ValidationVariant("navigator", "costmaps of config/nav2.yaml", changes={
        "nav2.inflation_radius_m": 0.35, "nav2.inflation_scale": 4.0}),
    ValidationVariant("navigator", "as until 0.19.0, with 0.256 m/s", changes={
        "nav2.controller": "pure_pursuit", "robot.speed_mps": 0.256}),
    ValidationVariant("speed", "robot at 0.306 m/s", changes={"robot.speed_mps": 0.306}),
    ValidationVariant("speed", "robot at 0.20 m/s", changes={"robot.speed_mps": 0.20}),
    ValidationVariant("speed", "Clyde at 0.35 m/s", changes={"clyde.speed_mps": 0.35}),
    ValidationVariant("spawn", "Clyde connected to the robot's area", changes={"clyde.spawn": "connected"}),
    ValidationVariant("spawn", "connected and at least 1.5 m away (our default)", changes={
        "clyde.spawn": "connected", "clyde.spawn_distance_m": 1.5}),
    ValidationVariant("all of ours", "robust executor, default spawn", changes={
        **_PREEMPT, "execution.pose_source": "tf", "clyde.spawn": "connected", "clyde.spawn_distance_m": 1.5}),
)  # fmt: skip


def run(source: str, episodes: int, seed: int, executor: Executor) -> list[tuple[ValidationVariant, Row]]:
    seeds = episode_seeds(seed, episodes)
    configs = [make_config("robot", "as_built", **{**_ORIGINAL, **(v.changes or {})}) for v in VARIANTS]
    name = map_assets(source, configs[0]).occupancy.name
    matchups = [Matchup(source, config, v.policy, seeds) for v, config in zip(VARIANTS, configs, strict=True)]
    played = play_all(matchups, executor)
    rows = [
        make_row({"map": name, "policy": one.policy}, [rounds], None if one is matchups[0] else [played[0][0]])
        for one, rounds in zip(matchups, played, strict=True)
    ]
    return list(zip(VARIANTS, rows, strict=True))


def table(results: list[tuple[ValidationVariant, Row]]) -> str:
    lines = ["| cause | what differs | complete, % | all but one, % | pellets | difference, points |"]
    lines.append("|---|---|---|---|---|---|")
    counts = TRIALS_COMPLETE, TRIALS_ALL_BUT_ONE
    complete, all_but_one = (with_interval(count / TRIALS, wilson(count, TRIALS)) for count in counts)
    lines.append(f"| real robot | ten trials | {complete} | {all_but_one} | | |")
    for variant, row in results:
        complete = with_interval(row["completion_rate"], row["completion_ci"])
        all_but_one = with_interval(row["all_but_one_rate"], row["all_but_one_ci"])
        difference = with_interval(row["paired_difference"], row["paired_ci"], "+")
        lines.append(
            f"| {variant.cause} | {variant.name} | {complete} | {all_but_one} | {row['pellets_mean']:.2f}"
            f" | {'' if variant is VARIANTS[0] else difference} |"
        )
    return "\n".join(lines)


def main(argv: Sequence[str] | None = None) -> int:
    return run_command(make_parser(), argv, _report)


def make_parser() -> Parser:
    parser = Parser(prog="pacman-env validation", description=__doc__)
    add = parser.add_argument
    add("--map", default="house", help="name or YAML file; the trials used pacmanbot_house (house)")
    add("--episodes", type=count(), default=1000, help="number of rounds per row (%(default)s)")
    add("--seed", type=whole_number(0), default=0, help="seed of the rounds (%(default)s)")
    add_executor_arguments(parser)
    add("--planner-answers", type=Path, help="only compare paths with the paths in this file")
    add("--recorded-goals", type=Path, nargs="+", metavar="FOLDER", help="only compare driving with these recordings")
    add("--maps", type=Path, metavar="FOLDER", help="folder of recorded maps that are not shipped")
    add("--set", action="append", default=[], metavar="NAME=VALUE", help="setting of --recorded-goals")
    add("--markdown", type=Path, help="also write the table to this file")
    return parser


def _report(arguments: argparse.Namespace) -> None:
    target = prepare(arguments.markdown) if arguments.markdown else None
    if arguments.planner_answers:
        text = planner_answers.table(arguments.planner_answers)
    elif arguments.recorded_goals:
        config = make_config(**parse_settings(arguments.set))
        text = recorded_goals.table(arguments.recorded_goals, config, arguments.maps)
    else:
        with executor_of(arguments) as executor:
            text = table(run(arguments.map, arguments.episodes, arguments.seed, executor))
    print(text)
    if target is not None:
        write_text(target, text + "\n")
