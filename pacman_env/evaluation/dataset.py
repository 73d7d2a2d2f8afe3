"""Record rounds of a policy as a Minari data set for offline learning: ``pacman-env dataset``.

Minari's ``DataCollector`` records the rounds. Tasks have a fixed size and depend on nothing but their seeds, so the
content of a data set is the same for any number of workers.
"""

import argparse
import contextlib
import errno
import os
import re
import shlex
import shutil
import sys
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import gymnasium as gym
import jax
import minari
import numpy as np
from minari.data_collector import EpisodeBuffer
from minari.dataset.minari_dataset import gen_dataset_id, parse_dataset_id
from numpy.typing import NDArray

from pacman_env import __version__
from pacman_env.command_line.command import Parser, run_command, whole_number
from pacman_env.command_line.game_options import SIMULATED_MAP, add_game_option
from pacman_env.config import ConfigError, parse_settings
from pacman_env.engine.cache_folder import package_hash
from pacman_env.envs.infos import OUTCOMES
from pacman_env.envs.registration import FLAT_ID, IDS
from pacman_env.envs.resets import SEEDS
from pacman_env.episodes.rollout import MOST_ROUNDS, episode_seeds
from pacman_env.evaluation.rounds.scenarios import load_policy
from pacman_env.executors.executor import bar_of
from pacman_env.executors.executor_options import add_executor_arguments, executor_of
from pacman_env.files import commit, prepare
from pacman_env.levels.level_source import FixedMap
from pacman_env.observations.kinds import KINDS, MASK
from pacman_env.plugins import suggest
from pacman_env.policies.policy_calls import choose, reset

TASK_ROUNDS = 25
_PREFIX = "pacman_env/"
_NAME = re.compile(r"(?:[-\w]+/)*[-\w]+-v\d+")
_COLUMNS = ("observations", "actions", "rewards", "infos", "terminations", "truncations")
_FILE_BYTES = 2**21  # upper bound of HDF5's overhead


@dataclass(frozen=True)
class Recording:
    """A task: rounds of one policy in one environment."""

    policy: str  # a name or a file
    env_id: str
    arguments: dict[str, Any]  # arguments of the environment
    seeds: NDArray[np.uint64]  # (E,)


def main(argv: Sequence[str] | None = None) -> int:
    given = sys.argv[1:] if argv is None else argv
    return run_command(make_parser(), argv, lambda arguments: _dataset(arguments, given), "dataset")


def make_parser() -> Parser:
    parser = Parser(
        prog="pacman-env dataset",
        description="Play rounds with a policy and write observations, actions, rewards and action masks as a Minari"
        " data set. The content is the same for any number of workers.",
    )
    add = parser.add_argument
    add("name", help="name of the data set, such as pacman-env/lookahead-v0; its folder is ROOT/NAME")
    policy = "policy: a name, an .onnx file or a checkpoint"
    add_game_option(parser, "--policy", default="lookahead", help=policy)
    add("--id", default=FLAT_ID.removeprefix(_PREFIX), metavar="ID", help="id of the environment (%(default)s)")
    add_game_option(parser, "--map", default=None, help=f"{SIMULATED_MAP} (from the id)")
    kinds = f"kinds of the observation: {', '.join(KINDS.names())}; flat joins them to one array (from the id)"
    add("--observation", nargs="+", metavar="KIND", help=kinds)
    add_game_option(parser, "--ghosts", help="behaviour or policy of each ghost (from the id)")
    for option in ("--preset", "--set", "--seed"):
        add_game_option(parser, option)
    add("--episodes", type=whole_number(1), default=1000, metavar="N", help="rounds or endless games (%(default)s)")
    add("--root", type=Path, default=Path("results/datasets"), metavar="FOLDER", help="(%(default)s)")
    add_executor_arguments(parser)
    return parser


def tasks_of(policy: str, env: gym.Env[Any, Any], env_id: str, named: dict[str, Any], seeds: Any) -> list[Recording]:
    """Return the tasks in the order of the data set; rounds of a level are adjacent, so that its map is prepared once.

    Raises ConfigError for velocity actions, and an error if the policy cannot be created.
    """
    load_policy(policy)
    game: Any = env.unwrapped
    if game.config.action != "goal":
        raise ConfigError(f"action = {game.config.action!r}: must be goal, because policies choose goals")
    if not isinstance(game.batch.source, FixedMap):
        seeds = seeds[np.argsort(game.batch.source.levels_of(seeds), kind="stable")]
    parts = np.split(seeds, range(TASK_ROUNDS, len(seeds), TASK_ROUNDS))
    return [Recording(policy, env_id, named, part) for part in parts]


