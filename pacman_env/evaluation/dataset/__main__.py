"""Write rounds as a data set for offline learning: ``pacman-env dataset``.

``recording`` plays rounds, or ``robot_rounds`` reads them from a robot's bags; ``minari_files`` and ``tables`` write
them, and ``card`` describes them.
"""

import argparse
import contextlib
import re
import shlex
import sys
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from pacman_env import __version__
from pacman_env.command_line.command import Parser, run_command, whole_number
from pacman_env.config import parse_settings, preset_names
from pacman_env.engine.cache_folder import package_hash
from pacman_env.envs.arguments import EnvArguments
from pacman_env.envs.game_runner import GameRunner
from pacman_env.envs.registration import FLAT_ID, IDS
from pacman_env.executors.choice import add_executor_arguments, executor_of
from pacman_env.executors.progress import bar_of
from pacman_env.files import commit, install_command, new_folder, prepare, write_json
from pacman_env.plugins import offer
from pacman_env.sim.observation.kinds import KINDS

from .card import write_card
from .recording import RecordedRounds, Recording, outcomes, recorded, round_seeds, tasks_of

FORMATS = ("minari", "parquet")
_PREFIX = "pacman_env/"
_NAME = re.compile(r"(?:[-\w]+/)*[-\w]+-v\d+")


def main(argv: Sequence[str] | None = None) -> int:
    given = sys.argv[1:] if argv is None else argv
    return run_command(make_parser(), argv, lambda arguments: _dataset(arguments, given), "dataset")


def make_parser() -> Parser:
    parser = Parser(
        prog="pacman-env dataset",
        description="Play rounds with a policy and write observations, actions and rewards as a data set: for Minari"
        " (HDF5), as Parquet tables, or both, with a card. The files are the same for any number of workers. With"
        " --bags, convert rounds that a robot has played.",
    )
    add = parser.add_argument
    add("name", help="name of the data set, such as pacman-env/lookahead-v0; its folder is ROOT/NAME")
    add("--policy", default="lookahead", metavar="POLICY", help="policy name, .onnx file or checkpoint (%(default)s)")
    add("--id", default=FLAT_ID.removeprefix(_PREFIX), metavar="ID", help="id of the environment (%(default)s)")
    add("--map", metavar="FILE_OR_NAME", help="map: a file, a name, generated or generated:test (from the id)")
    kinds = f"kinds of the observation: {', '.join(KINDS.names())}; flat joins them to one array (from the id)"
    add("--observation", nargs="+", metavar="KIND", help=kinds)
    add("--ghosts", nargs="+", metavar="BEHAVIOUR", help="behaviour of each ghost, or a policy name (from the id)")
    add("--preset", default="robot", metavar="NAME", help=f"preset: one of {', '.join(preset_names())} (%(default)s)")
    setting = "configuration setting, such as observation.candidates=all; repeatable"
    add("--set", action="append", default=[], metavar="NAME=VALUE", help=setting)
    add("--episodes", type=whole_number(1), default=1000, metavar="N", help="rounds or endless games (%(default)s)")
    add("--seed", type=whole_number(0), default=0, metavar="S", help="seed that generates all round seeds (0)")
    add("--format", nargs="+", choices=FORMATS, default=list(FORMATS), help="formats to write (both)")
    add("--bags", nargs="+", type=Path, metavar="BAG", help="bags of 'ros record' to convert; --map must be their map")
    add("--namespace", metavar="NAME", help="namespace of the robot, if a bag contains several robots")
    add("--root", type=Path, default=Path("results/datasets"), metavar="FOLDER", help="(%(default)s)")
    add_executor_arguments(parser)
    return parser


def arguments_of(arguments: argparse.Namespace) -> tuple[str, dict[str, Any]]:
    """Return the environment's whole id and the arguments given in addition, as Gymnasium takes them."""
    env_id = arguments.id if arguments.id.startswith(_PREFIX) else _PREFIX + arguments.id
    if env_id not in IDS:
        names = [one.removeprefix(_PREFIX) for one in IDS]
        raise ValueError(f"--id {arguments.id}: {offer(arguments.id.removeprefix(_PREFIX), names)}")
    named: dict[str, Any] = {"map": arguments.map, "settings": parse_settings(arguments.set) or None}
    named["observation"] = arguments.observation and tuple(arguments.observation)
    named["ghosts"] = arguments.ghosts and tuple(arguments.ghosts)
    named["preset"] = None if arguments.preset == "robot" else arguments.preset
    return env_id, {name: value for name, value in named.items() if value is not None}


def _dataset(arguments: argparse.Namespace, given: Sequence[str]) -> None:
    folder = _folder(arguments)
    env_id, named = arguments_of(arguments)
    made = EnvArguments(**{**IDS[env_id].kwargs, **named})
    parts: contextlib.AbstractContextManager[Iterator[RecordedRounds]]
    unchecked: dict[str, str] = {}
    if arguments.bags:
        robot = _of_robot(arguments, made)
        made, parts, unchecked = robot.arguments, contextlib.nullcontext(robot.rounds()), robot.unchecked
        named |= {"ghosts": made.ghosts, "settings": made.settings}
    else:
        tasks = tasks_of(arguments.policy, made, round_seeds(arguments.seed, arguments.episodes))
        parts = _simulated(arguments, tasks)
    runner = GameRunner(1, made)
    facts = _facts(arguments, given, env_id, runner)
    with new_folder(folder) as temporary:
        with contextlib.ExitStack() as stack:
            files = _writers(arguments, temporary, (env_id, named), runner, facts)
            writers = list(map(stack.enter_context, files))
            facts |= _written(stack.enter_context(parts), writers)
        write_json(temporary / "facts.json", facts)
        write_card(temporary, facts)
    print("{rounds} rounds, {decisions} decisions, {completed:.1f} % completed".format(**facts))
    if facts["unlisted"]:
        print(
            f"{facts['unlisted']} choices were not listed among the actions and were played as hold; "
            "--set observation.candidates=all lists all candidates"
        )
    for bag, words in unchecked.items():
        print(f"{bag}: {words}")
    print(f"written: {folder}")


