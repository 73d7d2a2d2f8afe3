"""Whether long runs keep their memory: ``python -m tests.system.memory``.

Resident memory is measured again and again; its growth after the first tenth of a part is bounded. Chipmunk's
spaces are counted, and none may be left of an environment that is gone.
"""

import argparse
import gc
import multiprocessing
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import psutil

from pacman_env.command_line.command import Parser, run_command, whole_number
from pacman_env.envs.pacmanbot_vector import PacManBotVectorEnv
from pacman_env.world.navigation.physics import Contacts

FAULT_STATUS = 1
GAMES = 64
PARTS = ("makes", "decisions", "houses")
#: By which a process may grow after the warm-up, MiB. Houses differ in size, and room is kept for the largest.
MOST_MIB = {"makes": 16.0, "decisions": 16.0, "houses": 64.0}
_LINES = 20
_SHORT = {"processes": 2, "makes": 4, "decisions": 20_000, "houses": 12}


class Fault(Exception):
    """Memory grew, or something was left over."""


def resident_mib() -> float:
    return float(psutil.Process().memory_info().rss) / 2**20


def spaces_alive() -> int:
    """Chipmunk's spaces in this process."""
    return sum(isinstance(one, Contacts) for one in gc.get_objects())


@dataclass
class Watch:
    """Looks at the memory while something is done ``total`` times."""

    part: str
    total: int
    quiet: bool = False
    base_mib: float = 0.0  # after the warm-up
    began_s: float = field(default_factory=time.monotonic)
    _next: int = 0

    def measure(self, done: int) -> None:
        """Print now and then; raises Fault where memory has grown."""
        if done < self._next and done < self.total:
            return
        self._next = done + max(1, self.total // _LINES)
        if not self.base_mib and 10 * done >= self.total:
            self.base_mib = resident_mib()
        if not self.quiet:
            took = f"{time.monotonic() - self.began_s:6.0f} s"
            print(f"{self.part:9} {done:9d} of {self.total} {took} {resident_mib():8.1f} MiB", flush=True)
        if self.base_mib and self.growth_mib() > MOST_MIB[self.part]:
            raise Fault(f"after {done}, {self}: at most {MOST_MIB[self.part]:.0f} MiB are allowed")

    def growth_mib(self) -> float:
        return resident_mib() - self.base_mib

    def __str__(self) -> str:
        return f"{self.part}: {self.growth_mib():+.1f} MiB since the first tenth"


def _alive() -> tuple[int, int]:
    """Spaces, and threads of environments without their callers."""
    gc.collect()
    return spaces_alive(), sum(thread.name.startswith("pacman_env-") for thread in threading.enumerate())


def _nothing_left(part: str, before: tuple[int, int]) -> None:
    spaces, threads = (now - then for now, then in zip(_alive(), before, strict=True))
    if spaces > 0 or threads > 0:
        raise Fault(f"{part}: {spaces} spaces and {threads} threads are left of what is gone")


def _step(env: PacManBotVectorEnv, rng: np.random.Generator, steps: int) -> None:
    for _ in range(steps):
        env.step(rng.integers(0, env.single_action_space.n, env.num_envs))  # type: ignore[union-attr]


def make_and_close(makes: int) -> float:
    """So many environments in this process, one after the other; by how much memory grew after the first tenth, MiB."""
    rng, watch, before = np.random.default_rng(0), Watch("makes", makes, quiet=True), _alive()
    for k in range(makes):
        env = PacManBotVectorEnv(8, map=("house", "maze")[k % 2], num_threads=2)
        env.reset(seed=k)
        _step(env, rng, 20)
        env.close()
        del env
        if (k + 1) % max(1, makes // 10) == 0:
            _nothing_left("makes", before)
        watch.measure(k + 1)
    return watch.growth_mib()


def _makes(arguments: argparse.Namespace) -> str:
    context, grown = multiprocessing.get_context("spawn"), 0.0
    with context.Pool(min(2, arguments.processes), maxtasksperchild=1) as pool:
        work = [arguments.makes] * arguments.processes
        for done, growth_mib in enumerate(pool.imap_unordered(make_and_close, work, chunksize=1), 1):
            grown = max(grown, growth_mib)
            print(f"makes     {done * arguments.makes:9d} in {done} processes {grown:+.1f} MiB", flush=True)
    return f"makes: {grown:+.1f} MiB at most since the first tenth"


def _decisions(arguments: argparse.Namespace) -> str:
    env = PacManBotVectorEnv(GAMES, num_threads=2)
    env.reset(seed=0)
    rng, watch = np.random.default_rng(0), Watch("decisions", arguments.decisions)
    for done in range(GAMES, arguments.decisions + GAMES, GAMES):
        _step(env, rng, 1)
        watch.measure(done)
    return str(watch)


def _houses(arguments: argparse.Namespace) -> str:
    env = PacManBotVectorEnv(2, map="generated", num_threads=2)
    rng, watch = np.random.default_rng(0), Watch("houses", arguments.houses)
    end_s = time.monotonic() + (arguments.minutes * 60 or float("inf"))
    done = 0
    while done < arguments.houses and time.monotonic() < end_s:
        env.reset(seed=done, options={"level": np.arange(done, done + 2)})
        _step(env, rng, 20)
        done += 2
        watch.measure(done)
    return f"{watch}; {done} houses"


def main(argv: Sequence[str] | None = None) -> int:
    """Run the parts; returns the exit status: 1 after a fault."""
    parser = Parser(prog="python -m tests.system.memory", description=__doc__)
    add = parser.add_argument
    add("parts", nargs="*", metavar="PART", help=f"of {', '.join(PARTS)} (all)")
    add("--short", action="store_true", help="a few of each")
    add("--processes", type=whole_number(1), default=100, help="that make environments (%(default)s)")
    add("--makes", type=whole_number(1), default=100, help="environments that each makes and closes (%(default)s)")
    add("--decisions", type=whole_number(1), default=10_000_000, help="of 64 games in all (%(default)s)")
    add("--houses", type=whole_number(1), default=20_000, help="one after the other (%(default)s)")
    add("--minutes", type=whole_number(0), default=0, help="after which no house is begun; 0: no limit (%(default)s)")
    return run_command(parser, argv, _report)


def _report(arguments: argparse.Namespace) -> int:
    unknown = set(arguments.parts) - set(PARTS)
    if unknown:
        raise ValueError(f"part {sorted(unknown)[0]!r}: there are {', '.join(PARTS)}")
    if arguments.short:
        vars(arguments).update(_SHORT)
    work = dict(zip(PARTS, (_makes, _decisions, _houses), strict=True))
    before = _alive()
    try:
        for part in arguments.parts or PARTS:
            print(work[part](arguments), flush=True)
            _nothing_left(part, before)
    except Fault as fault:
        print(fault)
        return FAULT_STATUS
    return 0


if __name__ == "__main__":
    sys.exit(main())