def record(task: Recording) -> tuple[list[EpisodeBuffer], list[dict[str, Any]]]:
    """Play the rounds of a task with Minari's ``DataCollector``, and read them back.

    Return the recorded rounds, and for each the metadata that its episode has in addition to Minari's.
    """
    with tempfile.TemporaryDirectory() as folder, _minari_in(folder):
        policy = load_policy(task.policy)
        made = gym.make(task.env_id, disable_env_checker=True, **task.arguments)
        env = minari.DataCollector(made, _MaskInInfos, record_infos=True, jpeg_encoding=False)
        notes = [_play(env, policy, int(seed)) for seed in task.seeds]
        episodes = env.create_dataset("part-v0").storage.get_episodes(range(len(notes)))
        env.close()
        buffers = []
        for episode, seed in zip(episodes, task.seeds, strict=True):
            fields = {name: episode[name] for name in _COLUMNS}
            buffers.append(EpisodeBuffer(options={"round_seed": int(seed)}, **fields))
        return buffers, notes


def _play(env: Any, policy: Any, seed: int) -> dict[str, Any]:
    """Play a round; return its ``level`` (0 if there is one map), its ``outcome`` and ``unlisted``.

    ``unlisted`` is the number of choices that the action space lacks; hold was played instead.
    """
    env.reset(seed=0, options={"round_seed": seed})
    game = env.unwrapped
    reset(policy, np.ones(1, dtype=np.bool_), game.config)
    over, unlisted = False, 0
    while not over and game.batch.games["round"][0] <= MOST_ROUNDS:  # the collector truncates a longer game
        chosen = choose(policy, game.situation)
        action = int(game.action_of(chosen)[0])
        unlisted += action == len(game.action_masks()) - 1 and int(chosen[0]) != game.batch.hold
        _, _, terminated, truncated, _ = env.step(action)
        over = terminated or truncated
        if not over and game.batch.completed_s[0] > 0:  # the next round of an endless game
            reset(policy, np.ones(1, dtype=np.bool_), game.config)
    level, outcome = int(game.batch.level_numbers()[0]), str(OUTCOMES[game.batch.games["end"][0]])
    return {"level": level, "outcome": outcome, "unlisted": unlisted}


class _MaskInInfos(minari.StepDataCallback):
    """Reduces each info to the decision's duration, and adds the action mask if the observation does not contain it."""

    def __call__(self, env: gym.Env[Any, Any], **step: Any) -> Any:
        data: Any = super().__call__(env, **step)
        game: Any = env.unwrapped
        info = {name: np.float64(step["info"][name]) for name in ("elapsed_s",) if name in step["info"]}
        if MASK not in getattr(game.observation_space, "spaces", {}):
            info[MASK] = game.action_masks().astype(np.int8)
        return {**data, "info": info}


@contextlib.contextmanager
def _minari_in(folder: str) -> Iterator[None]:
    """Let Minari write data sets below a folder, without warnings about missing authors."""
    with mock.patch.dict(os.environ, MINARI_DATASETS_PATH=folder), warnings.catch_warnings():
        warnings.filterwarnings("ignore", module="minari")
        warnings.simplefilter("ignore", ResourceWarning)  # the collector deletes its folders without closing them
        yield