def _of_robot(arguments: argparse.Namespace, made: EnvArguments) -> Any:
    try:
        from .robot_rounds import RobotRounds
    except ModuleNotFoundError as error:
        if error.name not in ("rclpy", "rosbags", "mcap"):
            raise
        raise ValueError(f"--bags: {error.name} is not installed: {install_command('ros')}") from None
    return RobotRounds(arguments.bags, made, arguments.namespace)


def _folder(arguments: argparse.Namespace) -> Path:
    """Return the folder of the data set; raises ValueError early if it cannot be written."""
    if not _is_name(arguments.name, "minari" in arguments.format):
        rule = "must be as pacman-env/lookahead-v0: letters, digits, - and _, with a version"
        more = "a namespace has two or more, and none is called data"
        raise ValueError(f"name = {arguments.name!r}: {rule}; {more}")
    folder: Path = arguments.root / arguments.name
    if folder.exists():
        raise ValueError(f"{folder}: already exists")
    return prepare(folder)


def _is_name(name: str, for_minari: bool) -> bool:
    """Return True if a folder of this name, and a Minari data set in it, can be found by its reader."""
    if not _NAME.fullmatch(name) or "data" in name.split("/"):  # Minari treats every folder with a "data" as a data set
        return False
    if not for_minari:
        return True
    from .minari_files import is_dataset_id

    return is_dataset_id(name)


def _facts(arguments: argparse.Namespace, given: Sequence[str], env_id: str, runner: GameRunner) -> dict[str, Any]:
    first = runner.batch.source.first.occupancy
    return {
        "name": arguments.name,
        "policy": "the robot's own" if arguments.bags else arguments.policy,
        "bags": [path.name for path in arguments.bags or ()],
        "id": env_id,
        "map": arguments.map or IDS[env_id].kwargs.get("map", "house"),
        "map_hash": first.hash,  # hash of the first level if levels are generated
        "seed": None if arguments.bags else arguments.seed,
        "version": __version__,
        "sources": package_hash(),
        "commit": commit(),
        "command": _command(given),
        "observation_space": str(runner.observation_space).replace("\n", ""),
        "action_space": str(runner.action_space),
        "settings": runner.config.as_settings(),
    }


def _command(given: Sequence[str]) -> str:
    """Return the arguments without executor and output options, which do not affect the files."""
    other = argparse.ArgumentParser(add_help=False)
    other.add_argument("--root")
    add_executor_arguments(other)
    return shlex.join(["pacman-env", "dataset", *other.parse_known_args(given)[1]])


def _writers(
    arguments: argparse.Namespace,
    folder: Path,
    env: tuple[str, dict[str, Any]],
    runner: GameRunner,
    facts: dict[str, Any],
) -> Iterator[Any]:
    if "minari" in arguments.format:
        from .minari_files import MinariFiles, spec_of

        spaces = runner.observation_space, runner.action_space
        more = {"dataset_id": arguments.name, "algorithm_name": facts["policy"], "pacman_env": facts}
        requirements = {"requirements": [f"pacman_env=={__version__}"], "description": "rounds of PacManBot"}
        yield MinariFiles(folder, spec_of(*env), spaces, {**more, **requirements})
    if "parquet" in arguments.format:
        from .tables import Tables

        yield Tables(folder, facts)


@contextlib.contextmanager
def _simulated(arguments: argparse.Namespace, tasks: Sequence[Recording]) -> Iterator[Iterator[RecordedRounds]]:
    """Play the rounds, and yield them while a progress bar runs."""
    total = sum(len(task.seeds) for task in tasks)
    with executor_of(arguments) as executor, bar_of(executor, total, "round") as bar:

        def rounds() -> Iterator[RecordedRounds]:
            for played in recorded(tasks, executor):
                bar.update(len(played.rounds))
                yield played

        yield rounds()


def _written(parts: Iterable[RecordedRounds], writers: Sequence[Any]) -> dict[str, Any]:
    """Write all rounds and return their totals; raises ValueError without rounds."""
    notes = []
    for played in parts:
        for writer in writers:
            writer.write(played)
        notes.append(played.rounds)
    if not notes:
        raise ValueError("there is no round with a decision")
    rounds = np.concatenate(notes)
    words = np.array(outcomes(rounds))
    return {
        "rounds": len(rounds),
        "decisions": int(rounds["decisions"].sum()),
        "completed": 100 * float((words == "complete").mean()),
        "caught": 100 * float((words == "caught").mean()),
        "mean_return": float(rounds["return"].mean()),
        "unlisted": int(rounds["unlisted"].sum()),
    }


if __name__ == "__main__":
    sys.exit(main())
