"""Run the same training from several seeds in parallel: ``pacman-env seeds``. Each seed is a task; a table follows.

A member is the training of one seed. It trains in the cache folder of its worker's machine. If the worker is lost,
another worker continues there from the last checkpoint, or starts again on another machine; both give the same planner.
The folder is removed after the member was written.
"""

import argparse
import contextlib
import dataclasses
import hashlib
import io
import json
import shutil
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mean, stdev
from typing import Any

from filelock import FileLock, Timeout

from pacman_env import __version__
from pacman_env.cli.command import Parser, guarded, whole_number
from pacman_env.config.validation import located
from pacman_env.engine.cache_folder import cache_dir, package_hash
from pacman_env.episodes.statistics import wilson
from pacman_env.executors.base import Executor, InProcess
from pacman_env.executors.choice import executor_of
from pacman_env.files import new_folder, prepare, write_json
from pacman_env.training import train
from pacman_env.training.arguments import Arguments
from pacman_env.training.checkpoint import facts_path, read_facts
from pacman_env.training.export import export_planner
from pacman_env.training.fragments import use_device
from pacman_env.training.held_out import HeldOut
from pacman_env.training.run import check_same, plain

_PROG = "pacman-env seeds"
_NOTED = "member.json"  # written last: marks a complete member
_SHOWN = ("rounds", "completed", "completed_against", "validation", "seconds")
_TABLE = "seeds.json"
_RUN = "run.json"
_WAIT_S = 10.0  # wait for a lost process with the same training to end


@dataclass(frozen=True)
class Trained:
    """A trained member: its figures, and the content of its files by name."""

    figures: dict[str, Any]
    files: dict[str, bytes]


def main(argv: Sequence[str] | None = None) -> int:
    given = sys.argv[1:] if argv is None else argv

    def begin() -> None:
        chosen = make_parser().parse_args(given)
        with executor_of(chosen) as executor:
            arguments = train.parse(_own_arguments().parse_known_args(given)[1])
            print(train_all(arguments, chosen.seeds, chosen.out, executor))

    return guarded(_PROG, begin, "train")


def make_parser() -> Parser:
    own = _own_arguments()
    options: Any = {"parents": [train.make_parser(), own], "add_help": False, "conflict_handler": "resolve"}
    return Parser(prog=_PROG, description="One training from several seeds.", allow_abbrev=False, **options)


def _own_arguments() -> argparse.ArgumentParser:
    """Return a parser of the arguments in addition to the arguments of a training."""
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--seeds", type=whole_number(0), nargs="+", default=[0, 1, 2], metavar="N", help="(0 1 2)")
    out = Path("results/seeds")
    parser.add_argument("--out", type=Path, default=out, metavar="PATH", help=f"a folder for each seed ({out})")
    return parser


def train_all(arguments: Arguments, seeds: Sequence[int], out: Path, executor: Executor) -> str:
    """Train the members that ``out`` lacks, write them there, and return the table of all members.

    Raises ValueError if ``out`` contains a member of another training, or something else in the place of a member.
    """
    if len(set(seeds)) < len(seeds):
        raise ValueError(f"seeds = {list(seeds)}: a seed is given twice")
    members = [dataclasses.replace(arguments, seed=seed, progress=False, threads=1) for seed in seeds]
    done = {member.seed: figures for member in members if (figures := _read(out, member)) is not None}
    left = {member.seed: member for member in members if member.seed not in done}
    for seed in left:
        if _folder(out, seed).exists():
            raise ValueError(f"{_folder(out, seed)}: has no {_NOTED}: move it away or give another --out")
    prepare(out / _TABLE)

    def store(one: Trained) -> None:
        done[one.figures["seed"]] = one.figures
        _write(out, one)
        forget(left[one.figures["seed"]])
        print(f"seed {one.figures['seed']}: {one.figures['completed']:.1%} of test rounds completed", flush=True)

    tasks, keys = list(left.values()), list(left)
    executor.map(train_member, tasks, store, keys)
    if executor.remote:
        executor.map(forget, tasks, keys=keys)
    trained = [done[seed] for seed in seeds]
    write_json(out / _TABLE, {"version": __version__, "members": trained})
    return _table(trained)