def _dataset(arguments: argparse.Namespace, given: Sequence[str]) -> None:
    folder = _folder(arguments)
    env_id, named = _environment(arguments)
    env = gym.make(env_id, disable_env_checker=True, **named)
    seeds = episode_seeds(arguments.seed, arguments.episodes) % np.uint64(SEEDS)
    tasks = tasks_of(arguments.policy, env, env_id, named, seeds)
    # Everything is written in a hidden folder, which is renamed at the end. Minari joins relative folders twice.
    parent = folder.parent.absolute()
    with tempfile.TemporaryDirectory(dir=parent, prefix=f".{folder.name}.") as temporary, _minari_in(temporary):
        with executor_of(arguments) as executor, bar_of(executor, arguments.episodes, "round") as bar:
            dataset, notes = None, list[dict[str, Any]]()
            for buffers, added in executor.map(record, tasks):
                _require_room(temporary, buffers)
                if dataset is None:
                    about = {"algorithm_name": arguments.policy, "requirements": [f"pacman_env=={__version__}"]}
                    about |= {"description": "rounds of PacManBot", "jpeg_encoding": False}
                    dataset = minari.create_dataset_from_buffers(arguments.name, buffers, env, **about)
                else:
                    dataset.update_dataset_from_buffer(buffers)
                notes += added
                bar.update(len(added))
        assert dataset is not None
        dataset.storage.update_episode_metadata(notes)
        dataset.storage.update_metadata({"pacman_env": _facts(arguments, given, env)})
        steps = dataset.total_steps
        os.rename(Path(temporary) / arguments.name, folder)
    completed = sum(one["outcome"] == "complete" for one in notes)
    print(f"{len(notes)} rounds, {steps} decisions, {100 * completed / len(notes):.1f} % completed")
    if unlisted := sum(one["unlisted"] for one in notes):
        print(
            f"{unlisted} choices were not listed among the actions and were played as hold; "
            "--set observation.candidates=all lists all candidates"
        )
    print(f"written: {folder}")


def _folder(arguments: argparse.Namespace) -> Path:
    """Return the folder of the data set; raises ValueError early if it cannot be written."""
    name = arguments.name
    # Minari treats every folder with a "data" as a data set.
    if not _NAME.fullmatch(name) or "data" in name.split("/") or not _is_dataset_id(name):
        rule = "must be as pacman-env/lookahead-v0: letters, digits, - and _, with a version"
        raise ValueError(f"name = {name!r}: {rule}; a namespace has two or more, and none is called data")
    folder: Path = arguments.root / name
    if folder.exists():
        raise ValueError(f"{folder}: already exists")
    return prepare(folder)


def _is_dataset_id(name: str) -> bool:
    """Return True if Minari can split a data set name into its parts and compose the same name from them."""
    try:
        return gen_dataset_id(*parse_dataset_id(name)) == name
    except ValueError:
        return False


def _environment(arguments: argparse.Namespace) -> tuple[str, dict[str, Any]]:
    """Return the complete id of the environment, and the given arguments for ``gymnasium.make``."""
    env_id = arguments.id if arguments.id.startswith(_PREFIX) else _PREFIX + arguments.id
    if env_id not in IDS:
        names = [one.removeprefix(_PREFIX) for one in IDS]
        raise ValueError(f"--id {arguments.id}: {suggest(arguments.id.removeprefix(_PREFIX), names)}")
    named: dict[str, Any] = {"map": arguments.map, "settings": parse_settings(arguments.set) or None}
    named |= {"observation": arguments.observation, "ghosts": arguments.ghosts}
    named["preset"] = None if arguments.preset == "robot" else arguments.preset
    return env_id, {name: value for name, value in named.items() if value is not None}


def _facts(arguments: argparse.Namespace, given: Sequence[str], env: Any) -> dict[str, Any]:
    executors = argparse.ArgumentParser(add_help=False)  # options of executors do not affect the content
    executors.add_argument("--root")
    add_executor_arguments(executors)
    return {
        "command": shlex.join(["pacman-env", "dataset", *executors.parse_known_args(given)[1]]),
        "seed": arguments.seed,
        "map_hash": env.unwrapped.batch.source.first.occupancy.hash,  # of the first level, if levels are generated
        "version": __version__,
        "sources": package_hash(),
        "commit": commit(),
        "settings": env.unwrapped.config.as_settings(),
    }


def _require_room(folder: str, buffers: Sequence[EpisodeBuffer]) -> None:
    """Raise OSError if the disk may become full: after a failed write, HDF5 crashes with a segmentation fault."""
    size = sum(np.asarray(leaf).nbytes for one in buffers for leaf in jax.tree.leaves(one.observations))
    if shutil.disk_usage(folder).free < 4 * size + _FILE_BYTES:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), folder)


if __name__ == "__main__":
    sys.exit(main())