def train_member(arguments: Arguments) -> Trained:
    """Run one training to its end, from the start or from where it stopped on this machine.

    The files stay until :func:`forget`. Raises ValueError while another process runs the same training.
    """
    use_device(arguments.device)  # fail early: a missing device is not a damaged folder
    folder = _cached(arguments)
    try:
        held = _lock(folder).acquire(timeout=_WAIT_S)
    except Timeout:
        raise ValueError(f"{folder}: another command trains the same there: wait for its end, or end it") from None
    with held:
        if (folder / _RUN).exists():
            try:
                return _train(dataclasses.replace(arguments, out=folder, resume=True))
            except ValueError:  # the remaining files are damaged
                pass
        _remove(folder)
        return _train(dataclasses.replace(arguments, out=folder, resume=False))


def forget(arguments: Arguments) -> None:
    """Remove the files of a training on this machine, unless another process runs the same training."""
    folder = _cached(arguments)
    with contextlib.suppress(Timeout), _lock(folder).acquire(timeout=0):
        _remove(folder)


def _cached(arguments: Arguments) -> Path:
    key = hashlib.sha256(json.dumps([plain(arguments), package_hash()]).encode()).hexdigest()[:24]
    return cache_dir() / "seeds" / key


def _lock(folder: Path) -> FileLock:
    """Return the lock of a training's folder, next to the folder, which may be removed."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    return FileLock(folder.with_suffix(".lock"))


def _remove(folder: Path) -> None:
    (folder / _RUN).unlink(missing_ok=True)  # first, so that nothing resumes from a partly removed folder
    if folder.exists():
        shutil.rmtree(folder)


def _train(arguments: Arguments) -> Trained:
    folder = arguments.out
    with contextlib.redirect_stdout(io.StringIO()), InProcess() as executor:
        run, model = train.train(arguments, executor=executor)
        planner = train.planner_of(arguments, model)
        test = HeldOut(arguments, arguments.evaluation, executor, test=True)
        pool = run.league.pool(arguments.hyper.segments - 1, run.against_league())
        completed = test.completed(planner, pool)
        export_planner(planner.network, folder / "planner.onnx", read_facts(facts_path(run.last)))
    share, each = test.shares(completed)
    figures = {
        "seed": arguments.seed,
        "settings": plain(arguments),
        "rounds": len(completed),
        "completed": share,
        "completed_against": each,
        "validation": run.segments[-1]["completed"],
        "decisions": model.decisions,
        "seconds": sum(segment["seconds"] for segment in run.segments),
    }
    files = {path.name: path.read_bytes() for path in sorted(folder.iterdir()) if path.is_file()}
    return Trained(figures, {name: content for name, content in files.items() if not name.startswith("segment-")})


def _folder(out: Path, seed: int) -> Path:
    return out / f"seed-{seed}"


def _read(out: Path, member: Arguments) -> dict[str, Any] | None:
    path = _folder(out, member.seed) / _NOTED
    if not path.exists():
        return None
    with located(f"{path}: cannot be read", ValueError, (OSError, ValueError, KeyError, TypeError)):
        figures = json.loads(path.read_text())
        settings = figures["settings"]
    check_same(path, settings, plain(member))
    if missing := [name for name in _SHOWN if name not in figures]:
        raise ValueError(f"{path}: of another version, without {missing[0]!r}: move its folder away to train it again")
    return dict(figures)


def _write(out: Path, trained: Trained) -> None:
    """Write the files of a member atomically."""
    with new_folder(_folder(out, trained.figures["seed"])) as folder:
        for name, content in trained.files.items():
            (folder / name).write_bytes(content)
        write_json(folder / _NOTED, trained.figures)


def _table(figures: Sequence[dict[str, Any]]) -> str:
    lineups = list(figures[0]["completed_against"])
    several = len(lineups) > 1
    names = ["seed", "completed on test levels", *(lineups if several else []), "validation", "seconds"]
    lines = [f"| {' | '.join(names)} |", "|---" * len(names) + "|"]
    for one in figures:
        low, high = wilson(round(one["completed"] * one["rounds"]), one["rounds"]) if one["rounds"] else (0.0, 1.0)
        cells = [str(one["seed"]), f"{one['completed']:.1%} [{low:.1%}, {high:.1%}]"]
        cells += [f"{one['completed_against'][lineup]:.1%}" for lineup in lineups] if several else []
        cells += [f"{one['validation']:.1%}", f"{one['seconds']:.0f}"]
        lines.append(f"| {' | '.join(cells)} |")
    shares = [one["completed"] for one in figures]
    spread = f", deviation {stdev(shares):.1%}" if len(shares) > 1 else ""
    lines.append(
        f"\n{len(figures)} seeds: mean {mean(shares):.1%}{spread}, from {min(shares):.1%} to {max(shares):.1%}"
    )
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
